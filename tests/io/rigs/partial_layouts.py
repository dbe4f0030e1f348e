"""Rigs that lack a part of a body or have another hierarchy, derived from whole layouts."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from further_layouts import FURTHER
from more_layouts import MORE
from rig_files import Bones, Layout, bones_of
from rig_layouts import LAYOUTS

from bodysense.body.pose import forward_kinematics
from bodysense.io.clip import Clip

EVERY = LAYOUTS | MORE | FURTHER


def without(layout: Layout, parts: str) -> Layout:
    """Return the rig without some joints and their descendants."""
    gone: set[str] = set()
    bones: Bones = []
    for name, parent, place in layout.bones:
        if parent in gone or re.match(parts, place):
            gone |= {name} - {"End Site"}
        else:
            bones.append((name, parent, place))
    return replace(layout, bones=bones)


def headless(layout: Layout) -> Layout:
    """The spine ends at the neck."""
    return without(layout, "head")


def neckless(layout: Layout) -> Layout:
    """The spine ends at the chest; arms that hang on a neck hang there."""
    return without(layout, "head|neck")


def upper_half(layout: Layout) -> Layout:
    """An avatar of a person seated at a webcam."""
    return without(layout, "(left|right)_(hip|knee|ankle)|pelvis>@?(left|right)_hip|pelvis>head:-")


def lower_half(layout: Layout) -> Layout:
    """A rig of a gait laboratory."""
    return without(layout, "(left|right)_(collar|shoulder)|neck|head")


def flat(layout: Layout) -> Layout:
    """All joints are children of the root, with positions in its frame."""
    root = layout.bones[0][0]
    bones = [(name, "-" if name == root else root, place) for name, _, place in layout.bones if name != "End Site"]
    return replace(layout, bones=bones, has_positions=True)


def scattered(layout: Layout) -> Layout:
    """Every joint is a root."""
    return replace(layout, bones=[(name, "-", place) for name, _, place in layout.bones if name != "End Site"])


def staged(layout: Layout) -> Layout:
    """In a scene with a camera, a light and controls that mirror each other as limbs do."""
    scene = "Scene | - | 0\nCamera | Scene | head>left_wrist:3\nTarget | Camera | head>pelvis:0.1\nCtrl | Scene | 0\n"
    scene += "* foot ik | Ctrl | @ankle>@foot:0.1\n* toe ik | * foot ik | @foot\n* pole | * toe ik | @knee>@foot:0.3\n"
    scene += "* hand ik | Ctrl | @wrist>@elbow:0.1\n* pole 2 | * hand ik | @elbow\n* grip | * pole 2 | @wrist\n"
    (top, _, place), *rest = layout.bones
    roots: Bones = [("Rig", "Scene", "0"), ("Char", "Rig", "0"), (top, "Char", place)]
    return replace(layout, bones=[*bones_of(scene, "left", "right"), *roots, *rest])


# Name → change of the layout, and text in the line that describes the file.
PARTIAL: dict[str, tuple[Callable[[Layout], Layout], str]] = {
    "headless": (headless, "its head is put over the shoulders"),
    "neckless": (neckless, "its head is put over the shoulders"),
    "upper half": (upper_half, "its legs keep still"),
    "lower half": (lower_half, "its arms hang"),
    "flat": (flat, ""),
    "scattered": (scattered, ""),
    "staged": (staged, ""),
}


def write_places(layout: Layout, clip: Clip, *, on_root: bool) -> str:
    """Return a clip as BVH without rotations: joints have positions in their parent or, if `on_root`, in the root."""
    skeleton, position = clip.pose.skeleton, np.asarray(forward_kinematics(clip.pose)[0])
    bones = [bone for bone in layout.bones if bone[0] != "End Site" and bone[2] in skeleton.points]
    place = {name: position[:, skeleton.index(at)] / layout.unit for name, _, at in bones}
    root = bones[0][0]
    above = {name: parent for name, parent, _ in layout.bones}
    parents = {name: root if on_root else above[name] for name, _, _ in bones[1:]}
    while dropped := [name for name in parents if parents[name] not in place]:
        parents |= {name: above[parents[name]] for name in dropped}
    lines, columns = ["HIERARCHY"], []

    def emit(name: str) -> None:
        lines.append(f"{'JOINT' if name in parents else 'ROOT'} {name}\n{{\nOFFSET 0 0 0")
        lines.append("CHANNELS 3 Xposition Yposition Zposition")
        columns.append(place[name] - (place[parents[name]] if name in parents else 0.0))
        for child in (child for child, parent in parents.items() if parent == name):
            emit(child)
        lines.append("End Site\n{\nOFFSET 0 0 0\n}\n}")

    emit(root)
    lines += ["MOTION", f"Frames: {len(clip)}", f"Frame Time: {1 / clip.frame_rate:.9f}"]
    return "\n".join([*lines, *(" ".join(f"{x:.6f}" for x in row) for row in np.hstack(columns))]) + "\n"
