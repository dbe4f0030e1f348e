"""Rigs to write on: our joints under the names that other programs know, or the rig of a BVH file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

from bodysense.body.skeleton import FINGERS, Skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.humanoid import VRM_BONES, check_humanoid, t_posed

OWN = "bodysense"
SOURCE = "source"  # the rig of the file that was tracked
RigName = Literal["bodysense", "smplh", "mixamo", "unreal", "rigify", "vrm", "source"]
RIGS: tuple[str, ...] = get_args(RigName)


def _table(middle: Mapping[str, str], sided: str, parts: Mapping[str, str]) -> dict[str, str]:
    """Return our names → a rig's; `sided` makes a name of 0: left, 1: Left, 2: l, 3: L, and 4: a part's name."""
    return {**middle} | {
        f"{side}_{ours}": sided.format(side, side.capitalize(), side[0], side[0].upper(), theirs)
        for side in ("left", "right")
        for ours, theirs in parts.items()
    }


MIXAMO = _table(
    {
        **{"pelvis": "mixamorig:Hips", "spine1": "mixamorig:Spine", "spine2": "mixamorig:Spine1"},
        **{"spine3": "mixamorig:Spine2", "neck": "mixamorig:Neck", "head": "mixamorig:Head"},
        **{"head_top": "mixamorig:HeadTop_End"},
    },
    "mixamorig:{1}{4}",
    {
        **{"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "toe": "Toe_End"},
        **{"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand"},
        **{f"{finger}{k}": f"Hand{finger.capitalize()}{k}" for finger in FINGERS for k in (1, 2, 3)},
        **{f"{finger}_tip": f"Hand{finger.capitalize()}4" for finger in FINGERS},
    },
)
"""Our point → Mixamo's, also of its end sites."""

UNREAL = _table(
    {
        **{"pelvis": "pelvis", "spine1": "spine_01", "spine2": "spine_02", "spine3": "spine_03"},
        **{"neck": "neck_01", "head": "head"},
    },
    "{4}_{2}",
    {
        **{"hip": "thigh", "knee": "calf", "ankle": "foot", "foot": "ball"},
        **{"collar": "clavicle", "shoulder": "upperarm", "elbow": "lowerarm", "wrist": "hand"},
        **{f"{finger}{k}": f"{finger}_0{k}" for finger in FINGERS for k in (1, 2, 3)},
    },
)
"""Our joint → the bone of Unreal's Mannequin (UE4; the bones of UE5's have the same names, and more)."""

RIGIFY = _table(
    {
        **{"pelvis": "spine", "spine1": "spine.001", "spine2": "spine.002", "spine3": "spine.003"},
        **{"neck": "spine.004", "head": "spine.006"},  # its neck has two bones, of which ours is the lower one
    },
    "{4}.{3}",
    {
        **{"hip": "thigh", "knee": "shin", "ankle": "foot", "foot": "toe"},
        **{"collar": "shoulder", "shoulder": "upper_arm", "elbow": "forearm", "wrist": "hand"},
        **{f"{f}{k}": f"{'' if f == 'thumb' else 'f_'}{f}.0{k}" for f in FINGERS for k in (1, 2, 3)},
    },
)
"""Our joint → the bone of the human meta-rig of Blender's Rigify."""

_NAMES = {"mixamo": MIXAMO, "unreal": UNREAL, "rigify": RIGIFY}  # rigs whose rest pose is ours


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

    'bodysense' and 'smplh' are our own joints, which have SMPL-H's names. Other rigs rename them and keep our T-pose,
    but VRM's thumbs rest otherwise.
    Raises BodysenseError for a skeleton that lacks a joint of it.
    """
    points = clip.pose.skeleton.points
    if rig in ("bodysense", "smplh"):
        return clip, points
    check_humanoid(clip.pose.skeleton)
    if rig in _NAMES:
        return clip, tuple(_NAMES[rig].get(point, point) for point in points)
    return replace(clip, pose=t_posed(clip.pose)), tuple(VRM_BONES.get(point, point) for point in points)


def renamed(clip: Clip, names: tuple[str, ...]) -> Clip:
    """The clip with other names of its points."""
    skeleton, pose = clip.pose.skeleton, clip.pose
    count = len(skeleton.joints)
    other = Skeleton(names[:count], names[count:], skeleton.parents, skeleton.rest_offset)
    return replace(clip, pose=replace(pose, skeleton=other))
