"""Rigs without a head, half bodies, flat trees and joints with positions alone: read to 1 mm and reported."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from partial_layouts import EVERY, PARTIAL, flat, lower_half, scattered, upper_half, without, write_places
from rig_files import Bones, Layout, for_each, held_still, mapped, motion, read_plainly, write
from test_odd_rigs import seated
from test_rigs import beast, of, swinging, unit_of

import bodysense
from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import Source, read_source
from bodysense.io.rigged import Rigged

USUAL = ("Mixamo", "Unreal", "LaFAN1")
OTHERS = (
    *("CMU, metres", "Bandai-Namco", "SMPL-X", "VRoid", "100STYLE", "Xsens MVN", "ACCAD", "Rokoko", "Unity"),
    *("MikuMikuDance", "Kinect Azure", "Character Creator", "Ready Player Me", "HumanIK"),
)


def places(clip: Clip) -> np.ndarray:
    return np.asarray(forward_kinematics(clip.pose)[0])


def check(rigged: Rigged, text: str, layout: Layout, clip: Clip) -> None:
    """Joints match an independent reader and the written motion to 1 mm."""
    plain, skeleton = read_plainly(text), rigged.clip.pose.skeleton
    expected = mapped(layout)
    parts = [name for name in expected if re.search("hip|knee|ankle|shoulder|elbow|wrist|^head$|pelvis", name)]
    assert {name for name in parts if name not in rigged.rig.joints} <= {"pelvis"}
    for name in (name for name in expected if name in rigged.rig.joints):
        found = places(rigged.clip)[:, skeleton.index(name)]
        given = rigged.rig.to_world(plain[rigged.rig.joints[name]]) if rigged.rig.joints[name] in plain else found
        assert np.abs(found - given).max() < 1e-3, name
        truth = places(clip)[:, skeleton.index(name)]
        assert np.linalg.norm(found - truth, axis=-1).max() < 1e-3, (name, rigged.rig.line())


@for_each(product(USUAL, PARTIAL), product(OTHERS, PARTIAL))
def test_partial_bodies_are_read(name: str, what: str) -> None:
    change, message = PARTIAL[what]
    layout = change(EVERY[name])
    clip = held_still(motion(10, 60), layout)
    text = write(layout, clip)
    rigged = of(text, **unit_of(layout))
    assert message in rigged.rig.line() and rigged.rig.up == layout.up
    assert bool(message) == bool(rigged.clip.lacks)
    check(rigged, text, layout, clip)


@for_each(USUAL, OTHERS)
def test_joints_that_only_have_places(name: str) -> None:
    layout = EVERY[name]
    clip = held_still(motion(10, 60), layout)
    for on_root in (False, True):
        text = write_places(layout, clip, on_root=on_root)
        check(of(text, **unit_of(layout)), text, layout, clip)


def test_a_flat_tree_of_no_known_names_is_read_with_a_table(tmp_path: Path) -> None:
    whole = EVERY["Mixamo"]
    number = {name: f"n{k}" for k, (name, _, _) in enumerate(whole.bones)} | {"-": "-", "End Site": "End Site"}
    layout = flat(replace(whole, bones=[(number[name], number[parent], place) for name, parent, place in whole.bones]))
    clip = held_still(motion(6, 60), layout)
    text = write(layout, clip)
    with pytest.raises(BodysenseError, match=r"^take.bvh: not a humanoid: .*bodysense data joints take.bvh"):
        of(text)
    table = tmp_path / "joints.json"
    table.write_text(json.dumps({given: ours for ours, given in mapped(layout).items()}))
    check(of(text, joints=table), text, layout, clip)


@pytest.mark.parametrize("change", [flat, scattered])
def test_nothing_is_written_on_a_flat_tree(tmp_path: Path, change) -> None:
    layout = change(EVERY["Mixamo"])
    path = tmp_path / "flat.bvh"
    path.write_text(write(layout, held_still(motion(6, 60), layout)))
    with pytest.raises(BodysenseError, match=r"flat.bvh: its joints do not hang on one another.*bodysense.write"):
        bodysense.track(path, missing="left_hand")


def test_missing_legs_stand_or_sit_on_the_floor() -> None:
    layout = upper_half(EVERY["Mixamo"])
    for clip, shift in ((motion(10, 2), 0.0), (motion(10, 2), -1.5), (seated(), 0.0)):
        rigged = of(write(layout, held_still(clip, layout), shift=shift))
        knee, ankle, foot = (
            places(rigged.clip)[:, rigged.clip.pose.skeleton.index(f"left_{part}")]
            for part in ("knee", "ankle", "foot")
        )
        assert np.abs(knee[:, [0, 2]] - ankle[:, [0, 2]]).max() < 0.05, "shins are upright"
        assert np.abs(foot[:, 1]).max() < 0.12, rigged.rig.line()
        assert (rigged.rig.lift > 0) == (shift < 0)


@pytest.mark.parametrize("name", ["Mixamo", "pose lifter"])
def test_missing_joints_are_completed_by_tracking(tmp_path: Path, name: str) -> None:
    layout = upper_half(EVERY[name])
    clip = held_still(motion(45, 2), layout)
    path = tmp_path / "half.bvh"
    path.write_text(write(layout, clip))
    still, take = bodysense.read(path), bodysense.track(path)
    assert isinstance(still, Clip)
    known = clip.pose.skeleton.indices(["pelvis", "left_shoulder", "right_wrist", "head"])
    np.testing.assert_allclose(places(take.clip)[:, known], places(clip)[:, known], atol=1e-3)
    ankles = clip.pose.skeleton.indices(["left_ankle", "right_ankle"])
    assert np.ptp(places(take.clip)[:, ankles] - places(still)[:, ankles], axis=0).max() > 1e-3, "legs move"
    take.save(tmp_path / "whole.bvh")
    whole = bodysense.read(tmp_path / "whole.bvh")
    assert isinstance(whole, Clip) and not whole.lacks
    np.testing.assert_allclose(places(whole), places(take.clip), atol=1e-3)
    with pytest.raises(BodysenseError, match=r"half.bvh: the body has no legs; leave the file out, or complete it"):
        read_source(Source(path, person="", split="train"))


def test_halves_are_known_by_names_alone() -> None:
    for half in (upper_half, lower_half):
        layout = half(EVERY["Mixamo"])
        number = {name: f"n{k}" for k, (name, _, _) in enumerate(layout.bones)} | {"-": "-", "End Site": "End Site"}
        blank = replace(layout, bones=[(number[a], number[b], place) for a, b, place in layout.bones])
        with pytest.raises(BodysenseError, match="not a humanoid"):
            of(write(blank, held_still(motion(6, 60), blank)))


def test_an_animal_with_arms_of_a_biped_is_no_half() -> None:
    text = beast(2, 1.0, 5)
    for k, parts in enumerate((("Thigh", "Calf", "Foot"), ("UpperArm", "Forearm", "Hand"))):
        for side in "lr":
            for j, part in enumerate(parts, start=1):
                text = text.replace(f"{side}{k}_{j}\n", f"Bip01 {side.upper()} {part}\n")
    assert "Bip01 L UpperArm" in text
    with pytest.raises(BodysenseError, match="not a humanoid"):
        of(text)


CRAB_LEG = "LLeg{k}a,RLeg{k}a 6 0 {z}|LLeg{k}b,RLeg{k}b 10 6 0|LLeg{k}c,RLeg{k}c 8 -12 0|LLeg{k}d,RLeg{k}d 3 -12 0"
CLAW = "LeftArm,RightArm 5 0 8|LeftForeArm,RightForeArm 8 0 6|LeftHand,RightHand -3 0 10|LeftClaw,RightClaw 0 2 6"
BIRD_LEG = "LeftUpLeg,RightUpLeg 4 -2 0|LeftLeg,RightLeg 0 -12 5|LeftFoot,RightFoot 0 -13 -5|LeftToe,RightToe 0 -2 5"
WING = "LeftWing,RightWing 5 0 0|LeftWing1,RightWing1 20 0 0|LeftWing2,RightWing2 25 0 -3"


def creature(limbs: list[tuple[str, str]], has_head: bool = True) -> str:
    """A trunk of two joints with pairs of limbs: (the joint that carries a pair, its joints from there)."""
    bones = ["Body - 0 20 0", "Shell Body 0 2 6"]
    for hub, chain in limbs:
        above = [hub, hub]
        for names, x, y, z in (bone.split(" ") for bone in chain.split("|")):
            both = names.split(",")
            bones += [f"{name} {above[k]} {float(x) * (1 - 2 * k)} {y} {z}" for k, name in enumerate(both)]
            above = both
    return swinging([*bones, "Neck Shell 0 2 6", "Head Neck 0 3 3"] if has_head else bones)


def crab(pairs: int) -> list[tuple[str, str]]:
    return [(("Shell", "Body")[k % 2], CRAB_LEG.format(k=k, z=4 * k - 6)) for k in range(pairs)]


@pytest.mark.parametrize(("limbs", "message"), [
    (crab(1), "'LLeg0a' and 'RLeg0a' begin limbs, besides its arms"),
    (crab(2), "begin limbs, besides its arms, that are no legs by name"),
    (crab(4), "begin limbs, besides its arms, that are no legs by name"),
    ([("Body", BIRD_LEG), ("Shell", WING)], "'LeftWing' and 'RightWing' begin limbs, besides its legs"),
])  # fmt: skip
@pytest.mark.parametrize("has_head", [True, False])
def test_creatures_with_arms_or_legs_by_name_are_no_halves(limbs: list, message: str, has_head: bool) -> None:
    claws = [] if "wing" in message.lower() else [("Shell", CLAW)]
    with pytest.raises(
        BodysenseError, match=rf"^take.bvh: not a humanoid: .*{message}.*bodysense data joints take.bvh"
    ):
        of(creature([*limbs, *claws], has_head))


@pytest.mark.parametrize("pairs", [3, 4])
def test_legs_of_a_crab_are_not_arms(pairs: int) -> None:
    for text in (creature(crab(pairs)), re.sub(r"[LR]Leg(\d)(\w)", r"\2\1", creature(crab(pairs)))):
        with pytest.raises(BodysenseError, match="not a humanoid: two legs and two arms were not found"):
            of(text)


@pytest.mark.parametrize("half", [upper_half, lower_half])
@pytest.mark.parametrize("name", USUAL)
def test_halves_in_clothes_are_read(name: str, half: Callable[[Layout], Layout]) -> None:
    """With a braid, a skirt, a sword and two braids on the head, where there is a place for them."""
    layout = half(EVERY[name])
    ours = mapped(layout)
    more: Bones = []
    if "head" in ours:
        for side in ("left", "right"):
            more += [(f"Braid1 {side}", ours["head"], f"head>{side}_shoulder:0.3")]
            more += [(f"Braid2 {side}", f"Braid1 {side}", f"{side}_shoulder>head:0.2")]
            more += [(f"Braid3 {side}", f"Braid2 {side}", f"{side}_elbow>head:0.2")]
    if "right_wrist" in ours:
        more += [
            ("Sword1", ours["right_wrist"], "right_wrist>right_elbow:-1"),
            ("Sword2", "Sword1", "right_wrist>right_elbow:-2"),
        ]
    for side, other in (("left", "right"), ("right", "left")):
        more += [(f"Skirt1 {side}", ours["pelvis"], f"pelvis>{side}_shoulder:-0.2")] if "pelvis" in ours else []
        more += [(f"Skirt2 {side}", f"Skirt1 {side}", f"pelvis>{other}_shoulder:-0.9")] if "pelvis" in ours else []
    layout = replace(layout, bones=[*layout.bones, *more])
    clip = held_still(motion(6, 60), layout)
    rig = of(write(layout, clip), **unit_of(layout)).rig
    assert PARTIAL["upper half" if half is upper_half else "lower half"][1] in rig.line()


@pytest.mark.parametrize("sides", [["left"], ["left", "right"]])
@pytest.mark.parametrize("name", USUAL)
def test_arms_without_an_elbow_are_not_shifted(name: str, sides: list[str]) -> None:
    """An arm without a forearm ends at the elbow; its shoulder is not taken for an elbow."""
    whole = EVERY[name]
    cut = without(whole, "|".join(f"{side}_elbow" for side in sides))
    ends: Bones = [("End Site", mapped(whole)[f"{side}_shoulder"], f"{side}_elbow") for side in sides]
    layout = replace(cut, bones=[*cut.bones, *ends])
    with pytest.raises(BodysenseError, match=r"not a humanoid: .*(no left_elbow, left_wrist|that are no arms by name)"):
        of(write(layout, held_still(motion(6, 60), layout)), **unit_of(layout))
