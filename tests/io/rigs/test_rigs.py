"""Files of every rig are read without options to 1 mm; damaged ones are corrected with a remark, or refused."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from further_layouts import FURTHER
from hypothesis import given, settings
from hypothesis import strategies as st
from more_layouts import MORE
from rig_files import Bones, Layout, for_each, held_still, mapped, motion, of_other_size, read_plainly, write
from rig_layouts import LAYOUTS
from scipy.spatial.transform import Rotation

from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.rigged import Rigged, figure_of_file, read_rigged
from bodysense.io.rigs.rig import recognise

EVERY = LAYOUTS | MORE | FURTHER
NEEDED = ["pelvis", "head"] + [
    f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
]


def every(step: int, names: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return each `step`-th layout, and all others."""
    usual = list(names[::step])
    return usual, [name for name in names if name not in usual]


def of(text: str, name: str = "take.bvh", **options) -> Rigged:
    return read_rigged(text.encode(), Path(name), ReadingOptions(**options))


def worst(rigged: Rigged, clip: Clip, layout: Layout) -> float:
    """Return the largest distance, m, between points of the rig and of the written motion."""
    points = [name for name in mapped(layout) if name in rigged.rig.joints]
    assert set(NEEDED) - set(layout.lacks) <= set(points)
    ours = clip.pose.skeleton.indices(points)
    found = forward_kinematics(rigged.clip.pose)[0][:, ours]
    return float(np.linalg.norm(found - forward_kinematics(clip.pose)[0][:, ours], axis=-1).max())


@for_each(*every(3, list(EVERY)))
def test_a_rig_is_read_without_options(name: str) -> None:
    layout = EVERY[name]
    clip = held_still(motion(10, 60), layout)
    text = write(layout, clip)
    rigged = of(text, **unit_of(layout))
    rig = rigged.rig
    expected = {ours: given for ours, given in mapped(layout).items() if ours in rig.joints}
    plain = read_plainly(text)
    there = {ours: rig.to_world(plain[given]) for ours, given in expected.items() if given in plain}
    position = forward_kinematics(rigged.clip.pose)[0]
    for ours, place in there.items():  # an independent reader finds our joints where we do
        error = np.linalg.norm(position[:, rigged.clip.pose.skeleton.index(ours)] - place, axis=-1).max()
        assert error < 1e-3, (ours, rig.joints[ours], error)
    assert worst(rigged, clip, layout) < 1e-3, rig.line()
    assert rig.up == layout.up and rig.unit == pytest.approx(layout.unit)
    assert rig.lift == 0
    assert rig.confidence > 0.4, rig.line()


# --- wrong worlds are corrected and reported ---

WORLDS = {
    "upside down": (Rotation.from_euler("X", 180, degrees=True), 0.0),
    "head over heels": (Rotation.from_euler("Z", 180, degrees=True), 0.0),
    "on its back": (Rotation.from_euler("X", -90, degrees=True), 0.0),
    "on its face": (Rotation.from_euler("X", 90, degrees=True), 0.0),
    "on its side": (Rotation.from_euler("Z", 90, degrees=True), 0.0),
    "without a floor": (None, -0.95),
    "in the air": (None, 0.6),
}


@pytest.mark.slow
@for_each(list(EVERY)[::8])
def test_wrong_worlds_are_corrected_or_refused(name: str) -> None:
    layout = EVERY[name]
    clip = held_still(motion(12, 50), layout)
    points = [point for point in mapped(layout) if not point.endswith(("_top", "_tip"))]
    for world, (turn, shift) in WORLDS.items():
        try:
            rigged = of(write(layout, clip, turn=turn, shift=shift), **unit_of(layout))
        except BodysenseError:
            continue
        if rigged.rig.up == layout.up and any("is taken as up" in line for line in rigged.clip.warnings):
            continue  # it may lie: its rest pose has the axis, and the warning names the option
        found = [point for point in points if point in rigged.rig.joints]
        ours = clip.pose.skeleton.indices(found)
        heights = [forward_kinematics(one.pose)[0][:, ours, 1] for one in (rigged.clip, clip)]
        assert np.abs(heights[0] - heights[1]).max() < 0.06, (world, rigged.rig.line())
        line = rigged.rig.line()
        if turn is None:
            assert "floor at 0," not in line
        elif layout.up == "y":
            assert f", {rigged.rig.up} up," in line or "upside down" in line


def unit_of(layout: Layout) -> dict[str, str]:
    return {} if layout.has_known_unit else {"unit": str(layout.unit)}


# Their thighs and shins are two bones each, so another name tells the part.
DIVIDED_LEGS = ("Rigify", "MakeHuman, default")
ONE_BONE_LEGS = [name for name, one in EVERY.items() if name not in DIVIDED_LEGS and "left_ankle" in mapped(one)]


