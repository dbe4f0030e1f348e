"""Fingers as chains of matrices, against the general forward kinematics."""

from __future__ import annotations

import numpy as np

from bodysense.body.glove import default_glove
from bodysense.body.hand import FREEDOMS, default_axes, hand_skeleton, joint_rotations, limits, per_joint
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_conjugate, quaternion_log, quaternion_multiply, quaternion_to_matrix
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.finger_chains import FREE, HIGH, LOW, placed_fingers, turning_axes
from bodysense.devices.gloves.fingers import hand_shape

HAND = hand_skeleton(default_skeleton(), "left")


def random_rotations(count: int, seed: int) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(count, 16, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_hands_are_where_forward_kinematics_has_them() -> None:
    hands = [HAND, HAND.with_offsets(1.2 * HAND.rest_offset), HAND]
    rotation, root = random_rotations(3, seed=0), np.random.default_rng(1).normal(size=(3, 3))
    shape = hand_shape(hands, [default_glove()] * 3)
    placed = placed_fingers(shape, root, quaternion_to_matrix(rotation[:, 0]), rotation[:, 1:])
    offsets = np.stack([hand.rest_offset for hand in hands])
    expected, _ = forward_kinematics(Pose(HAND, root, rotation), offsets)
    np.testing.assert_allclose(placed.position, expected, atol=1e-12)


def test_ranges_of_angles_are_those_of_the_hand() -> None:
    for table, wanted in zip((LOW, HIGH), limits(), strict=True):
        np.testing.assert_array_equal(per_joint(wanted), table)
    assert FREE.sum() == len(FREEDOMS)


def test_axes_are_the_derivatives_of_rotations_by_angles() -> None:
    rng, step = np.random.default_rng(2), 1e-6
    angles, root, wrist = rng.uniform(-1, 1, (2, 15, 3)), np.zeros((2, 3)), random_rotations(2, seed=3)[:, 0]
    shape = hand_shape([HAND] * 2, [default_glove()] * 2)

    def world(angles: np.ndarray) -> np.ndarray:
        local = np.asarray(joint_rotations(angles, default_axes()))
        return forward_kinematics(Pose(HAND, root, np.concatenate([wrist[:, None], local], axis=1)))[1][:, 1:]

    local = joint_rotations(angles, default_axes())
    axes = turning_axes(placed_fingers(shape, root, quaternion_to_matrix(wrist), local), angles)
    for joint in range(15):
        for angle in range(3):
            change = np.zeros_like(angles)
            change[:, joint, angle] = step
            back = quaternion_conjugate(world(angles - change)[:, joint])
            turn = quaternion_log(quaternion_multiply(world(angles + change)[:, joint], back)) / (2 * step)
            np.testing.assert_allclose(axes[:, joint, angle], turn, atol=1e-6)
