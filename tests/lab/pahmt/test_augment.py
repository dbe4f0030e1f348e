"""Augmentation of arms: arms of other clips, and slow random offsets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.arms import ARM_JOINTS, arm_rotations
from bodysense.body.pose import Pose
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.clip import Clip
from bodysense_lab.data.augment import mirrored
from bodysense_lab.papers.pahmt.recordings import with_arms_of, with_wandering_arms


def first(clip: Clip, frames: int) -> Clip:
    return replace(clip, pose=Pose(clip.pose.skeleton, clip.pose.root_position[:frames], clip.pose.rotation[:frames]))


def not_of_arms(clip: Clip) -> np.ndarray:
    joints = clip.pose.skeleton.joints
    return clip.pose.rotation[:, [k for k, name in enumerate(joints) if name not in ARM_JOINTS]]


@pytest.mark.parametrize("frames", [1, 7, 200])
def test_arms_are_of_a_donor_or_its_mirror_image(waving_clip: Clip, frames: int) -> None:
    donor = first(waving_clip, frames) if frames < len(waving_clip) else waving_clip
    rng = np.random.default_rng(frames)
    for _ in range(4):
        other = with_arms_of(waving_clip, [donor], rng)
        np.testing.assert_array_equal(not_of_arms(other), not_of_arms(waving_clip))
        theirs = np.concatenate([arm_rotations(one.pose) for one in (donor, mirrored(donor))])
        for side in (slice(0, 19), slice(19, 38)):
            apart = geodesic_angle(arm_rotations(other.pose)[:, None, side], theirs[None, :, side]).max(axis=-1)
            assert apart.min(axis=1).max() < 1e-5  # every frame is one of theirs


def test_arms_wander_slowly_and_by_the_given_angle(waving_clip: Clip) -> None:
    rng = np.random.default_rng(1)
    recorded = arm_rotations(waving_clip.pose)
    same = with_wandering_arms(waving_clip, 0.0, rng)
    assert geodesic_angle(arm_rotations(same.pose), recorded).max() < 1e-6
    far = np.stack([arm_rotations(with_wandering_arms(waving_clip, 1.0, rng).pose) for _ in range(30)])
    angle = np.degrees(geodesic_angle(far, recorded))
    size = np.sqrt((angle**2).mean(axis=(0, 1)) / 3)  # deviation of one component
    shoulder, thumb = ARM_JOINTS.index("left_shoulder"), ARM_JOINTS.index("right_thumb2")
    assert size[shoulder] == pytest.approx(12.0, rel=0.25) and size[thumb] == pytest.approx(4.0, rel=0.25)
    assert np.degrees(geodesic_angle(far[:, 1:], far[:, :-1])).max() < 30  # of 30 Hz, waving included
    np.testing.assert_array_equal(not_of_arms(same), not_of_arms(waving_clip))
