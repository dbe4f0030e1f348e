"""Motions for the tests of the data room: random ones on our joints, and the same as other programs store them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics, local_rotation, rest_pose
from bodysense.body.rotation import quaternion_canonical, quaternion_conjugate, quaternion_exp, quaternion_multiply
from bodysense.body.rotation import quaternion_rotate as rotate
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.data.clip import Clip

MakeClip = Callable[..., Clip]
Reframe = Callable[..., Clip]


@pytest.fixture
def make_clip() -> MakeClip:
    def make(frames: int = 12, seed: int = 0, spread: float = 0.5, rate: float = 30.0) -> Clip:
        rng = np.random.default_rng(seed)
        skeleton = default_skeleton()
        knots = rng.normal(scale=spread, size=(4, len(skeleton.joints), 3))
        place = np.linspace(0, 2.999, frames)
        before, t = place.astype(int), (place % 1)[:, None, None]
        rotation = quaternion_exp((1 - t) * knots[before] + t * knots[before + 1])
        root = np.array([0.3, 0.95, -0.2]) + np.cumsum(rng.normal(scale=0.01, size=(frames, 3)), axis=0)
        return Clip(f"random_{seed}", Pose(skeleton, root, quaternion_canonical(rotation)), rate)

    return make


@pytest.fixture
def reframe() -> Reframe:
    """The same motion on a skeleton whose rest pose is another: `rest` gives local rotations {joint: (4,)} of it."""

    def change(clip: Clip, rest: Mapping[str, np.ndarray], names: Mapping[str, str] | None = None) -> Clip:
        skeleton = clip.pose.skeleton
        pose = rest_pose(skeleton)
        for joint, turn in rest.items():
            pose.rotation[skeleton.index(joint)] = turn
        frame = forward_kinematics(pose)[1]
        parents = np.array(skeleton.parents)
        offset = skeleton.rest_offset.copy()
        offset[1:] = rotate(frame[parents[1:]], skeleton.rest_offset[1:])
        world = quaternion_multiply(forward_kinematics(clip.pose)[1], quaternion_conjugate(frame))
        names = names or {}
        renamed = Skeleton(
            tuple(names.get(joint, joint) for joint in skeleton.joints), skeleton.end_sites, skeleton.parents, offset
        )
        return Clip(clip.name, Pose(renamed, clip.pose.root_position, local_rotation(renamed, world)), clip.frame_rate)

    return change
