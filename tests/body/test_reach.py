"""Two-bone inverse kinematics: ends reach targets; bones keep lengths, hands and feet keep rotations."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.footing import side_clearance
from bodysense.body.pose import forward_kinematics, rest_pose
from bodysense.body.reach import reach
from bodysense.body.retarget import leg_length, transfer_motion
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip

ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")


@pytest.mark.parametrize("end", ENDS)
def test_the_end_reaches_its_target(waving_clip: Clip, end: str) -> None:
    pose, k = waving_clip.pose, waving_clip.pose.skeleton.index(end)
    position, rotation = forward_kinematics(pose)
    target = position[:, k] + [0.02, 0.05, -0.03]
    moved, turned = forward_kinematics(reach(pose, end, target))
    inside = np.linalg.norm(target - position[:, pose.skeleton.parents[pose.skeleton.parents[k]]], axis=-1)
    near = inside < 0.999 * pose.skeleton.bone_length[[k, pose.skeleton.parents[k]]].sum()
    assert near.any()
    np.testing.assert_allclose(moved[near, k], target[near], atol=1e-9)
    assert geodesic_angle(turned[:, k], rotation[:, k]).max() < 1e-7


def test_knees_and_elbows_bend_in_the_possible_direction() -> None:
    """From a straight T-pose knees bend forward and elbows backward."""
    skeleton = default_skeleton()
    pose = rest_pose(skeleton)
    position = forward_kinematics(pose)[0]
    knee, elbow = skeleton.index("left_knee"), skeleton.index("left_elbow")
    raised = reach(pose, "left_ankle", position[skeleton.index("left_ankle")] + [0, 0.15, 0])
    assert forward_kinematics(raised)[0][knee, 2] > position[knee, 2] + 0.05
    pulled = reach(pose, "left_wrist", position[skeleton.index("left_wrist")] - [0.1, 0, 0])
    assert forward_kinematics(pulled)[0][elbow, 2] < position[elbow, 2] - 0.05


def test_limbs_stretch_toward_targets_out_of_reach(waving_clip: Clip) -> None:
    found = reach(waving_clip.pose, "left_wrist", np.full((90, 3), [5.0, 1.0, 0.0]))
    assert np.isfinite(forward_kinematics(found)[0]).all()


def test_transfer_keeps_feet_on_the_floor_and_hands_in_place(waving_clip: Clip) -> None:
    pose = waving_clip.pose
    for offset in sample_bodies("test", 3):
        body = pose.skeleton.with_offsets(offset)
        found, scale = transfer_motion(pose, body), leg_length(body) / leg_length(pose.skeleton)
        before, after = forward_kinematics(pose)[0], forward_kinematics(found)[0]
        for side in ("left", "right"):
            wrist, shoulder = body.index(f"{side}_wrist"), body.index(f"{side}_shoulder")
            away = np.linalg.norm(after[:, wrist] - scale * before[:, wrist], axis=-1)
            arm = body.bone_length[[wrist, body.parents[wrist]]].sum()
            stretched = np.linalg.norm(after[:, wrist] - after[:, shoulder], axis=-1) > 0.999 * arm
            assert away[~stretched].max(initial=0) < 1e-6 and away.max() < 0.08
            lowest = side_clearance(after, body, side) - scale * side_clearance(before, pose.skeleton, side)
            assert np.abs(lowest).max() < 0.03
