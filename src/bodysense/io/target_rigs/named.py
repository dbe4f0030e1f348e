"""Rigs to write on: our joints under the names that other programs know, or the rig of a BVH or FBX file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

from bodysense.body.skeleton import FINGERS, Skeleton
from bodysense.errors import BodysenseError, unknown_name
from bodysense.io.clip import Clip
from bodysense.io.formats.gltf.humanoid import VRM_BONES, check_humanoid, t_posed

OWN = "bodysense"
SOURCE = "source"  # the rig of the file that was tracked
RigName = Literal[
    "bodysense",
    "smplh",
    "mixamo",
    "unreal",
    "metahuman",
    "rigify",
    "vrm",
    "vrchat",
    "lafan1",
    "soma",
    "mhr",
    "source",
]
FILES = (".bvh", ".fbx")  # endings of files whose rig can be taken
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

METAHUMAN = UNREAL | {"spine2": "spine_03", "spine3": "spine_05"}
"""Our joint → the bone of a MetaHuman, whose spine has five bones; ours are its first, third and fifth."""

VRCHAT = _table(
    {
        **{"pelvis": "Hips", "spine1": "Spine", "spine2": "Chest", "spine3": "Upper Chest"},
        **{"neck": "Neck", "head": "Head"},
    },
    "{1} {4}",
    {
        **{"hip": "leg", "knee": "knee", "ankle": "ankle", "foot": "toe"},
        **{"collar": "shoulder", "shoulder": "arm", "elbow": "elbow", "wrist": "wrist"},
    },
) | _table(
    {},
    "{4}_{3}",
    {
        f"{ours}{k}": f"{theirs}{k - (ours == 'thumb')}"
        for ours, theirs in (("thumb", "Thumb"), ("index", "IndexFinger"), ("middle", "MiddleFinger"))
        for k in (1, 2, 3)
    }
    | {
        f"{ours}{k}": f"{theirs}{k}"
        for ours, theirs in (("ring", "RingFinger"), ("pinky", "LittleFinger"))
        for k in (1, 2, 3)
    },
)
"""Our joint → the bone of avatars that are prepared for VRChat in Blender."""

LAFAN1 = _table(
    {
        **{"pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2"},
        **{"neck": "Neck", "head": "Head"},
    },
    "{1}{4}",
    {
        **{"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "Toe"},
        **{"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand"},
    },
)
"""Our joint → that of the LAFAN1 data set, which has no fingers."""

SOMA = _table(
    {
        **{"pelvis": "Hips", "spine1": "Spine1", "spine2": "Spine2", "spine3": "Chest"},
        **{"neck": "Neck1", "head": "Head", "head_top": "HeadEnd"},
    },
    "{1}{4}",
    {
        **{"hip": "Leg", "knee": "Shin", "ankle": "Foot", "foot": "ToeBase", "toe": "ToeEnd"},
        **{"collar": "Shoulder", "shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand"},
        # All fingers but the thumb begin with a bone inside the palm, which we lack.
        **{f"{f}{k}": f"Hand{f.capitalize()}{k + (f != 'thumb')}" for f in FINGERS for k in (1, 2, 3)},
        **{f"{f}_tip": f"Hand{f.capitalize()}End" for f in FINGERS},
    },
)
"""Our point → that of SOMA's 77 joints, whose `LeftLeg` is the thigh."""

MHR = _table(
    {
        **{"pelvis": "root", "spine1": "c_spine0", "spine2": "c_spine1", "spine3": "c_spine3"},
        **{"neck": "c_neck", "head": "c_head"},
    },
    "{2}_{4}",
    {
        **{"hip": "upleg", "knee": "lowleg", "ankle": "foot", "foot": "ball"},
        **{"collar": "clavicle", "shoulder": "uparm", "elbow": "lowarm", "wrist": "wrist"},
        **{f"{finger}{k}": f"{finger}{k}" for finger in FINGERS for k in (1, 2, 3)},
    },
)
"""Our joint → that of the Momentum Human Rig."""

_NAMES = {  # rigs whose rest pose is ours
    **{"mixamo": MIXAMO, "unreal": UNREAL, "metahuman": METAHUMAN, "rigify": RIGIFY},
    **{"vrchat": VRCHAT, "lafan1": LAFAN1, "soma": SOMA, "mhr": MHR},
}


def is_rig_file(rig: str | Path) -> bool:
    """Whether a rig is that of a BVH or FBX file."""
    return Path(rig).suffix.lower() in FILES


def check_rig(path: Path, rig: str | Path, source: Path | None) -> None:
    """Raise BodysenseError, before any work, for a rig that a motion cannot be written on.

    Args:
        path: where the motion goes.
        rig: one of `RIGS`, or a BVH or FBX file.
        source: the BVH or FBX file that is tracked, if it is one.
    """
    if is_rig_file(rig):
        if not Path(rig).is_file():
            raise BodysenseError(f"--rig {rig}: no such file; give a BVH or FBX file, or one of {', '.join(RIGS)}")
    elif rig not in RIGS:
        raise BodysenseError(f"unknown rig {str(rig)!r}; {unknown_name(str(rig), (*RIGS, 'a BVH or FBX file'))}")
    named = [name for name in RIGS if name != SOURCE]
    if rig == SOURCE and source is None:
        raise BodysenseError(
            f"--rig source: only a .bvh or .fbx file has a rig of its own; give {', '.join(named)}, or such a file"
        )
    file = source if rig == SOURCE else Path(rig) if is_rig_file(rig) else None
    if file is not None and path.suffix.lower() != (ending := file.suffix.lower()):
        raise BodysenseError(f"{path}: --rig {rig} is written as {ending}; end the name so, or give {', '.join(named)}")
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
