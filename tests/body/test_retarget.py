"""Retargeting keeps every bone, every rotation and the height of the soles above the floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.footing import sole_clearance
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.retarget import leg_length, retarget
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense_lab.data.augment import with_limb_proportions

SKELETON = default_skeleton()


def unseen_body(clip: Clip, seed: int) -> Skeleton:
    """Return another body with its soles on the floor."""
    skeleton = with_limb_proportions(clip, 0.1, np.random.default_rng(seed)).pose.skeleton
    offset = skeleton.rest_offset.copy()
    offset[0, 1] -= offset[0, 1] + (skeleton.path @ offset)[:, 1].min() - 0.01
    return skeleton.with_offsets(offset)


@pytest.mark.parametrize("batch", [(), (2,), (2, 3)])
def test_bones_rotations_and_clearance_are_kept(waving_clip: Clip, batch: tuple[int, ...]) -> None:
    pose = Pose(
        SKELETON,
        np.broadcast_to(waving_clip.pose.root_position, (*batch, 90, 3)),
        np.broadcast_to(waving_clip.pose.rotation, (*batch, 90, 52, 4)),
    )
    skeleton = unseen_body(waving_clip, 1)
    other = retarget(pose, skeleton)
    before, after = forward_kinematics(pose)[0], forward_kinematics(other)[0]
    assert other.skeleton is skeleton and after.shape == before.shape
    length = np.linalg.norm(after - after[..., [max(k, 0) for k in skeleton.parents], :], axis=-1)
    np.testing.assert_allclose(length, np.broadcast_to(skeleton.bone_length, length.shape), atol=1e-9)
    np.testing.assert_array_equal(other.rotation, pose.rotation)
    scale = leg_length(skeleton) / leg_length(SKELETON)
    np.testing.assert_allclose(
        sole_clearance(after, skeleton), scale * sole_clearance(before, SKELETON), rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(other.root_position[..., [0, 2]], scale * pose.root_position[..., [0, 2]], atol=1e-12)


def test_the_same_skeleton_changes_nothing(waving_clip: Clip) -> None:
    same = retarget(waving_clip.pose, SKELETON.with_offsets(SKELETON.rest_offset))
    np.testing.assert_array_equal(same.root_position, waving_clip.pose.root_position)
    np.testing.assert_array_equal(same.rotation, waving_clip.pose.rotation)


def test_there_and_back_is_the_same_motion(waving_clip: Clip) -> None:
    back = retarget(retarget(waving_clip.pose, unseen_body(waving_clip, 2)), SKELETON)
    np.testing.assert_allclose(back.root_position, waving_clip.pose.root_position, atol=1e-9)


@pytest.mark.parametrize("sink", [0.0, 0.03, -0.4])
def test_feet_are_never_deeper_than_before(waving_clip: Clip, sink: float) -> None:
    """Depths are compared at the scale of the legs; a jumping body stays in the air."""
    root = waving_clip.pose.root_position - [0.0, sink, 0.0]
    pose = replace(waving_clip.pose, root_position=root)
    skeleton = unseen_body(waving_clip, 3)
    scale = leg_length(skeleton) / leg_length(SKELETON)
    before = sole_clearance(forward_kinematics(pose)[0], SKELETON)
    after = sole_clearance(forward_kinematics(retarget(pose, skeleton))[0], skeleton)
    assert (after >= scale * before - 1e-9).all()
    assert sink >= 0 or after.min() > 0.2


def test_the_rest_pose_stands_on_the_floor(waving_clip: Clip) -> None:
    for skeleton in (SKELETON, unseen_body(waving_clip, 4)):
        position = forward_kinematics(rest_pose(skeleton))[0]
        assert sole_clearance(position, skeleton) == pytest.approx(0, abs=1e-12)
        raised = position.copy()
        raised[skeleton.index("left_toe")] -= [0.0, 0.02, 0.0]
        assert sole_clearance(raised + np.array([0.0, 0.5, 0.0]), skeleton) == pytest.approx(0.48)


def test_torch_gives_the_same(waving_clip: Clip) -> None:
    torch = pytest.importorskip("torch")
    skeleton = unseen_body(waving_clip, 5)
    pose = waving_clip.pose
    expected = retarget(pose, skeleton)
    given = Pose(SKELETON, torch.tensor(pose.root_position), torch.tensor(pose.rotation))
    np.testing.assert_allclose(retarget(given, skeleton).root_position.numpy(), expected.root_position, atol=1e-12)


def test_another_tree_is_refused(waving_clip: Clip) -> None:
    snake = Skeleton(("head", "tail"), (), (-1, 0), np.zeros((2, 3)))
    with pytest.raises(BodysenseError, match="two skeletons differ in names or parents"):
        retarget(waving_clip.pose, snake)