@for_each(*every(15, ONE_BONE_LEGS))
def test_a_joint_named_leg_is_the_thigh_or_the_shin_by_its_place(name: str) -> None:
    layout, sides = EVERY[name], ("left", "right")
    file, joints = write(layout, held_still(motion(2, 50), layout)).encode(), mapped(layout)
    figure, options = figure_of_file(file, Path("take.bvh")), ReadingOptions(unit=unit_of(layout).get("unit"))
    for part, unnamed in (("hip", "knee"), ("knee", "hip")):
        names = {joints[f"{side}_{part}"]: f"{side.capitalize()}Leg" for side in sides}
        names |= {joints[f"{side}_{unnamed}"]: f"{side.capitalize()}Qwx" for side in sides}
        renamed = replace(figure, joints=tuple(names.get(joint, joint) for joint in figure.joints))
        found = recognise(renamed, options).joints
        legs = {ours: joints[ours] for side in sides for ours in (f"{side}_hip", f"{side}_knee", f"{side}_ankle")}
        assert {ours: found[ours] for ours in legs} == {ours: names.get(legs[ours], legs[ours]) for ours in legs}, part


@pytest.mark.parametrize("scale", [0.3, 2.1, 17.0])
def test_a_body_of_unknown_unit_is_scaled_and_reported(scale: float) -> None:
    clip = of_other_size(motion(6, 50), 1.0)
    rig = of(write(LAYOUTS["Mixamo"], clip, scale=scale)).rig
    assert "unknown unit, scaled to 1.70 m" in rig.line() and rig.height == pytest.approx(1.7)
    given = of(write(LAYOUTS["Mixamo"], clip, scale=scale), unit=str(0.01 / scale), height=1.8)
    assert given.clip.pose.skeleton.height == pytest.approx(1.8)


def test_given_options_override_inferred_values() -> None:
    text = write(LAYOUTS["Unreal"], motion(6, 50))
    rig = of(text, up="y", floor=0.5, unit="in").rig
    assert (rig.up, rig.lift, rig.unit) == ("y", -0.5, 0.0254)
    place = np.random.default_rng(1).normal(size=(4, 3))
    np.testing.assert_allclose(rig.to_world(rig.to_file(place)), place, atol=1e-12)


