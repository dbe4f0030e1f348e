"""Odd rigs: prefixes, several roots, swords, braids, skirts, sitting bodies, single frames."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from further_layouts import FURTHER
from more_layouts import MORE
from rig_files import Bones, Layout, for_each, held_still, mapped, motion, write
from rig_layouts import LAYOUTS
from test_rigs import NEEDED, of, unit_of, worst

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip

EVERY = LAYOUTS | MORE | FURTHER
USUAL = ("Mixamo", "Character Creator", "mocopi")
LIMBS = [name for name in NEEDED if name not in ("pelvis", "head")]


def named(change: Callable[[str], str]) -> Callable[[Layout], Layout]:
    """The layout with other names."""

    def renamed(layout: Layout) -> Layout:
        bones = [
            (name if name == "End Site" else change(name), parent if parent == "-" else change(parent), place)
            for name, parent, place in layout.bones
        ]
        return replace(layout, bones=bones)

    return renamed


def with_roots(layout: Layout) -> Layout:
    (top, _, place), *rest = layout.bones
    roots: Bones = [("Scene", "-", "0"), ("Rig", "Scene", "0"), ("Char", "Rig", "0")]
    return replace(layout, bones=[*roots, (top, "Char", place), *rest])


def dressed(layout: Layout) -> Layout:
    """With a sword in the right hand, a braid and a skirt."""
    hand, head, hips = (mapped(layout)[name] for name in ("right_wrist", "head", "pelvis"))
    more: Bones = [("Sword1", hand, "right_wrist>right_middle1:0.9"), ("Sword2", "Sword1", "right_middle1>head:0.4")]
    more += [("SwordTip", "Sword2", "right_middle1>head:1.2")]
    more += [
        ("Braid1", head, "head>neck:-0.4"),
        ("Braid2", "Braid1", "head>neck:0.5"),
        ("Braid3", "Braid2", "head>pelvis:0.5"),
    ]
    for side, other in (("left", "right"), ("right", "left")):
        more += [(f"Skirt1 {side}", hips, f"{side}_hip>{other}_hip:-0.2")]
        more += [(f"Skirt2 {side}", f"Skirt1 {side}", f"{side}_knee>{other}_knee:-0.2")]
    return replace(layout, bones=[*layout.bones, *more])


ODD: dict[str, Callable[[Layout], Layout]] = {
    "with a prefix": named(lambda name: f"Armature|Anna:{name}"),
    "in capitals": named(str.upper),
    "in small letters": named(str.lower),
    "with blanks": named(lambda name: f" {name} "),
    "under more roots": with_roots,
    "dressed": dressed,
}


def seated() -> Clip:
    """Some frames from the one in which the pelvis is lowest on."""
    clip = packaged_performance()
    low = int(np.argmin(forward_kinematics(clip.pose)[0][:, 0, 1]))
    return Clip("seated", clip.pose[low : low + 40 : 4], 30.0)


def standing() -> Clip:
    """One frame, a T-pose."""
    skeleton = packaged_performance().pose.skeleton
    rotation = np.zeros((1, len(skeleton.joints), 4))
    rotation[..., 0] = 1
    return Clip("standing", Pose(skeleton, skeleton.rest_offset[:1], rotation), 30.0)


def check(layout: Layout, clip: Clip) -> None:
    """The limbs are those that were written, to 2 mm."""
    clip = held_still(clip, layout)
    rigged = of(write(layout, clip), **unit_of(layout))
    expected = {ours: name.strip() for ours, name in mapped(layout).items() if ours not in layout.lacks}
    found = [name for name in LIMBS if name in expected]
    assert {name: rigged.rig.joints[name] for name in found} == {name: expected[name] for name in found}
    ours = clip.pose.skeleton.indices([*found, *(["head"] if "head" in expected else [])])
    there, truth = (forward_kinematics(one.pose)[0][:, ours] for one in (rigged.clip, clip))
    assert np.linalg.norm(there - truth, axis=-1).max() < 2e-3, rigged.rig.line()


OTHERS = [name for name in EVERY if name not in USUAL]


def odd_cases() -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """Return every oddity of usual rigs, and one oddity of each other rig, in turn."""
    whole = (name for name in OTHERS if "pelvis" not in EVERY[name].lacks)
    turns = zip(whole, itertools.cycle(ODD), strict=False)
    return [case for case in itertools.product(USUAL, ODD) if can_be(*case)], [turn for turn in turns if can_be(*turn)]


def can_be(name: str, odd: str) -> bool:
    """Return whether the rig has what an oddity hangs on."""
    return odd != "dressed" or {"right_wrist", "head"} <= mapped(EVERY[name]).keys()


@for_each(*odd_cases())
def test_odd_files_are_read(name: str, odd: str) -> None:
    check(ODD[odd](EVERY[name]), motion(10, 60))


@for_each(USUAL, OTHERS)
def test_a_body_that_sits_is_read(name: str) -> None:
    check(EVERY[name], seated())


def of_shape(clip: Clip, **factors: float) -> Clip:
    """The motion on a body with some longer or shorter bones."""
    skeleton = clip.pose.skeleton
    offset = skeleton.rest_offset.copy()
    for k, name in enumerate(skeleton.points):
        offset[k] *= factors.get(name.rpartition("_")[2].rstrip("123"), 1.0)
    root = clip.pose.root_position * [1.0, factors.get("knee", 1.0), 1.0]
    return Clip("shaped", Pose(skeleton.with_offsets(offset), root, clip.pose.rotation), clip.frame_rate)


@pytest.mark.parametrize("factors", [
    {"knee": 0.5, "ankle": 0.5, "elbow": 0.6, "wrist": 0.6, "head": 1.8},
    {"knee": 1.45, "ankle": 1.45},
    {"elbow": 1.4, "wrist": 1.4, "collar": 1.5, "shoulder": 1.5},
    {"knee": 0.75, "ankle": 0.75, "spine": 0.9, "elbow": 0.8, "wrist": 0.8},
])  # fmt: skip
@pytest.mark.parametrize("name", ["Mixamo", "Character Creator", "MikuMikuDance"])
def test_bodies_of_other_shapes_are_read(name: str, factors: dict[str, float]) -> None:
    check(EVERY[name], of_shape(motion(10, 60), **factors))


@for_each(USUAL, OTHERS)
def test_one_frame_is_read(name: str) -> None:
    check(EVERY[name], standing())


def test_of_several_bodies_one_is_chosen() -> None:
    clip = motion(6, 50)
    first, second = (write(LAYOUTS[name], clip) for name in ("Mixamo", "classic, two chests"))
    heads = [text.split("MOTION\n")[0].removeprefix("HIERARCHY\n") for text in (first, second)]
    rows = [text.split("MOTION\n")[1].splitlines() for text in (first, second)]
    values = [f"{a} {b}" for a, b in zip(rows[0][2:], rows[1][2:], strict=True)]
    both = "\n".join(["HIERARCHY", *heads, "MOTION", *rows[0][:2], *values])
    with pytest.raises(BodysenseError, match=r"2 bodies in it: 1 .mixamorig7:Hips., 2 .Hips.; choose one with"):
        of(both)
    assert of(both, figure=2).rig.family == "Biovision"
    assert worst(of(both, figure=1), clip, LAYOUTS["Mixamo"]) < 1e-3
    stage = "ROOT Stage\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    under = "\n".join(head.replace("ROOT", "JOINT") for head in heads)
    values = [f"0 0 0 {row}" for row in values]
    one_root = "\n".join([f"HIERARCHY\n{stage}{under}}}", "MOTION", *rows[0][:2], *values])
    assert of(one_root, figure=2).rig.family == "Biovision"
