"""A rest pose from the motion: used if the file's own is unusable, and taken from the frame that stands best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from turned_joints import about, both

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.rigs.canonical import canonical
from bodysense.io.rigs.rest_pose import UPRIGHT, Stance, standing_rest

JOINTS = default_skeleton().joints
OURS = {name: name for name in default_skeleton().points}


def rest_of(clip: Clip) -> Stance:
    """The rest pose of a clip with our names."""
    return standing_rest(clip, {name: clip.pose.skeleton.index(name) for name in OURS})


@pytest.mark.parametrize("rest", [
    {}, both("shoulder", "Z", -45), both("shoulder", "Z", -85), both("hip", "Z", 15), both("knee", "X", 20),
    {"pelvis": about("Y", 180)},
], ids=["T", "A", "arms down", "legs apart", "knees bent", "facing back"])  # fmt: skip
def test_a_rest_pose_that_stands_is_good_enough(waving_clip, reframe, rest) -> None:
    assert rest_of(reframe(waving_clip, rest)).rest is None


def contorted(clip: Clip, reframe, seed: int) -> Clip:
    """The clip on a rig whose frames are turned at random."""
    rng = np.random.default_rng(seed)
    return reframe(clip, dict(zip(JOINTS, quaternion_exp(rng.normal(scale=1.5, size=(len(JOINTS), 3))), strict=True)))


@pytest.mark.parametrize("seed", range(8))
def test_the_frame_that_stands_best_is_taken(waving_clip, reframe, seed: int) -> None:
    """Frame 0 of that motion stands straight, with hanging arms: turned to any side, and moved to any place in it."""
    place = 5 * seed + 3
    order = np.roll(np.arange(len(waving_clip)), place)
    pose = waving_clip.pose[order]
    rotation = pose.rotation.copy()
    rotation[:, 0] = quaternion_multiply(about("Y", 45.0 * seed), rotation[:, 0])
    clip = replace(waving_clip, pose=Pose(pose.skeleton, pose.root_position, rotation))
    source = contorted(clip, reframe, seed)
    rest = rest_of(source).rest
    assert rest is not None
    assert geodesic_angle(rest.rotation, source.pose.rotation[place]).max() < 1e-9
    result = canonical(source, OURS, must_stand=True)
    there, here = (forward_kinematics(which.pose) for which in (clip, result))
    np.testing.assert_allclose(here[0], there[0], atol=1e-9)
    off = np.rad2deg(geodesic_angle(here[1], there[1]).max(axis=0))
    assert off[[JOINTS.index(name) for name in ("pelvis", "spine3", "head", "left_shoulder", "right_hip")]].max() < 1e-6
    assert off.max() < 25  # fingers hang curled in that frame, which is taken for straight


def test_a_motion_that_never_stands_is_reported(waving_clip, reframe) -> None:
    rotation = waving_clip.pose.rotation.copy()
    rotation[:, 0] = quaternion_multiply(about("X", 90.0), rotation[:, 0])
    lying = replace(waving_clip, pose=Pose(waving_clip.pose.skeleton, waving_clip.pose.root_position, rotation))
    assert rest_of(contorted(lying, reframe, 0)).torso > UPRIGHT
