"""Tilt and roll of a camera from a standing person."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.arms import SIDES
from bodysense.devices.video.camera_level import CameraLevel, remove_roll, roll_matrix, tilt_matrix
from bodysense.devices.video.landmarks import BODY_LANDMARKS
from bodysense.devices.video.person import PersonLandmarks

HEIGHT = {"shoulder": (0.18, 0.5), "hip": (0.1, 0.0), "knee": (0.1, -0.42), "ankle": (0.1, -0.84)}


def standing(tilt: float = 0.0, roll: float = 0.0, bend: float = 0.0, frames: int = 1) -> PersonLandmarks:
    """Return a standing person in front of a tilted and rolled camera, their trunk bent forward; all in degrees."""
    world = np.zeros((len(BODY_LANDMARKS), 3))
    for part, (aside, height) in HEIGHT.items():
        for sign, side in zip((1, -1), SIDES, strict=True):
            place = np.array([sign * aside, height, 0.0])
            if part == "shoulder":
                place = tilt_matrix(np.radians(bend)).T @ place
            world[BODY_LANDMARKS.index(f"{side}_{part}")] = place
    world = world @ tilt_matrix(np.radians(tilt)) @ roll_matrix(np.radians(roll))  # camera ← room, of rows
    return PersonLandmarks(
        time=np.arange(frames) / 30,
        world=np.tile(world, (frames, 1, 1)),
        picture=np.tile(world[:, :2] / 3, (frames, 1, 1)),
        visible=np.ones((frames, len(BODY_LANDMARKS))),
        has_body=np.ones(frames, dtype=bool),
        hand=np.tile(world[:21, :2], (frames, 2, 1, 1)),
        hand_world=np.tile(world[:21], (frames, 2, 1, 1)),
        has_hand=np.ones((frames, 2), dtype=bool),
    )


def level_of(person: PersonLandmarks) -> CameraLevel:
    level = CameraLevel()
    for k in range(len(person)):
        level = level.step(person[k : k + 1])
    return level


@pytest.mark.parametrize(("tilt", "roll"), [(0, 0), (12, 0), (0, 20), (10, -30), (-8, 40)])
def test_tilt_and_roll_equal_those_of_the_camera(tilt: float, roll: float) -> None:
    level = level_of(standing(tilt, roll, frames=5))
    assert np.degrees([level.tilt, level.roll]) == pytest.approx([tilt, roll], abs=1e-6)
    assert np.degrees(level.likely_roll) == pytest.approx(roll, abs=0.6)


@pytest.mark.parametrize("roll", [-25.0, 15.0, 40.0])
def test_upright_landmarks_equal_those_of_an_upright_camera(roll: float) -> None:
    person, level = standing(10.0, roll), standing(10.0)
    turned = remove_roll(person, np.radians(roll))
    for name in ("world", "picture", "hand", "hand_world"):
        np.testing.assert_allclose(getattr(turned, name), getattr(level, name), atol=1e-12)


def test_sway_hardly_rolls_a_level_camera() -> None:
    assert abs(np.degrees(level_of(standing(roll=1.5)).likely_roll)) < 0.4
    level = CameraLevel()
    for k in range(300):
        one = standing(roll=3 * np.sin(k / 20))
        level = level.step(replace(one, time=np.array([k / 30])))
    assert abs(np.degrees(level.likely_roll)) < 0.3


@pytest.mark.parametrize("posture", ["bent", "lying", "without feet", "missing"])
def test_only_standing_people_count(posture: str) -> None:
    person = standing(roll=80.0 if posture == "lying" else 20.0, bend=40.0 if posture == "bent" else 0.0)
    if posture == "without feet":
        person.visible[:, BODY_LANDMARKS.index("left_ankle")] = 0.1
    if posture == "missing":
        person = replace(person, has_body=np.zeros(1, dtype=bool), world=np.full_like(person.world, np.nan))
    assert level_of(person) == CameraLevel()


def test_angles_are_averaged_over_ten_seconds() -> None:
    person = standing(roll=20.0, frames=900)
    assert level_of(person).stood == pytest.approx(10.0)
