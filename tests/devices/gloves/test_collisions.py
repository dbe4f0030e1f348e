"""Collision pairs of hands against the general functions, and derivatives of points on capsules."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove
from bodysense.body.hands.hand import (
    Side,
    default_axes,
    hand_skeleton,
    joint_angles,
    joint_rotations,
    limits,
    rotations_of,
)
from bodysense.body.hands.hand_capsules import axes_between, hand_capsules, mutual_depth, own_depth, own_pairs
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.collisions import COUNT, HandColliders
from bodysense.devices.gloves.contact_rows import ANGLES, PARTS, growth_rows, tip_capsules, tip_pairs, turning_axes
from bodysense.devices.gloves.fingers import HandPoses, hand_shape, place_hands
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply

SMALL = hand_skeleton(default_skeleton(), "left")
LARGE = SMALL.with_offsets(1.15 * SMALL.rest_offset)
HANDS = (SMALL, LARGE)
SIDES: tuple[Side, ...] = ("left", "right")
FLIP = np.array([[1.0, 1, 1], [-1, 1, 1]])


def two_poses(seed: int, apart: float = 0.0) -> list[Pose]:
    rng = np.random.default_rng(seed)
    low, high = limits()
    wrist = rng.normal(size=(2, 1, 4))
    wrist /= np.linalg.norm(wrist, axis=-1, keepdims=True)
    rotation = np.concatenate([wrist, rotations_of(rng.uniform(0.4 * low, 0.6 * high, size=(2, 26)))], axis=1)
    root = rng.normal(scale=0.02, size=(2, 3)) + np.array([apart, 0, 0])
    return [Pose(hand, root[k], rotation[k]) for k, hand in enumerate(HANDS)]


def points(poses: list[Pose]) -> np.ndarray:
    return np.stack([np.asarray(forward_kinematics(pose)[0]) for pose in poses])


@pytest.mark.parametrize("seed", range(2))
def test_overlaps_equal_those_of_hand_capsules(seed: int) -> None:
    poses, colliders = two_poses(seed), HandColliders(HANDS, SIDES)
    position = points(poses)
    pairs = colliders.pairs(position)
    nearest = colliders.nearest(position, pairs)
    depth = pairs.reach - nearest.distance
    count = len(own_pairs()[0])
    np.testing.assert_allclose(depth[:count], own_depth(poses[0]), atol=1e-9)
    np.testing.assert_allclose(depth[count : 2 * count], own_depth(poses[1]), atol=1e-9)
    np.testing.assert_allclose(depth[2 * count :], mutual_depth(*poses).ravel(), atol=1e-9)


def test_distant_hands_are_not_compared() -> None:
    colliders = HandColliders(HANDS, SIDES)
    far, near = (colliders.pairs(points(two_poses(0, apart))) for apart in (0.5, 0.0))
    assert len(far.reach) == 2 * len(own_pairs()[0])
    assert len(near.reach) == len(far.reach) + COUNT**2


def test_axes_are_the_derivatives_of_rotations_by_angles() -> None:
    rng, step = np.random.default_rng(2), 1e-6
    angles, root, wrist = rng.uniform(-1, 1, (2, 15, 3)), np.zeros((2, 3)), rng.normal(size=(2, 1, 4))
    wrist /= np.linalg.norm(wrist, axis=-1, keepdims=True)
    shape = hand_shape([SMALL] * 2, [default_glove()] * 2)

    def rotations(angles: np.ndarray) -> np.ndarray:
        return np.concatenate([wrist, joint_rotations(angles, default_axes())], axis=1)

    def world(angles: np.ndarray) -> np.ndarray:
        return forward_kinematics(Pose(SMALL, root, rotations(angles)))[1][:, 1:]

    axes = turning_axes(shape, place_hands(shape, root, rotations(angles)), angles)
    for joint in range(15):
        for angle in range(3):
            change = np.zeros_like(angles)
            change[:, joint, angle] = step
            back = quaternion_conjugate(world(angles - change)[:, joint])
            turn = quaternion_log(quaternion_multiply(world(angles + change)[:, joint], back)) / (2 * step)
            np.testing.assert_allclose(axes[:, joint, angle], turn, atol=1e-6)


def test_growth_rows_are_derivatives_of_distances() -> None:
    """The distance of points on capsules along directions changes with each part of a change."""
    poses, shape, colliders = two_poses(2), hand_shape(HANDS, [default_glove()] * 2), HandColliders(HANDS, SIDES)
    rotation, root = np.stack([pose.rotation for pose in poses]), np.stack([pose.root_position for pose in poses])
    angles = joint_angles(rotation[:, 1:], default_axes())
    pairs = colliders.pairs(points(poses))
    rng = np.random.default_rng(3)
    chosen = rng.choice(len(pairs.reach), 20, replace=False)
    tips = np.array([[1, 7], [9, 8]])  # left index and right middle finger, and the fingertips that they may touch
    capsule = np.concatenate([pairs.capsule[:, chosen], tip_capsules(tips)], axis=1)
    along, toward = rng.random((2, 22, 1)), rng.normal(size=(22, 3))
    share = np.stack([hand_capsules(hand).share for hand in HANDS])

    def changed(change: np.ndarray) -> tuple[HandPoses, np.ndarray]:
        """Return the hands after a change, and the points (2, 22, 3) m in the world."""
        local = joint_rotations(angles + change[:, :ANGLES].reshape(angles.shape), default_axes())
        hands = place_hands(shape, root + change[:, ANGLES:], np.concatenate([rotation[:, :1], local], axis=1))
        start, axis = (part.reshape(-1, 3)[capsule] for part in axes_between(hands.position * FLIP[:, None], share))
        place = start + along * axis
        place[:, 20:] = (hands.position[:, 16:] * FLIP[:, None]).reshape(-1, 3)[tips]
        return hands, place

    nothing = np.zeros((2, PARTS))
    hands, place = changed(nothing)
    rows = growth_rows(hands, turning_axes(shape, hands, angles), FLIP, capsule, place, toward)
    assert rows.shape == (22, 2 * PARTS)
    for part in range(2 * PARTS):
        step = nothing.copy()
        step.reshape(-1)[part] = 1e-6
        grown = changed(step)[1] - changed(-step)[1]
        expected = np.sum((grown[1] - grown[0]) * toward, axis=1) / 2e-6
        np.testing.assert_allclose(rows[:, part], expected, atol=1e-7)


def test_pairs_of_fingertips_that_can_pinch() -> None:
    pairs = tip_pairs(2)
    assert len(pairs) == len(set(pairs)) == 4 + 4 + 25
    assert (0, 1) in pairs and (5, 9) in pairs and (4, 9) in pairs
    assert (1, 2) not in pairs  # fingers of one hand lie side by side
    assert len(tip_pairs(1)) == 4
