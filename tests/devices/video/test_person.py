"""Tracking of one person among the people in a video."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.arms import SIDES
from bodysense.devices.video.landmarks import BODY_LANDMARKS, Bodies, HandLandmarks
from bodysense.devices.video.person import (
    PersonLandmarks,
    PersonSettings,
    PersonState,
    arm_keypoints,
    follow,
    joined_landmarks,
)
from bodysense.devices.video.pictures import Picture

HIGH, WIDE = 120, 200
MARK = {name: k for k, name in enumerate(BODY_LANDMARKS)}
RED, GREEN, GREY = (200, 40, 40), (40, 160, 60), (128, 128, 128)


def places(x: float, size: float = 0.3) -> np.ndarray:
    """Return landmarks (33, 2) of a person at x, arms out, their left toward +x; `size` is the trunk's length."""
    at = np.tile([x, 0.1], (len(BODY_LANDMARKS), 1))
    for sign, side in zip((1, -1), SIDES, strict=True):
        parts = {"shoulder": (0.3, 0.5), "elbow": (0.7, 0.5), "wrist": (1.1, 0.5), "hip": (0.2, -0.5)}
        for part, (across, up) in parts.items():
            at[MARK[f"{side}_{part}"]] = x + sign * across * size, 0.1 + up * size
    return at


def bodies(*people: np.ndarray) -> Bodies:
    world = np.random.default_rng(0).normal(size=(len(people), len(BODY_LANDMARKS), 3))
    return Bodies(world, np.array(people).reshape(-1, len(BODY_LANDMARKS), 2), np.ones(world.shape[:2]))


def hands(*found: tuple[np.ndarray, float]) -> HandLandmarks:
    """Return hands from pairs of a wrist's position (2,) and the probability of a left hand."""
    shape = np.random.default_rng(1).uniform(-0.04, 0.04, (21, 2))
    shape[0] = 0
    picture = np.array([wrist + shape for wrist, _ in found]).reshape(-1, 21, 2)
    return HandLandmarks(np.ones((*picture.shape[:2], 3)), picture, np.array([left for _, left in found]))


def picture(time: float, *people: tuple[np.ndarray, tuple[int, int, int]]) -> Picture:
    """Return a picture of people in coloured clothes; the last one is in front."""
    pixels = np.full((HIGH, WIDE, 3), GREY, np.uint8)
    for at, color in people:
        trunk = at[[MARK[f"{side}_{part}"] for side in SIDES for part in ("shoulder", "hip")]]
        x, y = trunk[:, 0] * HIGH + WIDE / 2, (0.5 - trunk[:, 1]) * HIGH
        pixels[max(int(y.min()), 0) : int(y.max()), max(int(x.min()), 0) : max(int(x.max()), 0)] = color
    return Picture(time, pixels)


def wrist(at: np.ndarray, side: str) -> np.ndarray:
    return at[MARK[f"{side}_wrist"]]


def chosen(row: PersonLandmarks) -> float:
    """Return the horizontal position of the person's trunk."""
    return float(row.picture[0, [MARK["left_hip"], MARK["right_hip"]], 0].mean())


def test_the_largest_person_is_chosen_and_kept() -> None:
    state = PersonState()
    for k in range(20):
        near, far = places(-0.4, 0.3), places(0.4, 0.2 + 0.01 * k)
        row, state = follow(picture(k / 30, (near, RED), (far, RED)), bodies(far, near), hands(), state)
        assert chosen(row) == pytest.approx(-0.4)


