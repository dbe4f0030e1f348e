"""The 22 joints by themselves stand where the whole body has them."""

from __future__ import annotations

import numpy as np

from bodysense.body.body_joints import body_pose, body_skeleton, whole_pose
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.io.clip import Clip


def test_the_body_without_hands_keeps_positions_and_rotations(waving_clip: Clip) -> None:
    places = waving_clip.pose.skeleton.indices(BODY)
    for alone, whole in zip(
        forward_kinematics(body_pose(waving_clip.pose)), forward_kinematics(waving_clip.pose), strict=True
    ):
        np.testing.assert_allclose(alone, whole[:, places], atol=1e-12)


def test_whole_pose_restores_the_body(waving_clip: Clip) -> None:
    skeleton = waving_clip.pose.skeleton
    alone = body_pose(waving_clip.pose)
    whole = whole_pose(skeleton, alone.root_position, alone.rotation)
    position, rotation = forward_kinematics(whole)
    assert position.shape == (len(waving_clip), len(skeleton.points), 3)
    np.testing.assert_allclose(body_pose(whole).rotation, alone.rotation)
    np.testing.assert_allclose(rotation[:, skeleton.indices(BODY)], forward_kinematics(alone)[1], atol=1e-12)


def test_parents_come_first() -> None:
    skeleton = body_skeleton(default_skeleton())
    assert skeleton.joints == BODY and not skeleton.end_sites
    assert [skeleton.joints[skeleton.parents[k]] for k in skeleton.indices(["left_foot", "head", "right_wrist"])] == [
        *("left_ankle", "neck", "right_elbow"),
    ]
