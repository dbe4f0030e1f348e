"""Synthesised hands: joint limits, smooth paths, contacts, reproducibility and speed."""

from __future__ import annotations

import time

import numpy as np
import pytest

from bodysense.body.hands.glove import hand_size
from bodysense.body.hands.hand import FREEDOMS, angles_of, hand_skeleton, limits
from bodysense.body.hands.hand_capsules import hand_capsules, mutual_depth, own_depth
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle
from bodysense_lab.synthesis.gestures import NAMES, draw_key_poses, key_poses
from bodysense_lab.synthesis.hand_contact import PRESS_DEPTH, _measure_contacts, pose_hand, solve_contacts
from bodysense_lab.synthesis.hands import synthesize_hand, varied_hand
from bodysense_lab.synthesis.pairs import INTERACTIONS, synthesize_pair
from bodysense_lab.synthesis.paths import draw_timing, interpolate_keys, interpolate_rotations, minimum_jerk

HAND = hand_skeleton(default_skeleton(), "left")
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])


def test_angles_keep_to_the_limits_and_move_like_fingers() -> None:
    motion = synthesize_hand(HAND, 30.0, np.random.default_rng(0))
    angles = angles_of(motion.pose.rotation[:, 1:])
    low, high = limits()
    assert len(motion) == 1800 and (angles >= low - 1e-9).all() and (angles <= high + 1e-9).all()
    speed = np.abs(np.diff(angles, axis=0)) * motion.frame_rate
    assert np.degrees(speed.max()) < 2000, "no finger jumps"
    assert np.degrees(np.ptp(angles, axis=0)[[6, 9, 10]]).min() > 60, "index flexes in all its joints"
    flexion = {joint: angles[:, [row.joint for row in FREEDOMS].index(joint)] for joint in ("ring2", "ring3", "pinky2")}
    assert np.corrcoef(flexion["ring2"], flexion["ring3"])[0, 1] > 0.9, "the last joint follows the middle one"
    assert np.corrcoef(flexion["ring2"], flexion["pinky2"])[0, 1] > 0.5, "the little finger follows the ring finger"


@pytest.mark.parametrize("make", [synthesize_hand, lambda *given: synthesize_pair(*given)[1]])
def test_equal_seeds_give_equal_motion(make) -> None:
    first, again, other = (make(HAND, 3.0, np.random.default_rng(seed), 30.0) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.pose.rotation, again.pose.rotation)
    np.testing.assert_array_equal(first.pose.root_position, again.pose.root_position)
    assert len(first) == len(other) == 90 and not np.allclose(first.pose.rotation, other.pose.rotation)


def test_wrists_travel_no_faster_than_hands_do() -> None:
    for motion in (
        synthesize_hand(HAND, 30.0, np.random.default_rng(3)),
        *synthesize_pair(HAND, 30.0, np.random.default_rng(3)),
    ):
        step = np.linalg.norm(np.diff(motion.pose.root_position, axis=0), axis=1)
        turn = geodesic_angle(motion.pose.rotation[:-1, 0], motion.pose.rotation[1:, 0])
        assert 0.2 < step.max() * 60 < 4.0 and np.degrees(turn.max()) * 60 < 1500
        np.testing.assert_allclose(np.linalg.norm(motion.pose.rotation, axis=-1), 1, atol=1e-9)


def test_gestures_are_drawn_within_the_limits() -> None:
    keys = draw_key_poses(3000, np.random.default_rng(4))
    assert set(range(-1, 4)) == set(keys.finger.tolist())  # gestures without a touch, and of each finger
    low, high = limits()
    assert (keys.angles >= low).all() and (keys.angles <= high).all()
    fist = key_poses(np.full(50, NAMES.index("fist")), np.random.default_rng(5))
    flat = key_poses(np.full(50, NAMES.index("flat")), np.random.default_rng(5))
    assert (fist.angles[:, 9::5] > np.radians(60)).all() and (flat.angles[:, 9::5] < np.radians(45)).all()


