"""Arms along the lines on which they are seen, against a projection written down here."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.devices.arm_lines import along_lines

FOCAL, DISTANCE = 1.2, 2.5


def seen(start: np.ndarray, bones: np.ndarray, lengths: tuple[float, float] = (0.27, 0.24)) -> np.ndarray:
    """(3, 2) where shoulder, elbow and wrist (3,) of an arm are in the picture."""
    points = start + np.concatenate([np.zeros((1, 3)), np.cumsum(bones * np.array(lengths)[:, None], axis=0)])
    return FOCAL * points[:, :2] / -points[:, 2:]


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)))


def unit(*rows: tuple[float, float, float]) -> np.ndarray:
    values = np.array(rows, dtype=float)
    return values / np.linalg.norm(values, axis=-1, keepdims=True)


T_POSE = unit((1, 0, 0), (1, 0, 0))


@pytest.mark.parametrize("low", [10.0, 20.0, 30.0])
def test_arms_that_a_network_holds_low_are_lifted_to_where_they_are_seen(low: float) -> None:
    down = np.radians(low)
    said = np.tile([np.cos(down), -np.sin(down), 0.0], (2, 1))
    found = along_lines(said, seen(np.array([0.2, 0.3, -DISTANCE]), T_POSE), FOCAL, DISTANCE)
    assert degrees(found, T_POSE).max() < 4


def test_what_is_seen_as_it_is_said_stays() -> None:
    rng = np.random.default_rng(0)
    bones = unit(*rng.normal(size=(400, 3))).reshape(200, 2, 3)
    bones = bones[(np.abs(bones[..., 2]) < 0.9).all(axis=-1)]
    places = np.array([seen(np.array([0.3, 0.5, -DISTANCE]), arm) for arm in bones])
    found = along_lines(bones, places, FOCAL, DISTANCE)
    # The middle of a bone in the picture is not quite the picture of its middle.
    assert degrees(found, bones).mean() < 2 and degrees(found, bones).max() < 12
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, atol=1e-9)


def test_depth_is_left_to_the_network_and_a_bone_toward_the_camera_as_well() -> None:
    rng = np.random.default_rng(1)
    said = unit(*rng.normal(size=(2, 3)))
    found = along_lines(said, seen(np.array([0.0, 0.0, -DISTANCE]), T_POSE), FOCAL, DISTANCE)
    assert np.abs(found[:, 2] - said[:, 2]).max() < 0.15
    toward = unit((0.02, 0.01, 1), (0.0, 0.03, 1))
    places = np.array([[0.0, 0.0], [0.004, -0.003], [0.001, -0.002]])  # a detector's noise
    assert degrees(along_lines(toward, places, FOCAL, DISTANCE), toward).max() < 3


def test_places_that_are_one_leave_the_bones_as_they_are() -> None:
    np.testing.assert_allclose(along_lines(T_POSE, np.zeros((3, 2)), FOCAL, DISTANCE), T_POSE, atol=1e-9)
