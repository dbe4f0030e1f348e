"""Ring of cameras: their positions, and the lights that they see, against a ray test by dense sampling."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.capsules import PosedPrimitives, Primitives
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.camera_ring import CameraRing, seen_lights
from bodysense.errors import BodysenseError


def solids_of(start: np.ndarray, end: np.ndarray, radius: np.ndarray, frames: int = 1) -> PosedPrimitives:
    """Return C capsules that do not move, for some frames."""
    nothing = np.zeros((0, 3))
    primitives = Primitives(
        *(default_skeleton(), ("",) * len(radius), np.zeros(len(radius), dtype=int)),
        *(start, end, radius, nothing, nothing, np.zeros(3)),
    )
    many = [np.broadcast_to(part, (frames, *part.shape)) for part in (start, end, nothing, np.zeros((0, 3, 3)))]
    return PosedPrimitives(primitives, *many)


def distance_by_sampling(camera: np.ndarray, light: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the least distances (C,) m of a ray from capsules' axes, both sampled densely."""
    ray = camera + np.linspace(0, 1, 500)[:, None] * (light - camera)
    axis = start + np.linspace(0, 1, 30)[:, None, None] * (end - start)  # (30, C, 3)
    return np.linalg.norm(ray[:, None, None] - axis, axis=-1).min(axis=(0, 1))


def test_cameras_are_spaced_evenly_about_the_middle() -> None:
    ring = CameraRing(count=6, radius=2.0, heights=(0.5, 1.5))
    middle = np.array([1.0, 0.8, -3.0])
    places = ring.places(middle) - middle
    np.testing.assert_allclose(np.hypot(places[:, 0], places[:, 2]), 2.0)
    np.testing.assert_allclose(places[:, 1], [0.5, 1.5] * 3)
    np.testing.assert_allclose(places[:, [0, 2]].sum(axis=0), 0, atol=1e-12)
    assert len(np.unique(places.round(6), axis=0)) == 6


def test_seen_lights_equal_those_of_a_plain_ray_test() -> None:
    rng = np.random.default_rng(0)
    start = rng.normal(scale=0.25, size=(12, 3))
    end = start + rng.normal(scale=0.15, size=(12, 3))
    radius = rng.uniform(0.03, 0.12, 12)
    light = rng.normal(scale=0.3, size=(1, 25, 3))
    facing = rng.normal(size=(1, 25, 3))
    facing /= np.linalg.norm(facing, axis=-1, keepdims=True)
    ring = CameraRing(count=5, radius=1.5, heights=(0.2, 0.9), least=2, beam=100.0)
    found = seen_lights(ring, np.zeros(3), light, facing, solids_of(start, end, radius))
    tested = 0
    for k in range(light.shape[1]):
        count, doubtful = 0, False
        for camera in ring.places(np.zeros(3)):
            way = camera - light[0, k]
            cosine = facing[0, k] @ way / np.linalg.norm(way)
            gap = distance_by_sampling(camera, light[0, k], start, end) - radius
            doubtful |= bool((np.abs(gap) < 0.003).any())
            count += bool(cosine >= np.cos(np.radians(ring.beam)) and (gap > 0).all())
        if not doubtful:
            assert found[0, k] == (count >= 2), k
            tested += 1
    assert tested > 10 and 0 < found.sum() < found.size


def test_frames_are_independent_across_blocks() -> None:
    rng = np.random.default_rng(1)
    frames = 700  # more than two blocks
    start = rng.normal(scale=0.3, size=(frames, 6, 3))
    solids = solids_of(np.zeros((6, 3)), np.tile([0.2, 0.0, 0.0], (6, 1)), np.full(6, 0.06), frames)
    solids = PosedPrimitives(solids.primitives, start, start + np.array([0.2, 0.0, 0.0]), solids.center, solids.axes)
    light, facing = rng.normal(scale=0.3, size=(frames, 4, 3)), np.broadcast_to([0.0, 1.0, 0.0], (frames, 4, 3))
    ring = CameraRing(count=4)
    whole = seen_lights(ring, np.zeros(3), light, facing, solids)
    for frame in (0, 255, 256, 699):
        part = slice(frame, frame + 1)
        one = PosedPrimitives(
            solids.primitives, solids.start[part], solids.end[part], solids.center[part], solids.axes[part]
        )
        np.testing.assert_array_equal(seen_lights(ring, np.zeros(3), light[part], facing[part], one), whole[part])
    assert 0 < whole.mean() < 1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"count": 3, "least": 4}, "4 of 3 cameras"),
        ({"count": 0}, "2 of 0 cameras"),
        ({"radius": 0.0}, "radius of 0 m"),
        ({"heights": ()}, "heights"),
        ({"heights": (np.nan,)}, "heights"),
        ({"beam": 0.0}, "beam of 0 degrees"),
    ],
)
def test_bad_settings_are_refused(settings: dict, message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        CameraRing(**settings)