def test_pinches_touch() -> None:
    """By forward kinematics, the centres of both tips are as far apart as their radii, less the press depth."""
    rng = np.random.default_rng(6)
    names = [name for name in NAMES if name.startswith("pinch")]
    keys = key_poses(np.array([NAMES.index(name) for name in names] * 4), rng)
    angles = solve_contacts(HAND, keys)
    capsules = hand_capsules(HAND)
    position, world = forward_kinematics(pose_hand(HAND, np.zeros(3), UNTURNED, angles))
    low, high = limits()
    assert (angles >= low).all() and (angles <= high).all()
    for k, name in enumerate(names * 4):
        finger = name.removeprefix("pinch_")
        ends = []
        for segment in ("thumb3", f"{finger}3"):
            place = capsules.names.index(segment)
            tip = position[k, HAND.index(segment.replace("3", "_tip"))]
            base = position[k, HAND.index(segment)]
            bone = capsules.end[place] / np.linalg.norm(HAND.rest_offset[HAND.index(segment.replace("3", "_tip"))])
            ends.append((base + (tip - base) * np.linalg.norm(bone), capsules.radius[place]))
        (thumb, thick), (other, thin) = ends
        assert np.linalg.norm(thumb - other) == pytest.approx((1 - PRESS_DEPTH) * (thick + thin), abs=1e-4), name
    np.testing.assert_array_equal(world[:, 0], np.broadcast_to(UNTURNED, (len(angles), 4)))


def test_touches_are_made_without_deep_overlaps() -> None:
    keys = draw_key_poses(120, np.random.default_rng(7))
    angles = solve_contacts(HAND, keys)
    touching = keys.finger >= 0
    gap = _measure_contacts(
        hand_capsules(HAND), HAND, angles[touching], keys.finger[touching], keys.place[touching]
    ).gap
    assert (np.abs(gap) < 1e-4).mean() > 0.98
    before, after = (own_depth(pose_hand(HAND, np.zeros(3), UNTURNED, of)).max(axis=-1) for of in (keys.angles, angles))
    assert (before > 0.002).mean() > 0.2 and (after > 0.002).mean() < 0.05
    possible = ~touching & (before <= 0)
    assert possible.any()
    np.testing.assert_array_equal(angles[possible], keys.angles[possible])


