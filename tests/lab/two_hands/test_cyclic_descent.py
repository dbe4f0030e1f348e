"""Cyclic coordinate descent: it reaches goals, or the nearest possible point, and keeps limits."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from bodysense.body.hands.hand import FINGERS, HAND_JOINTS, joint_bases, limits, rotations_of
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense_lab.papers.two_hands.score.baselines import FingerLimits, solve_fingers


def posed(hand: Skeleton, angles: np.ndarray) -> np.ndarray:
    """Points (N, 21, 3) of angles (N, 26), from the wrist."""
    turns = np.asarray(rotations_of(angles))
    wrist = np.zeros((len(turns), 1, 4))
    wrist[..., 0] = 1.0
    return forward_kinematics(Pose(hand, np.zeros((len(turns), 3)), np.concatenate([wrist, turns], axis=1)))[0]


def test_without_limits_tips_reach_every_place_that_fingers_reach(hand: Skeleton) -> None:
    low, high = limits()
    angles = np.random.default_rng(1).uniform(low, high, (40, 26))
    true, tips = posed(hand, angles), hand.indices([f"{finger}_tip" for finger in FINGERS])
    solved = solve_fingers(hand, true[:, tips], rounds=200)
    missed = np.linalg.norm(solved[:, tips] - true[:, tips], axis=-1)
    assert missed.mean() < 1e-3
    bones = [[hand.index(f"{finger}{k}") for k in ("1", "2", "3", "_tip")] for finger in FINGERS]
    lengths = np.linalg.norm(np.diff(solved[:, bones], axis=2), axis=-1)
    assert np.allclose(lengths, np.linalg.norm(hand.rest_offset[bones][:, 1:], axis=-1))


def test_a_tip_at_its_goal_does_not_move(hand: Skeleton) -> None:
    rest = hand.path @ hand.rest_offset
    tips = hand.indices([f"{finger}_tip" for finger in FINGERS])
    for bounds in (None, FingerLimits()):
        assert np.allclose(solve_fingers(hand, rest[None, tips], bounds), rest, atol=1e-9)


def test_a_straight_finger_points_at_a_goal_out_of_reach(hand: Skeleton) -> None:
    rest = hand.path @ hand.rest_offset
    bases = rest[hand.indices([f"{finger}1" for finger in FINGERS])]
    goal = bases + np.array([0.2, -0.3, 0.05])
    solved = solve_fingers(hand, goal[None], rounds=100)[0]
    tips = solved[hand.indices([f"{finger}_tip" for finger in FINGERS])]
    reach = [
        sum(np.linalg.norm(hand.rest_offset[hand.indices([f"{f}2", f"{f}3", f"{f}_tip"])], axis=1)) for f in FINGERS
    ]
    away = np.linalg.norm(goal - bases, axis=1)
    assert np.allclose(np.linalg.norm(goal - tips, axis=1), away - reach, atol=2e-3)


def test_limits_are_kept(hand: Skeleton) -> None:
    bounds = FingerLimits()
    goal = (hand.path @ hand.rest_offset)[hand.indices([f"{finger}1" for finger in FINGERS])]
    goal = goal + np.random.default_rng(2).uniform(-0.09, 0.09, (60, 5, 3))
    solved = solve_fingers(hand, goal, bounds)
    basis = Rotation.from_quat(np.roll(np.array(joint_bases()), -1, axis=1))
    for place, finger in enumerate(FINGERS):
        chain = hand.indices([f"{finger}{k}" for k in ("1", "2", "3", "_tip")])
        vectors = np.diff(solved[:, chain], axis=1)
        rest = hand.rest_offset[chain][1:]
        for k in (1, 2):  # hinges: the angle between bones is at most that at rest and the hinge's range
            between = np.degrees(_angle(vectors[:, k - 1], vectors[:, k]))
            still = np.degrees(_angle(rest[k - 1], rest[k]))
            assert between.max() <= 90 + still + 1e-6
        first = basis[HAND_JOINTS.index(f"{finger}1") - 1].inv()
        turned = first.apply(vectors[:, 0])
        start = first.apply(rest[0])
        # Flexion and abduction within 45° each: nothing turns a bone by more than both together, and the twist.
        assert np.degrees(_angle(turned, start)).max() <= np.degrees(np.arccos(np.cos(np.pi / 4) ** 2)) + 20 + 1e-6, (
            place
        )


def test_one_hinge_is_as_near_as_scipys_optimum(hand: Skeleton) -> None:
    """With base joints held, both hinges of a finger against a search over their angles from many starts."""
    bounds = FingerLimits(flexion=1e-9, abduction=1e-9, twist=1e-9)
    low, high = np.radians(bounds.hinge)
    chain = hand.indices(["index1", "index2", "index3", "index_tip"])
    bases = Rotation.from_quat(np.roll(np.array(joint_bases()), -1, axis=1))
    axes = [bases[HAND_JOINTS.index(name) - 1].apply([0.0, 0, -1]) for name in ("index2", "index3")]
    bones = hand.rest_offset[chain]

    def tip(angles: np.ndarray) -> np.ndarray:
        second = Rotation.from_rotvec(angles[0] * axes[0])
        third = second * Rotation.from_rotvec(angles[1] * axes[1])
        return bones[0] + bones[1] + second.apply(bones[2]) + third.apply(bones[3])

    rng = np.random.default_rng(3)
    goals = np.stack([tip(angles) for angles in rng.uniform(low, high, (3, 2))]) + rng.normal(0, 0.003, (3, 3))
    rest = (hand.path @ hand.rest_offset)[hand.indices([f"{finger}_tip" for finger in FINGERS])]
    every = np.repeat(rest[None], len(goals), axis=0)
    every[:, FINGERS.index("index")] = goals
    solved = solve_fingers(hand, every, bounds, rounds=200)[:, chain[-1]]
    for goal, ours in zip(goals, solved, strict=True):
        missed = partial(lambda goal, angles: tip(angles) - goal, goal)
        starts = rng.uniform(low, high, (3, 2))
        best = min(np.linalg.norm(least_squares(missed, start, bounds=(low, high)).fun) for start in starts)
        assert np.linalg.norm(ours - goal) <= best + 5e-4


def _angle(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.arctan2(np.linalg.norm(np.cross(a, b), axis=-1), (a * b).sum(axis=-1))
