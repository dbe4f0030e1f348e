"""The kernels: segments, capsules and boxes against dense sampling and plain loops."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.capsules import fit_primitives, place
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_exp
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.rays import (
    blocked,
    segment_distance_squared,
    segment_meets_box,
    segment_meets_capsule,
)

GENERATOR_SEED = 11


def sampled_distance(a: np.ndarray, u: np.ndarray, b: np.ndarray, v: np.ndarray) -> float:
    """Distance of two segments by a dense grid, refined about its best cell."""
    low, high = np.zeros(2), np.ones(2)
    best = np.inf
    for _ in range(12):
        s, t = (np.linspace(low[k], high[k], 21) for k in (0, 1))
        gap = (a + s[:, None, None] * u) - (b + t[None, :, None] * v)
        distance = np.linalg.norm(gap, axis=-1)
        i, j = np.unravel_index(np.argmin(distance), distance.shape)
        best = min(best, float(distance[i, j]))
        width = (high - low) / 5
        best_place = np.array([s[i], t[j]])
        low, high = np.maximum(best_place - width, 0), np.minimum(best_place + width, 1)
    return best


def test_segment_distance_agrees_with_dense_sampling() -> None:
    generator = np.random.default_rng(GENERATOR_SEED)
    a, u, b, v = generator.normal(size=(4, 3, 200))
    found = np.sqrt(segment_distance_squared(a, u, b, v))
    for k in range(200):
        assert found[k] == pytest.approx(sampled_distance(a[:, k], u[:, k], b[:, k], v[:, k]), abs=1e-5)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_segment_distance_of_parallel_and_empty_segments(dtype: type) -> None:
    def distance(*segments: list[float]) -> float:
        return float(np.sqrt(segment_distance_squared(*(np.array(part, dtype=dtype)[:, None] for part in segments))[0]))

    assert distance([0, 0, 0], [1, 0, 0], [0.5, 2, 0], [1, 0, 0]) == pytest.approx(2)  # side by side
    assert distance([0, 0, 0], [1, 0, 0], [3, 0, 0], [-1, 0, 0]) == pytest.approx(1)  # end to end
    assert distance([0, 0, 0], [1, 0, 0], [0.3, 0, 0], [0.2, 0, 0]) == pytest.approx(0, abs=1e-6)  # inside
    assert distance([0, 0, 0], [0, 0, 0], [1, 1, 0], [0, 0, 0]) == pytest.approx(np.sqrt(2))  # two points
    assert distance([0, 0, 0], [0, 0, 0], [-1, 1, 0], [2, 0, 0]) == pytest.approx(1)  # a point and a segment


def test_single_precision_is_exact_enough_for_slender_parallel_limbs() -> None:
    """Rays along a finger: the worst case of the formula's cancellation."""
    generator = np.random.default_rng(GENERATOR_SEED)
    u = generator.normal(size=(3, 4000))
    u /= np.linalg.norm(u, axis=0)
    v = 0.03 * (u + 10 ** generator.uniform(-6, -1, 4000) * generator.normal(size=u.shape))
    b = 0.9 * u + 0.01 * generator.normal(size=u.shape)
    zero = np.zeros_like(u)
    exact = np.sqrt(segment_distance_squared(zero, u, b, v))
    single = np.sqrt(segment_distance_squared(*(part.astype(np.float32) for part in (zero, u, b, v))))
    assert np.abs(exact - single).max() < 2e-6


def test_a_ray_meets_a_capsule_only_before_its_target() -> None:
    start, along = np.array([[0.0], [-1], [1]]), np.array([[0.0], [2], [0]])
    for reach, met in ((0.85, False), (0.95, True), (1.5, True)):
        assert segment_meets_capsule(np.array([[0.0], [0], [reach]]), start, along, np.array([0.1]))[0] == met


def test_segment_meets_box_agrees_with_dense_sampling() -> None:
    generator = np.random.default_rng(GENERATOR_SEED)
    count = 2000
    target, center = generator.normal(size=(2, 3, count)) * np.array([1.0, 0.6])[:, None, None]
    axes = np.linalg.qr(generator.normal(size=(count, 3, 3)))[0]
    half_size = generator.uniform(0.1, 0.8, size=(3, count))
    found = segment_meets_box(target, center, np.moveaxis(axes, 0, -1), half_size)
    along = np.linspace(0, 1, 4001)
    for k in range(count):
        points = (along[:, None] * target[:, k] - center[:, k]) @ axes[k]
        excess = (np.abs(points) - half_size[:, k]).max(axis=1).min()
        if abs(excess) > 1e-3:
            assert found[k] == (excess < 0)
    assert 0.1 < found.mean() < 0.9  # both answers occur


def test_a_ray_along_the_side_of_a_box() -> None:
    axes, half_size = np.eye(3)[:, :, None], np.array([[0.1], [0.2], [0.3]])
    target = np.array([[0.0], [0], [1]])
    for x, met in ((0.0, True), (0.09, True), (0.11, False), (-0.11, False)):
        assert segment_meets_box(target, np.array([[x], [0.0], [0.5]]), axes, half_size)[0] == met
    here = np.zeros((3, 1))
    assert segment_meets_box(here, np.array([[0.05], [0.1], [0.2]]), axes, half_size)[0]
    assert not segment_meets_box(here, np.array([[0.05], [0.3], [0.2]]), axes, half_size)[0]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_quick_test_loses_no_pair(dtype: type) -> None:
    """`blocked` with one primitive allowed at a time against the exact test of every pair."""
    generator = np.random.default_rng(GENERATOR_SEED)
    skeleton = default_skeleton()
    primitives = fit_primitives(skeleton)
    pose = Pose(skeleton, generator.normal(size=(40, 3)), quaternion_exp(generator.normal(size=(40, 52, 3)) * 0.5))
    position, rotation = forward_kinematics(pose)
    camera = position[:, skeleton.index("head")] + generator.normal(size=(40, 3)) * 0.3
    solids = place(primitives, (position - camera[:, None]).astype(dtype), rotation.astype(dtype))
    toward = generator.integers(len(primitives.names), size=(40, 30, 1))
    target = np.take_along_axis(solids.middle, toward, axis=1) * generator.uniform(0.5, 1.5, (40, 30, 1)).astype(dtype)
    active = generator.random((40, 30)) < 0.9

    rays = np.moveaxis(target, -1, 0)[..., None]
    start, end, center = (np.moveaxis(part, -1, 0)[:, :, None] for part in (solids.start, solids.end, solids.center))
    in_capsule = segment_meets_capsule(rays, start, end - start, primitives.radius)
    axes = np.moveaxis(solids.axes, (-2, -1), (0, 1))[:, :, :, None]
    rays = np.broadcast_to(rays, (*rays.shape[:-1], len(primitives.half_size)))
    in_box = segment_meets_box(rays, np.broadcast_to(center, rays.shape), axes, primitives.half_size.T[:, None, None])
    exact = np.concatenate([in_capsule, in_box], axis=-1) & active[..., None]
    assert exact.any(axis=(0, 1)).sum() > 50  # nearly every primitive is hit somewhere
    for n in range(len(primitives.names)):
        only = np.zeros((30, len(primitives.names)), dtype=bool)
        only[:, n] = True
        assert np.array_equal(blocked(target, solids, active, only), exact[..., n]), primitives.names[n]
    half = generator.random((30, len(primitives.names))) < 0.5
    assert np.array_equal(blocked(target, solids, active, half), (exact & half).any(axis=-1))