def test_paths_pass_through_their_keys_and_rest_at_held_keys() -> None:
    rng = np.random.default_rng(8)
    keys, turns = rng.normal(size=(9, 3)), rng.normal(size=(9, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    held = np.ones(9, dtype=bool)
    timing = draw_timing(np.full(8, 0.2), held, rng.uniform(0, 0.5, (8, 2)), rng)
    assert (timing.start < timing.end[:, None]).all() and (np.diff(timing.end) > 0).all()
    at = np.concatenate([[0.0], timing.end])
    np.testing.assert_allclose(interpolate_keys(at, timing, keys, np.array([0, 1, 1])), keys, atol=1e-12)
    np.testing.assert_allclose(interpolate_keys(at + 0.05, timing, keys, np.array([0, 1, 1])), keys, atol=1e-12)
    np.testing.assert_allclose(geodesic_angle(interpolate_rotations(at, timing, turns), turns), 0, atol=1e-6)


def test_paths_are_smooth_even_where_movements_overlap() -> None:
    rng = np.random.default_rng(9)
    keys = rng.normal(size=(40, 1))
    timing = draw_timing(np.zeros(39), np.zeros(40, dtype=bool), np.zeros((39, 1)), rng)
    assert (timing.start[1:, 0] < timing.end[:-1]).any(), "some begin before the last has ended"
    time_of = np.arange(0, timing.end[-1], 1e-3)
    speed = np.diff(interpolate_keys(time_of, timing, keys, np.zeros(1, dtype=int))[:, 0]) / 1e-3
    # At most two movements of minimum jerk overlap; the peak speed of each is 1.875 of its mean speed.
    fastest = 2 * 1.875 * np.abs(np.diff(keys[:, 0])).max() / (timing.end - timing.start[:, 0]).min()
    assert np.abs(speed).max() < fastest
    assert np.abs(np.diff(speed)).max() < 0.05 * np.abs(speed).max(), "speed does not jump"


def test_minimum_jerk_is_the_polynomial_of_flash_and_hogan() -> None:
    """The path is symmetric, has the published coefficients, and rests before and after."""
    share = np.linspace(0, 1, 201)
    path = minimum_jerk(share)
    np.testing.assert_allclose(path + path[::-1], 1, atol=1e-12)
    coefficients = np.polynomial.polynomial.polyfit(share, path, 5)
    np.testing.assert_allclose(coefficients, [0, 0, 0, 10, -15, 6], atol=1e-8)
    np.testing.assert_array_equal(minimum_jerk(np.array([-1.0, 2.0])), [0.0, 1.0])


def test_hands_meet_and_hardly_overlap() -> None:
    left, right = synthesize_pair(HAND, 30.0, np.random.default_rng(10))
    depth = mutual_depth(left.pose, right.pose).max(axis=(-2, -1))
    assert (left.side, right.side) == ("left", "right")
    assert ((depth > -0.003) & (depth < 0.001)).mean() > 0.05, "they touch"
    assert (depth < -0.05).mean() > 0.1, "and part"
    assert (depth > 0.001).mean() < 0.1 and depth.max() < 0.02, "they overlap rarely and little"


@pytest.mark.parametrize("name", [interaction.name for interaction in INTERACTIONS])
def test_hands_meet_in_every_interaction(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from bodysense_lab.synthesis import pairs as pair_synthesis

    monkeypatch.setattr(pair_synthesis, "INTERACTIONS", tuple(one for one in INTERACTIONS if one.name == name))
    left, right = synthesize_pair(HAND, 8.0, np.random.default_rng(11), 30.0)
    depth = mutual_depth(left.pose, right.pose).max(axis=(-2, -1))
    if name != "holding":
        assert depth.max() > -0.004, "they come together"


def test_varied_hands_differ_in_size_and_proportions() -> None:
    rng = np.random.default_rng(12)
    hands = [varied_hand(HAND, 0.05, rng) for _ in range(200)]
    size = np.log([hand_size(hand) / hand_size(HAND) for hand in hands])
    assert abs(size.mean()) < 0.02 and 0.03 < size.std() < 0.08
    bones = np.array([hand.bone_length[1:] / hand_size(hand) for hand in hands])
    assert (bones.std(axis=0) / bones.mean(axis=0)).min() > 0.01, "proportions differ, too"
    for hand in hands[:5]:  # fingers remain straight
        for finger in ("index", "middle", "ring", "pinky"):
            first, second = (hand.rest_offset[hand.index(f"{finger}{k}")] for k in (2, 3))
            assert np.linalg.norm(np.cross(first, second)) < 1e-9 + 0.1 * np.linalg.norm(first) * np.linalg.norm(second)
    np.testing.assert_array_equal(varied_hand(HAND, 0.0, rng).rest_offset, HAND.rest_offset)
    with pytest.raises(BodysenseError, match="spread of -1"):
        varied_hand(HAND, -1.0, rng)


@pytest.mark.parametrize(("seconds", "rate"), [(0.0, 60.0), (1.0, 0.0), (np.nan, 60.0), (0.001, 60.0), (1.0, np.inf)])
def test_motion_without_frames_is_refused(seconds: float, rate: float) -> None:
    for make in (synthesize_hand, synthesize_pair):
        with pytest.raises(BodysenseError, match="have no frame"):
            make(HAND, seconds, np.random.default_rng(0), rate)


def test_a_single_frame_is_possible() -> None:
    assert len(synthesize_hand(HAND, 0.02, np.random.default_rng(0))) == 1
    assert len(synthesize_pair(HAND, 0.02, np.random.default_rng(0))[0]) == 1


@pytest.mark.alone
@pytest.mark.slow
def test_synthesis_is_a_hundred_times_faster_than_real_time() -> None:
    begun = time.process_time()
    synthesize_hand(HAND, 60.0, np.random.default_rng(0))
    assert time.process_time() - begun < 0.6
