"""Rigs by name: our 52 joints under the names that other programs know."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, get_args

from bodysense.body.skeleton import FINGERS, Skeleton
from bodysense.data.clip import Clip
from bodysense.errors import BodysenseError
from bodysense.export.humanoid import VRM_BONES, check_humanoid, t_posed

OWN = "bodysense"
SOURCE = "source"  # the rig of the file that was tracked
RigName = Literal["bodysense", "smplh", "mixamo", "vrm", "source"]
RIGS: tuple[str, ...] = get_args(RigName)

_MIXAMO_MIDDLE = {
    **{"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head"},
    "head_top": "HeadTop_End",
}
_MIXAMO_SIDED = {
    **{"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "toe": "Toe_End"},
    **{"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand"},
    **{f"{finger}{k}": f"Hand{finger.capitalize()}{k}" for finger in FINGERS for k in (1, 2, 3)},
    **{f"{finger}_tip": f"Hand{finger.capitalize()}4" for finger in FINGERS},
}
MIXAMO = {ours: f"mixamorig:{theirs}" for ours, theirs in _MIXAMO_MIDDLE.items()} | {
    f"{side}_{ours}": f"mixamorig:{side.capitalize()}{theirs}"
    for side in ("left", "right")
    for ours, theirs in _MIXAMO_SIDED.items()
}
"""Our point → Mixamo's, also of its end sites."""


def on_rig(clip: Clip, rig: str) -> tuple[Clip, tuple[str, ...]]:
    """A clip in the rest pose of a rig, and the names of its points there.

    'bodysense' and 'smplh' are our own joints, which have SMPL-H's names; VRM's thumbs rest otherwise than ours.
    Raises BodysenseError for an unknown rig, and for a skeleton that lacks a joint of it.
    """
    if rig not in RIGS or rig == SOURCE:
        raise BodysenseError(f"unknown rig {rig!r}; valid are {', '.join(RIGS)}")
    points = clip.pose.skeleton.points
    if rig in ("bodysense", "smplh"):
        return clip, points
    check_humanoid(clip.pose.skeleton)
    if rig == "mixamo":
        return clip, tuple(MIXAMO.get(point, point) for point in points)
    return replace(clip, pose=t_posed(clip.pose)), tuple(VRM_BONES.get(point, point) for point in points)


def renamed(clip: Clip, names: tuple[str, ...]) -> Clip:
    """The clip with other names of its points."""
    skeleton, pose = clip.pose.skeleton, clip.pose
    count = len(skeleton.joints)
    other = Skeleton(names[:count], names[count:], skeleton.parents, skeleton.rest_offset)
    return replace(clip, pose=replace(pose, skeleton=other))
