"""Augmentation: mirrored clips, and rigid bones of other proportions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip, at_height
from bodysense_lab.data.augment import LIMBS, mirrored, with_limb_proportions


def lopsided(make_clip) -> Clip:
    """Return a clip of an asymmetric body."""
    clip = make_clip()
    scale = np.random.default_rng(3).uniform(0.9, 1.1, size=(65, 1))
    body = default_skeleton().with_offsets(default_skeleton().rest_offset * scale)
    return Clip("a", Pose(body, clip.pose.root_position, clip.pose.rotation), 30.0, "p", "sit", False)


def test_mirroring_commutes_with_forward_kinematics(make_clip) -> None:
    clip = lopsided(make_clip)
    other = mirrored(clip)
    position, rotation = forward_kinematics(clip.pose)
    partner = clip.pose.skeleton.mirror
    there, turned_there = forward_kinematics(other.pose)
    np.testing.assert_allclose(there, position[:, partner] * [-1, 1, 1], atol=1e-12)
    flip = np.diag([-1.0, 1, 1])
    ours = Rotation.from_quat(rotation[:, partner[:52]].reshape(-1, 4), scalar_first=True).as_matrix()
    theirs = Rotation.from_quat(turned_there.reshape(-1, 4), scalar_first=True).as_matrix()
    np.testing.assert_allclose(theirs, flip @ ours @ flip, atol=1e-12)
    assert (other.person, other.category, other.has_fingers) == ("p", "sit", False)


def test_mirroring_twice_gives_the_original(make_clip) -> None:
    clip = lopsided(make_clip)
    twice = mirrored(mirrored(clip))
    np.testing.assert_array_equal(twice.pose.rotation, clip.pose.rotation)
    np.testing.assert_array_equal(twice.pose.root_position, clip.pose.root_position)
    np.testing.assert_array_equal(twice.pose.skeleton.rest_offset, clip.pose.skeleton.rest_offset)


def test_other_proportions_are_rigid_symmetric_and_reproducible(make_clip) -> None:
    clip = make_clip()
    result = with_limb_proportions(clip, 0.05, np.random.default_rng(5))
    again = with_limb_proportions(clip, 0.05, np.random.default_rng(5))
    other = with_limb_proportions(clip, 0.05, np.random.default_rng(6))
    np.testing.assert_array_equal(result.pose.skeleton.rest_offset, again.pose.skeleton.rest_offset)
    assert np.abs(result.pose.skeleton.rest_offset - other.pose.skeleton.rest_offset).max() > 1e-3
    np.testing.assert_array_equal(result.pose.rotation, clip.pose.rotation)

    skeleton = result.pose.skeleton
    position = forward_kinematics(result.pose)[0]
    length = np.linalg.norm(position[:, 1:] - position[:, list(skeleton.parents[1:])], axis=-1)
    np.testing.assert_allclose(length, np.broadcast_to(skeleton.bone_length[1:], length.shape), atol=1e-12)
    np.testing.assert_allclose(skeleton.bone_length, skeleton.bone_length[skeleton.mirror], atol=1e-12)

    ratio = skeleton.bone_length[1:] / default_skeleton().bone_length[1:]
    assert len(np.unique(ratio.round(9))) == len(LIMBS)  # every bone belongs to a group
    assert np.abs(np.log(ratio)).max() <= 2.5 * 0.05 + 1e-12


def test_spread_is_a_standard_deviation_and_zero_changes_nothing(make_clip) -> None:
    clip = make_clip(frames=2)
    rng = np.random.default_rng(0)
    same = with_limb_proportions(clip, 0.0, rng)
    np.testing.assert_allclose(same.pose.skeleton.rest_offset, clip.pose.skeleton.rest_offset, atol=1e-12)
    np.testing.assert_allclose(same.pose.root_position, clip.pose.root_position, atol=1e-12)
    knee = default_skeleton().index("left_knee")
    lengths = [with_limb_proportions(clip, 0.05, rng).pose.skeleton.bone_length[knee] for _ in range(400)]
    assert np.std(np.log(lengths)) == pytest.approx(0.05, rel=0.12)


def test_feet_stay_on_the_ground(make_clip) -> None:
    clip = make_clip()
    clip.pose.rotation[:] = [1, 0, 0, 0]
    clip.pose.root_position[:] = default_skeleton().rest_offset[0]
    result = with_limb_proportions(clip, 0.08, np.random.default_rng(1))
    lowest = forward_kinematics(clip.pose)[0][..., 1].min(), forward_kinematics(result.pose)[0][..., 1].min()
    assert lowest[0] == pytest.approx(lowest[1], abs=0.003)


def test_the_path_is_scaled_with_the_body(make_clip) -> None:
    clip = make_clip()
    taller = at_height(clip, 1.2 * clip.pose.skeleton.height)
    np.testing.assert_allclose(taller.pose.root_position, 1.2 * clip.pose.root_position, rtol=1e-9)