@pytest.mark.parametrize(("given_option", "message"), [
    ({"unit": "furlong"}, "--unit furlong: give m, cm, mm, in, ft, or the metres of one unit"),
    ({"figure": 0}, "--figure 0: bodies are counted from 1"),
    ({"figure": 3}, r"take.bvh: --figure 3: there is no such body; there are 1 .mixamorig7:Hips"),
])  # fmt: skip
def test_wrong_options(given_option: dict, message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        of(write(LAYOUTS["Mixamo"], motion(3, 50)), **given_option)


# --- rigs at random ---


@st.composite
def rigs(draw: st.DrawFn) -> Layout:
    """A rig at random: some joints are missing, some are more, bones point anywhere, units are any."""
    bones: Bones = []

    def add(place: str, parent: str) -> str:
        name = {"0": "Scene"}.get(place, place.replace(">", "_twist_").partition(":")[0])
        bones.append((name, parent, place))
        return name

    top = add("0", "-") if draw(st.booleans()) else "-"
    pelvis = spine = add("pelvis", top)
    for place in draw(st.sampled_from([["spine1"], ["spine1", "spine3"], ["spine1", "spine2", "spine3"]])):
        spine = add(place, spine)
    neck = add("neck", spine) if draw(st.booleans()) else spine
    head = add("head", neck)
    bones.append(("End Site", head, "head_top"))
    collars, twists, feet, fingers = (draw(st.booleans()) for _ in range(4))
    for side in draw(st.permutations(["left", "right"])):
        shoulder = add(f"{side}_shoulder", add(f"{side}_collar", spine) if collars else spine)
        if twists:
            add(f"{side}_shoulder>{side}_elbow:0.5", shoulder)
        wrist = add(f"{side}_wrist", add(f"{side}_elbow", shoulder))
        for finger in ("thumb", "index", "middle", "ring", "pinky") if fingers else ():
            above = wrist
            for k in (1, 2, 3):
                above = add(f"{side}_{finger}{k}", above)
            bones.append(("End Site", above, f"{side}_{finger}_tip"))
        ankle = add(f"{side}_ankle", add(f"{side}_knee", add(f"{side}_hip", pelvis)))
        last, tip = (add(f"{side}_foot", ankle), "toe") if feet else (ankle, "foot")
        bones.append(("End Site", last, f"{side}_{tip}"))
    return Layout(
        bones,
        unit=draw(st.sampled_from([1.0, 0.01, 0.001, 0.0254])),
        up=draw(st.sampled_from(["y", "z", "-y"])),
        rest=draw(st.sampled_from(["T", "A", "hanging", "along y", "odd"])),
        has_positions=draw(st.booleans()),
    )


def test_a_rig_without_names_is_refused_with_the_way_on() -> None:
    number = {name: f"n{k}" for k, (name, _, _) in enumerate(LAYOUTS["Mixamo"].bones)} | {"-": "-"}
    number["End Site"] = "End Site"
    bones = [(number[name], number[parent], place) for name, parent, place in LAYOUTS["Mixamo"].bones]
    blank = replace(LAYOUTS["Mixamo"], bones=bones)
    with pytest.raises(BodysenseError, match=r"^take.bvh: not a humanoid: .*bodysense data joints take.bvh"):
        of(write(blank, motion(6, 50)))


@settings(max_examples=12)
@given(rigs(), st.integers(0, 30))
def test_rigs_at_random_are_read(layout: Layout, start: int) -> None:
    clip = held_still(motion(10, 40, start), layout)
    rigged = of(write(layout, clip))
    expected = mapped(layout)
    assert not [ours for ours in NEEDED if rigged.rig.joints[ours] != expected[ours]]
    assert rigged.rig.up == layout.up and rigged.rig.unit == layout.unit
    assert worst(rigged, clip, layout) < 1e-3


# --- files that are no person ---


def swinging(bones: list[str]) -> str:
    """A BVH file of bones, each 'name parent x y z', whose joints swing."""
    rows = [bone.split() for bone in bones]

    def tree(name: str, offset: list[str], depth: int) -> str:
        channels = "6 Xposition Yposition Zposition" if not depth else "3"
        below = "".join(tree(row[0], row[2:], depth + 1) for row in rows if row[1] == name)
        below = below or "End Site\n{\nOFFSET 0 0 0\n}\n"
        kind = "JOINT" if depth else "ROOT"
        text = f"{kind} {name}\n{{\nOFFSET {' '.join(offset)}\nCHANNELS {channels} Zrotation Xrotation Yrotation\n"
        return f"{text}{below}}}\n"

    swing = 8 * np.sin(0.4 * np.arange(20)[:, None] + np.arange(3 + 3 * len(rows)))
    swing[:, :3] = [float(x) for x in rows[0][2:]]
    lines = "\n".join(" ".join(f"{x:.3f}" for x in row) for row in swing)
    return f"HIERARCHY\n{tree(rows[0][0], rows[0][2:], 0)}MOTION\nFrames: 20\nFrame Time: 0.03\n{lines}\n"


def beast(legs: int, length: float, tail: int) -> str:
    """A dog, or with more legs something else: a trunk that lies, on legs that are square to it."""
    bones = [
        "spine0 - 0 55 0",
        "spine1 spine0 0 0 20",
        "spine2 spine1 0 0 20",
        "neck spine2 0 12 12",
        "head neck 0 6 10",
    ]
    bones += [f"tail{k} {f'tail{k - 1}' if k else 'spine0'} 0 -2 -12" for k in range(tail)]
    for side, sign in (("l", 1), ("r", -1)):
        for k in range(legs):
            hub = f"spine{min(2, 2 * k)}"
            parts = [(9 * sign, 0, 3 * k), (0, -22, 4), (0, -20, -7), (0, -10, 2), (0, -2, 6)]
            for j, (x, y, z) in enumerate(parts):
                bones.append(f"{side}{k}_{j} {f'{side}{k}_{j - 1}' if j else hub} {x} {y * length} {z}")
    return swinging(bones)


def refusal_time(joints: int, wide: bool) -> float:
    """Return the processor seconds in which a chain of joints, or a star of them, is refused."""
    joint = "JOINT j{}\n{{\nOFFSET 0 .01 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    end = "End Site\n{\nOFFSET 0 1 0\n}\n"
    parts = [joint.format(k) + (end + "}\n" if wide else "") for k in range(joints)]
    tail = "" if wide else end + "}\n" * joints
    head = "HIERARCHY\nROOT r\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n" + "".join(parts) + tail
    text = head + "}\nMOTION\nFrames: 2\nFrame Time: .1\n" + "0 " * 2 * 3 * (joints + 1)
    begun = time.process_time()
    with pytest.raises(BodysenseError, match=r"take.bvh: not a humanoid"):
        of(text)
    return time.process_time() - begun


@pytest.mark.slow
@pytest.mark.parametrize("wide", [False, True])
def test_time_grows_with_joints_not_with_their_square(wide: bool) -> None:
    """Four times the joints take four times as long; sixteen times if each joint were compared with all."""
    few, many = (min(refusal_time(joints, wide) for _ in range(2)) for joints in (2_250, 9_000))
    assert many < 9 * few
