"""Both arms with their hands."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.arms import ARM_JOINTS, CHEST, HAND_POINTS, arm_rotations, arm_skeleton, with_arms
from bodysense.body.body_joints import body_skeleton
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import normalize, quaternion_conjugate, quaternion_rotate


def random_pose(batch: tuple[int, ...], seed: int = 0) -> Pose:
    rng, skeleton = np.random.default_rng(seed), default_skeleton()
    rotation = normalize(rng.standard_normal((*batch, len(skeleton.joints), 4)))
    return Pose(skeleton, rng.standard_normal((*batch, 3)), rotation)


def test_arm_joints_are_in_the_order_of_the_body() -> None:
    assert len(ARM_JOINTS) == 38 and len(set(ARM_JOINTS)) == 38 and len(set(HAND_POINTS)) == 21
    order = default_skeleton().indices(ARM_JOINTS)
    assert (np.diff(order.reshape(2, 19)[:, :4]) > 0).all() and (np.diff(order.reshape(2, 19)[:, 4:]) == 1).all()


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_the_arm_skeleton_has_the_arm_positions_of_the_body(batch: tuple[int, ...]) -> None:
    pose, alone = random_pose(batch), arm_skeleton(default_skeleton())
    position, world = forward_kinematics(pose)
    chest = pose.skeleton.index(CHEST)
    identity = np.broadcast_to([1.0, 0, 0, 0], (*batch, 1, 4))
    rotation = np.concatenate([identity, arm_rotations(pose)], axis=-2)
    ours, _ = forward_kinematics(Pose(alone, np.zeros((*batch, 3)), rotation))
    from_chest = position[..., pose.skeleton.indices(alone.points), :] - position[..., chest, None, :]
    away = quaternion_conjugate(world[..., chest, :])[..., None, :]
    np.testing.assert_allclose(ours, quaternion_rotate(away, from_chest), atol=1e-12)


def test_with_arms_replaces_the_arms_of_a_body() -> None:
    pose, standing = random_pose((5,)), standing_pose(default_skeleton())
    dressed = with_arms(standing, arm_rotations(pose))
    np.testing.assert_array_equal(arm_rotations(dressed), arm_rotations(pose))
    others = np.setdiff1d(np.arange(52), default_skeleton().indices(ARM_JOINTS))
    np.testing.assert_array_equal(dressed.rotation[:, others], np.tile(standing.rotation[others], (5, 1, 1)))


def test_a_skeleton_without_hands_is_refused() -> None:
    with pytest.raises(BodysenseError, match="unknown joint 'left_index1'"):
        arm_skeleton(body_skeleton(default_skeleton()))