@pytest.mark.parametrize(
    ("mine", "other", "hidden"),
    [(RED, RED, False), (RED, RED, True), (RED, GREEN, True)],
    ids=["seen", "hidden", "clothes"],
)
def test_a_person_is_kept_when_two_cross(mine: tuple[int, int, int], other: tuple[int, int, int], hidden: bool) -> None:
    rng, state, row = np.random.default_rng(0), PersonState(), None
    for k in range(61):
        x = -0.6 + 0.02 * k
        # The other person crosses in front.
        a, b = (places(at, size) + rng.normal(0, 0.003, 2) for at, size in ((x, 0.3), (-x, 0.29)))
        people = [b] if hidden and abs(x) < 0.08 else [b, a] if k % 2 else [a, b]
        row, state = follow(picture(k / 30, (a, mine), (b, other)), bodies(*people), hands(), state)
        if row.has_body[0] and abs(x) > 0.15:
            assert chosen(row) == pytest.approx(x, abs=0.02), f"frame {k}"
    assert row is not None and row.has_body[0]


def test_another_person_is_chosen_after_three_seconds() -> None:
    _, state = follow(picture(0.0, (places(-0.5), RED)), bodies(places(-0.5)), hands(), PersonState())
    found = []
    for time in (0.1, 1.0, 2.9, 3.2):
        row, state = follow(picture(time, (places(0.5), GREEN)), bodies(places(0.5)), hands(), state)
        found.append(bool(row.has_body[0]))
    assert found == [False, False, False, True]


@pytest.mark.parametrize(("away", "shift"), [(0.2, 0.0), (0.4, 0.35), (1.0, 0.35)])
def test_a_person_who_jumps_out_of_view_is_found_at_once(away: float, shift: float) -> None:
    """The person leaves the ground at 3 m/s; their trunk is 0.5 m long."""
    state, row = PersonState(), None
    for k in range(12):
        at = places(0.0) + np.array([0.0, max(k - 8, 0) / 30 * 3.0 * 0.6])
        _, state = follow(picture(k / 30, (at, RED)), bodies(at), hands(), state)
    back, found = 11 / 30 + away, []
    for k in range(10):
        at = places(shift)
        row, state = follow(picture(back + k / 30, (at, RED)), bodies(at), hands(), state)
        found.append(bool(row.has_body[0]))
    assert all(found[9:]) and found.index(True) / 30 <= 0.3


def numbered(state: PersonState, time: float) -> dict[int, float]:
    return {one.number: round(float(one.place[0]), 2) for one in state.seen_at(time)}


def test_people_are_numbered_from_left_to_right_and_keep_their_numbers() -> None:
    state = PersonState()
    left, right = places(-0.5, 0.2), places(0.3, 0.3)
    for k in range(10):
        people = (right, left) if k % 2 else (left, right)
        _, state = follow(picture(k / 30, (left, RED), (right, GREEN)), bodies(*people), hands(), state)
        assert numbered(state, k / 30) == {1: -0.5, 2: 0.3}
    late = places(-0.1, 0.2)
    _, state = follow(picture(0.4, (left, RED), (right, GREEN)), bodies(late, left, right), hands(), state)
    assert numbered(state, 0.4) == {1: -0.5, 2: 0.3, 3: -0.1}


def test_the_person_with_the_given_number_is_followed() -> None:
    for number, x_of_number in ((1, -0.5), (2, 0.3), (3, 0.0)):
        state, settings, found = PersonState(), PersonSettings(number=number), []
        left, right, late = places(-0.5, 0.2), places(0.3, 0.3), places(0.0, 0.1)
        for k in range(20):
            drawn = [left, right] if k < 10 else [late, left, right]
            row, state = follow(picture(k / 30, (left, RED), (right, GREEN)), bodies(*drawn), hands(), state, settings)
            found.append(row.has_body[0])
            assert not row.has_body[0] or chosen(row) == pytest.approx(x_of_number)
        assert all(found[10:]) and all(found) == (number < 3)


def test_a_numbered_person_is_waited_for() -> None:
    state, settings, found = PersonState(), PersonSettings(number=2), []
    left, right = places(-0.5), places(0.5)
    for time in np.arange(0, 9, 0.1):
        drawn = [left] if 1 < time < 7 else [left, right]
        clothes = [(left, RED)] if 1 < time < 7 else [(left, RED), (right, GREEN)]
        row, state = follow(picture(time, *clothes), bodies(*drawn), hands(), state, settings)
        found.append((time, bool(row.has_body[0])))
    assert all(seen == (time <= 1.05 or time >= 6.95) for time, seen in found)


