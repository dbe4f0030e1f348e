"""Landmarks of people in pictures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.devices.video.landmarker_files import HAND_LANDMARKER, POSE_LANDMARKER, find_landmarkers
from bodysense.devices.video.landmarks import BODY_LANDMARKS, Landmarker, LandmarkerSettings
from bodysense.devices.video.person import PersonState, follow
from bodysense.devices.video.pictures import Picture
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip

MARK = {name: k for k, name in enumerate(BODY_LANDMARKS)}


def test_a_drawn_figure_is_found_at_its_position(landmarkers: Path, filmed: tuple[np.ndarray, Clip]) -> None:
    pictures, clip = filmed
    state, rows = PersonState(), []
    with Landmarker(find_landmarkers(landmarkers), LandmarkerSettings(people=1)) as landmarker:
        for k, pixels in enumerate(pictures):
            picture = Picture(k / 15, pixels)
            row, state = follow(picture, *landmarker.find(picture), state)
            rows.append(row)
    assert all(row.has_body[0] and row.has_hand.all() for row in rows)
    body, hand = rows[-1], rows[-1].hand[0]
    # The figure faces the camera: its left is to the picture's right, the head up, the nose in front of the ears.
    world = body.world[0]
    assert world[MARK["left_shoulder"], 0] > world[MARK["right_shoulder"], 0] + 0.2
    assert world[MARK["nose"], 1] > world[MARK["left_shoulder"], 1] > 0.3
    assert world[MARK["nose"], 2] > world[MARK["left_ear"], 2]
    # Hands are at the wrists of their sides, and arms have the right direction.
    for number, side in enumerate(("left", "right")):
        wrist = body.picture[0, MARK[f"{side}_wrist"]]
        assert np.linalg.norm(hand[number, 0] - wrist) < 0.05
    position = np.asarray(forward_kinematics(clip.pose)[0])[-1]
    skeleton = clip.pose.skeleton
    measured = world[MARK["left_wrist"]] - world[MARK["right_wrist"]]
    true = position[skeleton.index("left_wrist")] - position[skeleton.index("right_wrist")]
    assert np.sign(measured[0]) == np.sign(true[0])


def test_an_empty_picture_has_no_person(landmarkers: Path) -> None:
    with Landmarker(find_landmarkers(landmarkers)) as landmarker:
        bodies, hands = landmarker.find(Picture(0.0, np.full((120, 160, 3), 90, np.uint8)))
    assert bodies.world.shape == (0, 33, 3) and bodies.picture.shape == (0, 33, 2) and bodies.visible.shape == (0, 33)
    assert hands.picture.shape == (0, 21, 2) and hands.left.shape == (0,)


def test_bad_model_files_are_refused_in_one_line(tmp_path: Path) -> None:
    pytest.importorskip("mediapipe")
    for name in (POSE_LANDMARKER, HAND_LANDMARKER):
        (tmp_path / name).write_bytes(b"no model")
    with pytest.raises(BodysenseError, match="the landmarkers there cannot be used") as error:
        Landmarker(find_landmarkers(tmp_path))
    assert "\n" not in str(error.value)


def test_zero_people_are_refused() -> None:
    with pytest.raises(BodysenseError, match="--people 0"):
        LandmarkerSettings(people=0)
