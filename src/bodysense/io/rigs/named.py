"""Rigs by name: our 52 joints under the names that other programs know."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

from bodysense.body.skeleton import FINGERS, Skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.gltf.humanoid import VRM_BONES, check_humanoid, t_posed

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


def is_rig_file(rig: str | Path) -> bool:
    """Whether a rig is that of a BVH file."""
    return Path(rig).suffix.lower() == ".bvh"


def check_rig(path: Path, rig: str | Path, source: Path | None) -> None:
    """Raise BodysenseError, before any work, for a rig that a motion cannot be written on.

    Args:
        path: where the motion goes.
        rig: one of `RIGS`, or a BVH file.
        source: the BVH file that is tracked, if it is one.
    """
    if is_rig_file(rig):
        if not Path(rig).is_file():
            raise BodysenseError(f"--rig {rig}: no such file; give a BVH file, or one of {', '.join(RIGS)}")
    elif rig not in RIGS:
        raise BodysenseError(f"unknown rig {str(rig)!r}; valid are {', '.join(RIGS)}, or a BVH file")
    named = [name for name in RIGS if name != SOURCE]
    if rig == SOURCE and source is None:
        raise BodysenseError(f"--rig source: only a .bvh file has a rig of its own; give {', '.join(named)}, or a .bvh")
    if (rig == SOURCE or is_rig_file(rig)) and path.suffix.lower() != ".bvh":
        raise BodysenseError(f"{path}: --rig {rig} is written as .bvh; end the name so, or give {', '.join(named)}")
    if path.suffix.lower() == ".vrma" and rig not in (OWN, "vrm"):
        raise BodysenseError(f"{path}: --rig {rig}: a VRM animation has VRM's bones; leave --rig out")
    if path.suffix.lower() == ".mcap" and rig != OWN:
        raise BodysenseError(f"{path}: --rig {rig}: a take for robots' tools has our joints; leave --rig out")


def on_rig(clip: Clip, rig: str) -> tuple[Clip, tuple[str, ...]]:
    """A clip in the rest pose of a rig, and the names of its points there.

    'bodysense' and 'smplh' are our own joints, which have SMPL-H's names; VRM's thumbs rest otherwise than ours.
    Raises BodysenseError for a skeleton that lacks a joint of it.
    """
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