def test_no_person_is_found_in_an_empty_picture() -> None:
    row, state = follow(picture(0.0), bodies(), hands(), PersonState())
    assert not row.has_body.any() and not row.has_hand.any() and np.isnan(row.world).all()
    assert state.person is None
    keypoints = arm_keypoints(row)
    assert not keypoints.has_arm.any() and not keypoints.has_torso.any()


def matched(*found: tuple[np.ndarray, float], others: tuple[np.ndarray, ...] = ()) -> PersonLandmarks:
    at = places(0.0)
    drawn = picture(0.0, *((other, GREEN) for other in others), (at, RED))
    return follow(drawn, bodies(at, *others), hands(*found), PersonState())[0]


def test_hands_are_assigned_to_their_arms() -> None:
    at = places(0.0)
    left, right = wrist(at, "left") + 0.01, wrist(at, "right") - 0.01
    # This holds in any order, and if the detector confuses the side of one hand.
    for found in ([(left, 0.9), (right, 0.1)], [(right, 0.1), (left, 0.9)], [(left, 0.2), (right, 0.1)]):
        row = matched(*found)
        np.testing.assert_allclose(row.hand[0, :, 0], [left, right])
        assert row.has_hand.all()


def test_hands_that_meet_are_distinguished_by_their_side() -> None:
    at = places(0.0)
    at[[MARK["left_wrist"], MARK["right_wrist"]]] = [[0.02, 0.1], [-0.02, 0.1]]
    found = hands((np.array([-0.01, 0.1]), 0.95), (np.array([0.02, 0.16]), 0.05))
    row, _ = follow(picture(0.0, (at, RED)), bodies(at), found, PersonState())
    np.testing.assert_allclose(row.hand[0, :, 0], [[-0.01, 0.1], [0.02, 0.16]])


def test_a_hand_found_twice_is_used_once() -> None:
    at = places(0.0)
    at[[MARK["left_wrist"], MARK["right_wrist"]]] = [[0.02, 0.1], [-0.02, 0.1]]
    found = hands((np.array([0.02, 0.1]), 0.9), (np.array([0.021, 0.1]), 0.9))
    row, _ = follow(picture(0.0, (at, RED)), bodies(at), found, PersonState())
    assert row.has_hand.tolist() == [[True, False]]


def test_distant_hands_and_those_of_others_are_ignored() -> None:
    assert not matched((np.array([0.0, -0.4]), 0.9)).has_hand.any()
    other = places(0.65)  # their right wrist is next to the person's left one
    theirs = wrist(other, "right")
    assert np.linalg.norm(theirs - wrist(places(0.0), "left")) < 0.1
    row = matched((theirs, 0.05), others=(other,))
    assert not row.has_hand.any()


def test_key_points_follow_from_landmarks() -> None:
    rows = joined_landmarks([matched((wrist(places(0.0), "right"), 0.1)), matched()])
    keypoints = arm_keypoints(rows)
    assert keypoints.has_hand.tolist() == [[False, True], [False, False]]
    assert keypoints.has_arm.all() and keypoints.has_torso.all()
    for number, side in enumerate(SIDES):
        elbow, at_wrist = (rows.world[0, MARK[f"{side}_{part}"]] for part in ("elbow", "wrist"))
        forearm = (at_wrist - elbow) / np.linalg.norm(at_wrist - elbow)
        np.testing.assert_allclose(keypoints.arm[0, number, 1], forearm, atol=1e-12)
    rows.visible[0, MARK["left_wrist"]] = 0.2
    assert arm_keypoints(rows).has_arm.tolist() == [[False, True], [True, True]]
