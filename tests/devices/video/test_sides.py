"""Correction of exchanged left and right sides of a body."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.arms import SIDES
from bodysense.devices.video.landmarks import BODY_LANDMARKS, Bodies, HandLandmarks
from bodysense.devices.video.person import PersonState, follow
from bodysense.devices.video.pictures import Picture
from bodysense.devices.video.sides import EXCHANGED, exchange

MARK = {name: k for k, name in enumerate(BODY_LANDMARKS)}
SHOULDERS = [MARK[f"{side}_shoulder"] for side in SIDES]


def body(turn: float) -> np.ndarray:
    """Return landmarks (33, 3) m of a standing person turned by an angle; 0 faces the camera, left toward +x."""
    parts = {"shoulder": (0.2, 0.5), "elbow": (0.5, 0.5), "wrist": (0.7, 0.45), "hip": (0.12, 0.0)}
    local = np.random.default_rng(0).normal(0, 0.02, (len(BODY_LANDMARKS), 3))
    for sign, side in zip((1, -1), SIDES, strict=True):
        for name, (across, up) in parts.items():
            local[MARK[f"{side}_{name}"]] = sign * across, up, 0.1 * (name == "wrist")
    cosine, sine = np.cos(turn), np.sin(turn)
    return local @ np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])


def left_is_right_in_picture(worlds: list[np.ndarray], labelled: str) -> list[bool]:
    """Return, for each frame at 30 Hz, whether the left shoulder is to the picture's right.

    `labelled`: hands have the labels of a person who faces the camera ("front"), of the body ("own"), or are missing.
    """
    state, rows = PersonState(), []
    for k, world in enumerate(worlds):
        seen = Bodies(world[None], world[None, :, :2] / 2, np.ones((1, len(BODY_LANDMARKS))))
        shape = np.random.default_rng(1).uniform(-0.02, 0.02, (21, 2))
        shape[0] = 0
        # Hands at both wrists. The left hand of a person who faces the camera is to the picture's right.
        at = np.sort(seen.picture[0, [MARK[f"{side}_wrist"] for side in SIDES]], axis=0)[::-1]
        hands = HandLandmarks(np.ones((2, 21, 3)), at[:, None] + shape, np.array([0.95, 0.05]))
        if labelled == "own" and world[SHOULDERS[0], 0] < world[SHOULDERS[1], 0]:
            hands = HandLandmarks(hands.world, hands.picture, 1 - hands.left)
        if labelled == "none":
            hands = HandLandmarks(np.ones((0, 21, 3)), np.ones((0, 21, 2)), np.ones(0))
        row, state = follow(Picture(k / 30, np.zeros((8, 8, 3), np.uint8)), seen, hands, state)
        left, right = row.world[0, SHOULDERS]
        rows.append(bool(left[0] > right[0]))
    return rows


def test_two_exchanges_of_sides_cancel() -> None:
    assert sorted(EXCHANGED) == list(range(len(BODY_LANDMARKS)))
    assert EXCHANGED[MARK["nose"]] == MARK["nose"] and EXCHANGED[MARK["left_toe"]] == MARK["right_toe"]
    before = (body(0.3), body(0.3)[:, :2], np.arange(33.0))
    for one, again in zip(before, exchange(*exchange(*before)), strict=True):
        np.testing.assert_array_equal(one, again)


def as_back(body: np.ndarray) -> np.ndarray:
    """Return a body with the same positions in the picture, seen from its back."""
    return body[EXCHANGED] * [1, 1, -1]


@pytest.mark.parametrize("narrow", [0, 2], ids=["at once", "through a line"])
def test_a_front_mistaken_for_a_back_is_corrected(narrow: int) -> None:
    front = body(0.1)
    between = [body(np.pi / 2)] * narrow  # the landmarker smooths its landmarks
    frames = [front] * 5 + between + [as_back(front)] * 60 + [front] * 5
    sides = left_is_right_in_picture(frames, labelled="front")
    assert all(side for k, side in enumerate(sides) if not 5 <= k < 5 + narrow)


def test_without_hands_the_correction_lasts_a_second() -> None:
    sides = left_is_right_in_picture([body(0.1)] * 5 + [as_back(body(0.1))] * 60, labelled="none")
    assert all(sides[:34]) and not any(sides[40:])


def test_hands_can_end_a_wrong_start() -> None:
    assert (
        left_is_right_in_picture([as_back(body(0.1))] * 5 + [body(0.1)] * 5, labelled="front")
        == [False] * 5 + [True] * 5
    )


@pytest.mark.parametrize(("seconds", "labelled"), [(0.8, "none"), (2.0, "own"), (2.0, "none")])
def test_real_turns_are_kept(seconds: float, labelled: str) -> None:
    frames = round(30 * seconds)
    sides = left_is_right_in_picture(
        [body(turn) for turn in np.linspace(0, np.pi, frames)] + [body(np.pi)] * 45, labelled=labelled
    )
    assert sides[0] and not any(sides[-10:])
