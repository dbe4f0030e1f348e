"""Fingers as chains of matrices, against the general forward kinematics and scipy."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from bodysense.body.hand import angles_of, hand_skeleton, joint_bases, limits, rotations_of
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_canonical, quaternion_to_matrix
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.finger_chains import (
    FREE,
    HIGH,
    LOW,
    angles_of_rotations,
    finger_chains,
    placed_fingers,
    rotations_of_angles,
)

HAND = hand_skeleton(default_skeleton(), "left")


def random_rotations(count: int, seed: int) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(count, 16, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_hands_are_where_forward_kinematics_has_them() -> None:
    hands = [HAND, HAND.with_offsets(1.2 * HAND.rest_offset), HAND]
    rotation, root = random_rotations(3, seed=0), np.random.default_rng(1).normal(size=(3, 3))
    placed = placed_fingers(finger_chains(hands), root, quaternion_to_matrix(rotation[:, 0]), rotation[:, 1:])
    offsets = np.stack([hand.rest_offset for hand in hands])
    expected, _ = forward_kinematics(Pose(HAND, root, rotation), offsets)
    np.testing.assert_allclose(placed.position, expected, atol=1e-12)


def test_angles_are_those_of_the_hand() -> None:
    low, high = limits()
    angles = np.random.default_rng(2).uniform(low, high, size=(4, 26))
    rotation = rotations_of(angles)
    found = angles_of_rotations(rotation)
    np.testing.assert_allclose(found[:, FREE], angles, atol=1e-9)
    np.testing.assert_allclose(found[:, FREE], angles_of(rotations_of(angles)), atol=1e-9)
    np.testing.assert_allclose(found[:, ~FREE], 0, atol=1e-9)
    np.testing.assert_allclose(quaternion_canonical(rotations_of_angles(found)), rotation, atol=1e-12)
    np.testing.assert_array_equal(LOW[FREE], low)
    np.testing.assert_array_equal(HIGH[FREE], high)


def test_angles_are_found_whatever_else_a_joint_does() -> None:
    rotation = random_rotations(3, seed=6)[:, 1:]
    about = Rotation.from_quat(np.tile(joint_bases(), (3, 1)), scalar_first=True)
    own = about.inv() * Rotation.from_quat(rotation.reshape(-1, 4), scalar_first=True) * about
    expected = own.as_euler("ZYX").reshape(3, 15, 3) * [-1, 1, 1]
    np.testing.assert_allclose(angles_of_rotations(rotation), np.where(FREE, expected, 0), atol=1e-9)
