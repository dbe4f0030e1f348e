"""Our joints as the humanoid bones of VRM and Unity, and our rest pose as VRM's T-pose.

VRM 1.0's T-pose stands straight on y = 0, faces +Z, arms and fingers along X, palms down, feet along Z, and its
rotations relative to that pose are the identity: so is our rest pose, so local rotations are the same. Only thumbs
differ: VRM's point half-way between X and Z, level with the ground (definition 1.8); ours hang as the body model has
them. `t_posed` describes the same posture from a rest pose whose thumbs are VRM's.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate, shortest_arc

_MIDDLE = {
    "pelvis": "hips",
    "spine1": "spine",
    "spine2": "chest",
    "spine3": "upperChest",
    "neck": "neck",
    "head": "head",
}
_SIDED = {
    "hip": "UpperLeg",
    "knee": "LowerLeg",
    "ankle": "Foot",
    "foot": "Toes",
    "collar": "Shoulder",
    "shoulder": "UpperArm",
    "elbow": "LowerArm",
    "wrist": "Hand",
    **{f"thumb{k}": f"Thumb{part}" for k, part in enumerate(("Metacarpal", "Proximal", "Distal"), start=1)},
    **{
        f"{ours}{k}": f"{theirs}{part}"
        for ours, theirs in (("index", "Index"), ("middle", "Middle"), ("ring", "Ring"), ("pinky", "Little"))
        for k, part in enumerate(("Proximal", "Intermediate", "Distal"), start=1)
    },
}
VRM_BONES: dict[str, str] = _MIDDLE | {
    f"{side}_{ours}": f"{side}{theirs}" for side in ("left", "right") for ours, theirs in _SIDED.items()
}
"""Our joint → VRM 1.0's bone: all 52."""

_UNITY_THUMB = {"ThumbMetacarpal": "ThumbProximal", "ThumbProximal": "ThumbIntermediate"}


def unity_bone(vrm_bone: str) -> str:
    """Return the name in Unity's `HumanBodyBones`: capitalised, and thumbs one joint further out by name."""
    for theirs, unity in _UNITY_THUMB.items():
        if vrm_bone.endswith(theirs):
            vrm_bone = vrm_bone.removesuffix(theirs) + unity
            break
    return vrm_bone[0].upper() + vrm_bone[1:]


def check_humanoid(skeleton: Skeleton) -> None:
    """Raise BodysenseError for a skeleton that lacks a joint of the humanoid."""
    missing = [name for name in VRM_BONES if name not in skeleton.joints]
    if missing:
        raise BodysenseError(
            f"a humanoid needs the joint {missing[0]!r} ({VRM_BONES[missing[0]]}), which this skeleton lacks; "
            "bring the motion to the default skeleton with `bodysense.io.rigs.canonical`"
        )


def t_posed(pose: Pose) -> Pose:
    """Return the posture (..., J) relative to VRM's T-pose; joint positions are unchanged."""
    skeleton, turn = _t_pose(pose.skeleton)
    above = quaternion_conjugate(turn[list(skeleton.parents[: len(skeleton.joints)])])
    above[0] = [1, 0, 0, 0]
    rotation = quaternion_multiply(quaternion_multiply(above, np.asarray(pose.rotation, dtype=float)), turn)
    return Pose(skeleton, pose.root_position, rotation)


@lru_cache(maxsize=64)
def _t_pose(skeleton: Skeleton) -> tuple[Skeleton, np.ndarray]:
    """Return the skeleton with its thumbs straight, and each joint's axes there (J, 4) in its own."""
    offset, turn = skeleton.rest_offset.copy(), np.zeros((len(skeleton.joints), 4))
    turn[:, 0] = 1
    for side, x in (("left", 1.0), ("right", -1.0)):
        outward = np.array([x, 0.0, 1.0]) * np.sqrt(0.5)
        for name in (f"{side}_thumb{k}" for k in (1, 2, 3)):
            if name not in skeleton.joints:
                continue
            joint = skeleton.index(name)
            beyond = [point for point, parent in enumerate(skeleton.parents) if parent == joint]
            if not beyond:  # a thumb without a tip is straight
                turn[joint] = turn[skeleton.parents[joint]]
                continue
            turn[joint] = shortest_arc(outward, skeleton.rest_offset[beyond[0]])
            offset[beyond[0]] = outward * skeleton.bone_length[beyond[0]]
    return skeleton.with_offsets(offset), turn


def from_t_posed(pose: Pose) -> Pose:
    """Return the posture of some of our joints relative to our default thumbs: the inverse of `t_posed`.

    Joint positions are unchanged even if the body's thumbs rest elsewhere.
    """
    ours, skeleton = default_skeleton(), pose.skeleton
    known = _t_pose(ours)[1]
    turn = np.zeros((len(skeleton.joints), 4))
    turn[:, 0] = 1
    for k, joint in enumerate(skeleton.joints):
        if joint in ours.joints:
            turn[k] = known[ours.index(joint)]
    above = np.concatenate([turn[:1], turn[list(skeleton.parents[1:])]])  # of every point
    above[0] = [1, 0, 0, 0]
    offset = quaternion_rotate(above, skeleton.rest_offset)
    rotation = np.asarray(pose.rotation, dtype=float)
    local = quaternion_multiply(
        quaternion_multiply(above[: len(skeleton.joints)], rotation), quaternion_conjugate(turn)
    )
    return Pose(skeleton.with_offsets(offset), pose.root_position, local)
