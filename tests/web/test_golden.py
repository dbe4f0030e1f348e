"""A golden sequence: the page's worker makes of it what the library's tracker does, frame by frame."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose
from bodysense.body.rotation import geodesic_angle
from bodysense.demo import performance_of_stranger
from bodysense.devices.simulated.device import simulate
from bodysense.observation import Observation, observed_points
from bodysense.tracker import Tracker

pytestmark = pytest.mark.slow

Scenario = Callable[..., dict[str, Any]]
FRAMES = 10_000
_DEVICES = ("three_point", "headset_camera", "six_point", "three_point_imu_feet", "ten_point", "head")
_GAP = 2.0  # s between two takes: motion starts afresh, who the wearer is stays known


@dataclass(frozen=True)
class Golden:
    """Bodies of N frames."""

    points: np.ndarray  # (N, 65, 3) m
    rotation: np.ndarray  # (N, 52, 4) wxyz, parent ← joint


def takes(frames: int) -> list[Observation]:
    """The packaged performance, tracked by one device after another, with errors as devices have them."""
    clip = performance_of_stranger()
    found, time, total = [], 0.0, 0
    for k in range(100):
        observation = simulate(clip, _DEVICES[k % len(_DEVICES)], noise=None if k % 4 == 3 else k)
        observation = observation[: frames - total]
        found.append(_whole(observation, clip.pose, time))
        time, total = found[-1].time[-1] + _GAP, total + len(observation)
        if total >= frames:
            break
    return found


def _whole(observation: Observation, pose: Pose, begin: float) -> Observation:
    """The same of all points of the skeleton."""
    position, rotation, has_position, has_rotation = observed_points(observation, pose.skeleton)
    accuracy = np.full(has_position.shape, 0.01)
    accuracy[:, pose.skeleton.indices(observation.points)] = observation.accuracy
    points = pose.skeleton.points
    return Observation(points, position, rotation, has_position, has_rotation, accuracy, observation.time + begin)


def write_takes(path: Path, observations: list[Observation], height: float | None) -> None:
    """For the page: a line of JSON, then for each take its arrays, float32 but for the time."""
    head = {"points": observations[0].points, "frames": [len(one) for one in observations], "height": height}
    with path.open("wb") as file:
        file.write(json.dumps(head).encode() + b"\n")
        for one in observations:
            file.write(one.time.astype("<f8").tobytes())
            for values in (one.position, one.rotation, one.accuracy):
                file.write(values.astype("<f4").tobytes())
            for mask in (one.has_position, one.has_rotation):
                file.write(mask.astype(np.uint8).tobytes())


def of_the_library(observations: list[Observation], height: float | None) -> Golden:
    """What the tracker makes of the takes, one after the other."""
    tracker = Tracker(Person(height=height))
    state, points, rotations = tracker.start(), [], []
    for one in observations:
        rounded = Observation(
            one.points,
            one.position.astype(np.float32).astype(float),
            one.rotation.astype(np.float32).astype(float),
            one.has_position,
            one.has_rotation,
            one.accuracy.astype(np.float32).astype(float),
            one.time,
        )
        estimate, state = tracker.step(rounded, state)
        points.append(estimate.points)
        rotations.append(estimate.pose.rotation)
    return Golden(np.concatenate(points), np.concatenate(rotations))


def of_the_page(path: Path, frames: int) -> Golden:
    """What the page's worker made of them, as tests/browser/golden.mjs writes it."""
    values = np.fromfile(path, dtype="<f4").astype(float)
    points, rotation = np.split(values.reshape(frames, -1), [65 * 3], axis=1)
    return Golden(points.reshape(frames, 65, 3), rotation.reshape(frames, 52, 4))


def differences(a: Golden, b: Golden) -> tuple[np.ndarray, np.ndarray]:
    """Of every frame (N,): the largest distance of two points, mm, and the largest angle of two rotations, degrees."""
    far = np.linalg.norm(a.points - b.points, axis=-1).max(axis=1) * 1000
    turned = np.rad2deg(np.asarray(geodesic_angle(unit(a.rotation), unit(b.rotation)))).max(axis=1)
    return far, turned


def unit(rotation: np.ndarray) -> np.ndarray:
    """Rotations of length one."""
    return rotation / np.linalg.norm(rotation, axis=-1, keepdims=True)


@pytest.mark.parametrize(("frames", "height"), [(FRAMES, None), (900, 1.83)])
def test_the_page_computes_what_the_library_does(
    scenario: Scenario, site: Path, tmp_path: Path, frames: int, height: float | None
) -> None:
    observations = takes(frames)
    write_takes(tmp_path / "takes.bin", observations, height)
    facts = scenario("golden", site, tmp_path / "takes.bin", tmp_path / "result.bin")
    assert facts["frames"] == frames
    library, page = of_the_library(observations, height), of_the_page(tmp_path / "result.bin", frames)
    apart, turned = differences(library, page)
    assert apart.max() <= 0.1  # mm
    # Single precision differs by processor; where a spine hardly bends, that turns its middle by more than it moves it.
    assert np.quantile(turned, 0.98) <= 0.01 and turned.max() <= 0.05  # degrees
