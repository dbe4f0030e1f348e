"""Rigs by name: our 52 joints under the names that other programs know.

A table of joints by hand: {name in the file: ours}, as JSON; '' for those that are left out.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

from bodysense.body.skeleton import FINGERS, Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.io.clip import Clip
from bodysense.io.gltf.humanoid import VRM_BONES, check_humanoid, t_posed
from bodysense.io.rigs.figure import Figure

OWN = "bodysense"
SOURCE = "source"  # the rig of the file that was tracked
RigName = Literal["bodysense", "smplh", "mixamo", "unreal", "rigify", "vrm", "source"]
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

_UNREAL_MIDDLE = {
    **{"pelvis": "pelvis", "spine1": "spine_01", "spine2": "spine_02", "spine3": "spine_03"},
    **{"neck": "neck_01", "head": "head"},
}
_UNREAL_SIDED = {
    **{"hip": "thigh", "knee": "calf", "ankle": "foot", "foot": "ball"},
    **{"collar": "clavicle", "shoulder": "upperarm", "elbow": "lowerarm", "wrist": "hand"},
    **{f"{finger}{k}": f"{finger}_0{k}" for finger in FINGERS for k in (1, 2, 3)},
}
UNREAL = _UNREAL_MIDDLE | {
    f"{side}_{ours}": f"{theirs}_{side[0]}" for side in ("left", "right") for ours, theirs in _UNREAL_SIDED.items()
}
"""Our joint → the bone of Unreal's Mannequin (UE4; the bones of UE5's have the same names, and more)."""

# Rigify's human meta-rig. Its neck has two bones, of which ours is the lower one.
_RIGIFY_MIDDLE = {
    **{"pelvis": "spine", "spine1": "spine.001", "spine2": "spine.002", "spine3": "spine.003"},
    **{"neck": "spine.004", "head": "spine.006"},
}
_RIGIFY_SIDED = {
    **{"hip": "thigh", "knee": "shin", "ankle": "foot", "foot": "toe"},
    **{"collar": "shoulder", "shoulder": "upper_arm", "elbow": "forearm", "wrist": "hand"},
    **{f"thumb{k}": f"thumb.0{k}" for k in (1, 2, 3)},
    **{f"{finger}{k}": f"f_{finger}.0{k}" for finger in FINGERS if finger != "thumb" for k in (1, 2, 3)},
}
RIGIFY = _RIGIFY_MIDDLE | {
    f"{side}_{ours}": f"{theirs}.{side[0].upper()}"
    for side in ("left", "right")
    for ours, theirs in _RIGIFY_SIDED.items()
}
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


ARMS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("shoulder", "elbow", "wrist"))
LEGS = tuple(f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle"))
NEEDED = ("pelvis", "head", *ARMS, *LEGS)  # of a whole body


def table_of(path: Path) -> dict[str, str]:
    """Return a file's table, {name in the file: ours}, without omitted joints. Raises BodysenseError for others."""
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BodysenseError(f"--joints {path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise BodysenseError(f"--joints {path}: not JSON ({error}); draft it with bodysense data joints") from None
    if not isinstance(table, dict) or not all(isinstance(ours, str) for ours in table.values()):
        raise BodysenseError(f'--joints {path}: must be one object of names, {{"name in the file": "our name"}}')
    return {given: ours for given, ours in table.items() if ours}


def read_joint_map(path: Path, figure: Figure) -> dict[str, int]:
    """Points of a figure by our names, as a file says. Raises BodysenseError where it says it wrongly."""
    index = {name: point for point, name in enumerate(figure.points)}
    found: dict[str, int] = {}
    for given, ours in table_of(path).items():
        if given not in index:
            raise BodysenseError(f"--joints {path}: the file has no joint {given!r}{_near(given, figure.points)}")
        if ours not in default_skeleton().points:
            raise BodysenseError(
                f"--joints {path}: no joint of ours is {ours!r}{_near(ours, default_skeleton().points)}"
            )
        if ours in found:
            raise BodysenseError(f"--joints {path}: {ours!r} stands twice; each joint of ours is one of the file's")
        found[ours] = index[given]
    halves = [half for half in (ARMS, LEGS) if found.keys() & set(half)] or [ARMS, LEGS]
    if missing := [name for name in ("pelvis", *(name for half in halves for name in half)) if name not in found]:
        raise BodysenseError(
            f"--joints {path}: it names no {', '.join(missing[:4])}; a body needs a pelvis, and all {len(ARMS)} joints "
            f"of its arms, all {len(LEGS)} of its legs, or both"
        )
    return found


def write_joint_map(path: Path, figure: Figure, joints: Mapping[str, str]) -> None:
    """Write a draft of such a file."""
    with written_beside(path) as beside:
        beside.write_text(joint_map_text(figure, joints), encoding="utf-8")


def joint_map_text(figure: Figure, joints: Mapping[str, str]) -> str:
    """A draft: every point of a figure, with our name for it or ''."""
    ours = {given: name for name, given in joints.items()}
    table = {name: ours.get(name, "") for name in figure.points}
    return json.dumps(table, indent=1, ensure_ascii=False) + "\n"


def _near(name: str, names: tuple[str, ...]) -> str:
    """The nearest names known, for a message."""
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    return f"; near are {', '.join(near)}" if near else ""
