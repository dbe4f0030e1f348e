"""All pairs of capsules at once, against the general functions, and how points on them move."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.glove import default_glove
from bodysense.body.hand import (
    Side,
    default_axes,
    hand_skeleton,
    joint_angles,
    joint_rotations,
    limits,
    rotations_of,
)
from bodysense.body.hand_capsules import mutual_depth, own_depth, own_pairs, placed_axes
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.contact_rows import ANGLES, PARTS, Ends, growth_rows, joined, tip_ends, tip_pairs
from bodysense.devices.gloves.finger_chains import placed_fingers, turning_axes
from bodysense.devices.gloves.fingers import hand_shape
from bodysense.devices.gloves.meetings import COUNT, HandFlesh, meet, points_on

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
def test_pairs_are_as_near_as_depth_says(seed: int) -> None:
    poses, flesh = two_poses(seed), HandFlesh(HANDS, SIDES)
    position = points(poses)
    pairs = flesh.pairs(position)
    meeting = meet(flesh.axes(position), pairs)
    depth = pairs.reach - np.sqrt(meeting.squared)
    count = len(own_pairs()[0])
    np.testing.assert_allclose(depth[:count], own_depth(poses[0]), atol=1e-9)
    np.testing.assert_allclose(depth[count : 2 * count], own_depth(poses[1]), atol=1e-9)
    np.testing.assert_allclose(depth[2 * count :], mutual_depth(*poses).ravel(), atol=1e-9)
    start, end = points_on(meeting.axes, pairs.start, np.stack(meeting.along))
    np.testing.assert_allclose(np.linalg.norm(end - start, axis=1) ** 2, meeting.squared, atol=1e-12)


def test_capsules_lie_where_the_hands_are() -> None:
    poses, flesh = two_poses(7), HandFlesh(HANDS, SIDES)
    axes = flesh.axes(points(poses)).reshape(2, 2, COUNT, 3)
    for hand, pose in enumerate(poses):
        for part, expected in zip(axes[hand], placed_axes(pose), strict=True):
            np.testing.assert_allclose(part, expected * FLIP[hand], atol=1e-12)


def test_hands_far_from_each_other_are_not_compared() -> None:
    flesh = HandFlesh(HANDS, SIDES)
    far, near = (flesh.pairs(points(two_poses(0, apart))) for apart in (0.5, 0.0))
    assert len(far.reach) == 2 * len(own_pairs()[0])
    assert len(near.reach) == len(far.reach) + COUNT**2


def test_rows_are_the_derivative() -> None:
    poses, shape, flesh = two_poses(2), hand_shape(HANDS, [default_glove()] * 2), HandFlesh(HANDS, SIDES)
    rotation, root = np.stack([pose.rotation for pose in poses]), np.stack([pose.root_position for pose in poses])
    wrist, angles = quaternion_to_matrix(rotation[:, 0]), joint_angles(rotation[:, 1:], default_axes())
    pairs = flesh.pairs(points(poses))
    rng = np.random.default_rng(3)
    chosen = rng.choice(len(pairs.reach), 20, replace=False)
    capsule, begin = pairs.capsule[:, chosen], pairs.start[:, chosen]
    along = rng.random((2, 20))
    tips = np.array([1, 7]), np.array([9, 8])  # index of the left, middle of the right, and of what they may touch
    toward = rng.normal(size=(20, 3))

    def ends(change: np.ndarray) -> tuple[Ends, Ends, np.ndarray]:
        changed = joint_rotations(angles + change[:, :ANGLES].reshape(angles.shape), default_axes())
        position = placed_fingers(shape, root + change[:, ANGLES:], wrist, changed).position
        axes, tip = flesh.axes(position), (position[:, 16:] * FLIP[:, None]).reshape(-1, 3)
        start, end = (
            joined(Ends(which, place), tip_ends(mine, tip[mine]))
            for which, place, mine in zip(capsule, points_on(axes, begin, along), tips, strict=True)
        )
        every = np.concatenate([toward, np.tile(np.eye(3), (2, 1))])
        return start, end, np.sum((end.point - start.point) * every, axis=1)

    nothing = np.zeros((2, PARTS))
    placed = placed_fingers(shape, root, wrist, rotation[:, 1:])
    start, end, _ = ends(nothing)
    every = np.concatenate([toward, np.tile(np.eye(3), (2, 1))])
    rows = growth_rows(placed, turning_axes(placed, angles), FLIP, start, end, every)
    assert rows.shape == (26, 2 * PARTS)
    for part in range(2 * PARTS):
        step = nothing.copy()
        step.reshape(-1)[part] = 1e-6
        expected = (ends(step)[2] - ends(-step)[2]) / 2e-6
        np.testing.assert_allclose(rows[:, part], expected, atol=1e-7)


def test_fingertips_that_can_pinch() -> None:
    pairs = tip_pairs(2)
    assert len(pairs) == len(set(pairs)) == 4 + 4 + 25
    assert (0, 1) in pairs and (5, 9) in pairs and (4, 9) in pairs
    assert (1, 2) not in pairs  # fingers of one hand lie side by side
    assert len(tip_pairs(1)) == 4
