"""VRM's humanoid: names, and postures relative to VRM's T-pose."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.humanoid import VRM_BONES, check_humanoid, t_posed, unity_bone

# VRM 1.0, humanoid: the bones a model must have.
REQUIRED = {"hips", "spine", "head"} | {
    f"{side}{bone}"
    for side in ("left", "right")
    for bone in ("UpperLeg", "LowerLeg", "Foot", "UpperArm", "LowerArm", "Hand")
}
# Which bone hangs on which, VRM 1.0, humanoid.
CHAINS = (
    ("hips", "spine", "chest", "upperChest", "neck", "head"),
    ("hips", "leftUpperLeg", "leftLowerLeg", "leftFoot", "leftToes"),
    ("upperChest", "leftShoulder", "leftUpperArm", "leftLowerArm", "leftHand"),
    ("leftHand", "leftThumbMetacarpal", "leftThumbProximal", "leftThumbDistal"),
    ("leftHand", "leftLittleProximal", "leftLittleIntermediate", "leftLittleDistal"),
)


def test_every_joint_is_a_bone_and_hangs_where_vrm_has_it() -> None:
    skeleton = default_skeleton()
    assert set(VRM_BONES) == set(skeleton.joints) and len(set(VRM_BONES.values())) == 52
    assert set(VRM_BONES.values()) >= REQUIRED
    parent = {
        VRM_BONES[name]: VRM_BONES.get(skeleton.joints[skeleton.parents[k]]) for k, name in enumerate(skeleton.joints)
    }
    for chain in CHAINS:
        for side in ("left", "right"):
            names = [name.replace("left", side) for name in chain]
            assert [parent[name] for name in names[1:]] == names[:-1]


@pytest.mark.parametrize(
    ("vrm", "unity"),
    [
        ("hips", "Hips"),
        ("upperChest", "UpperChest"),
        ("leftThumbMetacarpal", "LeftThumbProximal"),
        ("rightThumbProximal", "RightThumbIntermediate"),
        ("leftThumbDistal", "LeftThumbDistal"),
        ("rightLittleProximal", "RightLittleProximal"),
    ],
)
def test_unitys_names(vrm: str, unity: str) -> None:
    assert unity_bone(vrm) == unity


def test_the_posture_is_the_same_from_vrms_t_pose(waving_clip: Clip) -> None:
    pose = waving_clip.pose
    there = t_posed(pose)
    assert there.skeleton.points == pose.skeleton.points
    for ours, theirs in zip(forward_kinematics(pose)[:1], forward_kinematics(there)[:1], strict=True):
        np.testing.assert_allclose(theirs, ours, atol=1e-12)
    np.testing.assert_allclose(there.skeleton.bone_length, pose.skeleton.bone_length, atol=1e-15)
    thumbs = [k for k, name in enumerate(pose.skeleton.joints) if "thumb" in name]
    same = np.delete(np.arange(52), thumbs)
    np.testing.assert_array_equal(there.rotation[:, same], pose.rotation[:, same])
    one = t_posed(pose[7])
    np.testing.assert_allclose(one.rotation, there.rotation[7], atol=1e-15)


def test_its_rest_pose_is_vrms() -> None:
    """VRM 1.0, tpose.md: 1.1 to 1.8."""
    skeleton = t_posed(rest_pose(default_skeleton())).skeleton
    place = dict(zip(skeleton.points, skeleton.path @ skeleton.rest_offset + skeleton.rest_offset[0], strict=True))

    def along(first: str, second: str) -> np.ndarray:
        bone = place[second] - place[first]
        return bone / np.linalg.norm(bone)

    for side, x in (("left", 1.0), ("right", -1.0)):
        for bone in (("shoulder", "elbow"), ("elbow", "wrist"), *((f"{f}1", f"{f}_tip") for f in ("index", "ring"))):
            np.testing.assert_allclose(along(*(f"{side}_{end}" for end in bone)), [x, 0, 0], atol=1e-9)
        np.testing.assert_allclose(along(f"{side}_hip", f"{side}_knee"), [0, -1, 0], atol=1e-9)
        assert along(f"{side}_ankle", f"{side}_foot") @ [0, 0, 1] > 0.9
        for bone in (("thumb1", "thumb2"), ("thumb2", "thumb3"), ("thumb3", "thumb_tip")):
            thumb = np.array([x, 0, 1]) * np.sqrt(0.5)
            np.testing.assert_allclose(along(*(f"{side}_{end}" for end in bone)), thumb, atol=1e-9)


def test_a_thumb_without_a_tip_goes_on_straight(waving_clip: Clip) -> None:
    whole = waving_clip.pose.skeleton
    kept = [k for k, name in enumerate(whole.points) if not name.endswith("_tip")]
    skeleton = Skeleton(
        whole.joints,
        tuple(whole.points[k] for k in kept[52:]),
        tuple(whole.parents[k] for k in kept),
        whole.rest_offset[kept],
    )
    pose = Pose(skeleton, waving_clip.pose.root_position, waving_clip.pose.rotation)
    np.testing.assert_allclose(forward_kinematics(t_posed(pose))[0], forward_kinematics(pose)[0], atol=1e-12)


def test_an_incomplete_humanoid_is_refused() -> None:
    stump = Skeleton(("pelvis", "spine1"), (), (-1, 0), np.zeros((2, 3)))
    with pytest.raises(BodysenseError, match=r"needs the joint 'spine2' \(chest\), which this skeleton lacks"):
        check_humanoid(stump)
