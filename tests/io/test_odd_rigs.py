"""Rigs as they are found: under prefixes, more roots, with swords, braids and skirts, sitting, in one frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from further_layouts import FURTHER
from more_layouts import MORE
from rig_files import Bones, Layout, held_still, mapped, motion, write
from rig_layouts import LAYOUTS
from test_rigs import NEEDED, of, unit_of

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.data.clip import Clip
from bodysense.demo import packaged_performance

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
    more += [("Braid1", head, "head>neck:-0.4"), ("Braid2", "Braid1", "head>neck:0.5"), ("Braid3", "Braid2", "spine3")]
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
    """Some frames about the one in which the pelvis is lowest."""
    clip = packaged_performance()
    low = int(np.argmin(forward_kinematics(clip.pose)[0][:, 0, 1]))
    return Clip("seated", clip.pose[max(0, low - 20) : low + 20 : 4], 30.0)


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


def cases(names: list[str]) -> list:
    return [pytest.param(name, marks=[] if name in USUAL else pytest.mark.slow) for name in names]


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("name", cases([name for name in EVERY if "pelvis" not in EVERY[name].lacks]))
def test_odd_files_are_read(name: str, odd: str) -> None:
    layout = EVERY[name]
    if odd == "dressed" and not {"right_wrist", "head"} <= mapped(layout).keys():
        pytest.skip("nothing to hang it on")
    check(ODD[odd](layout), motion(10, 60))


@pytest.mark.parametrize("name", cases(list(EVERY)))
def test_a_body_that_sits_is_read(name: str) -> None:
    check(EVERY[name], seated())


@pytest.mark.parametrize("name", cases(list(EVERY)))
def test_one_frame_is_read(name: str) -> None:
    check(EVERY[name], standing())
