"""Offsets from head and wrists do not depend on where the body stands or faces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.resting import hand_length, local_offset, resting_offset
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import normalize

SKELETON = default_skeleton()
HEAD = SKELETON.index("head")


def some_pose(seed: int, batch: tuple[int, ...] = (3,)) -> Pose:
    rng = np.random.default_rng(seed)
    rotation = normalize(rng.normal(size=(*batch, len(SKELETON.joints), 4)) + np.array([2.0, 0, 0, 0]))
    return Pose(SKELETON, rng.normal(size=(*batch, 3)), rotation)


@pytest.mark.parametrize("batch", [(), (1,), (2, 3)])
def test_batches(batch: tuple[int, ...]) -> None:
    position, rotation = forward_kinematics(some_pose(1, batch))
    offset = local_offset(SKELETON, position, rotation)
    assert offset.shape == position.shape
    np.testing.assert_array_equal(offset[..., HEAD, :], 0)


@settings(max_examples=20)
@given(seed=st.integers(0, 999), yaw=st.floats(-np.pi, np.pi))
def test_a_turned_body_has_the_same_offsets(seed: int, yaw: float) -> None:
    pose = some_pose(seed)
    turn = Rotation.from_rotvec([0, yaw, 0])
    rotation = pose.rotation.copy()
    rotation[:, 0] = (turn * Rotation.from_quat(rotation[:, 0], scalar_first=True)).as_quat(scalar_first=True)
    turned = Pose(SKELETON, turn.apply(pose.root_position) + np.array([1, 2, 3]), rotation)
    offset, other = (local_offset(SKELETON, *forward_kinematics(one)) for one in (pose, turned))
    np.testing.assert_allclose(offset, other, atol=1e-9)


def test_fingers_are_rigid_in_the_axes_of_their_wrist() -> None:
    """A knuckle has a constant offset from its wrist."""
    offset = local_offset(SKELETON, *forward_kinematics(some_pose(1)))
    for name in ("left_index1", "right_thumb1"):
        point = SKELETON.index(name)
        np.testing.assert_allclose(offset[:, point], np.tile(SKELETON.rest_offset[point], (3, 1)), atol=1e-12)


def test_a_resting_body() -> None:
    rest = resting_offset(SKELETON)
    assert rest[SKELETON.index("pelvis"), 1] < -0.4, "below the head"
    left, right = (rest[SKELETON.index(f"{side}_middle_tip")] for side in ("left", "right"))
    np.testing.assert_allclose(left * [-1, 1, 1], right, atol=2e-3)
    assert 0.05 < hand_length(SKELETON) < 0.12
    np.testing.assert_allclose(hand_length(SKELETON.scaled(3.0)) / hand_length(SKELETON), 3.0 / SKELETON.height)
