"""BVH files of other programs' rigs, made from one known motion, and an independent reader."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.demo import packaged_performance
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.rigs.figure import Figure
from bodysense.io.rigs.rig import recognise

FINGERS = ("thumb", "index", "middle", "ring", "pinky")
OURS = default_skeleton()
Case = str | tuple[str, ...]  # a rig, or a rig and a change
Bones = list[tuple[str, str, str]]  # name, parent's name or '-', where it is on our body


@cache
def motion(frames: int = 40, step: int = 16, start: int = 0) -> Clip:
    """Some frames of the packaged performance: standing, gestures, sitting down, steps."""
    clip = packaged_performance()
    pose = clip.pose[start : start + frames * step : step]
    return Clip("known", pose, 30.0)


def bones_of(text: str, left: str, right: str, fingers: str = "", hand: str = "*Hand") -> Bones:
    """A rig from lines `name parent place`: '*' stands for a side's name, '@' for left_ or right_.

    A place is a point of ours, or `a>b:0.5`, half way from one to another. `fingers` names a finger's joint with {f}
    (thumb …) or {n} (1 to 5), and {k} (1 to 3).
    """
    bones: Bones = []
    for line in text.strip().splitlines():
        name, parent, place = (part.strip() for part in line.split("|"))
        if "@" in place or "*" in name:
            for word, side in ((left, "left_"), (right, "right_")):
                bones.append((name.replace("*", word), parent.replace("*", word), place.replace("@", side)))
        else:
            bones.append((name, parent, place))
    for word, side in ((left, "left_"), (right, "right_")) if fingers else ():
        for n, finger in enumerate(FINGERS, start=1):
            above = hand.replace("*", word)
            for k in (1, 2, 3):
                name = fingers.format(f=finger, F=finger.capitalize(), n=n, m=n - 1, k=k, j="" if k == 1 else k - 1)
                bones.append((name.replace("*", word), above, f"{side}{finger}{k}"))
                above = name.replace("*", word)
            bones.append(("End Site", above, f"{side}{finger}_tip"))
    return bones


def for_each(
    usual: Iterable[Case], others: Iterable[Case] = ()
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Decorate a check of one case: the test does all usual ones, and as a slow test all others.

    All cases that fail are reported.
    """
    sets = [pytest.param([*usual], id="usual")]
    if remaining := [*others]:
        sets.append(pytest.param(remaining, marks=pytest.mark.slow, id="others"))

    def decorate(check: Callable[..., None]) -> Callable[..., None]:
        @pytest.mark.parametrize("cases", sets)
        def test(cases: list[Case]) -> None:
            errors: list[Exception] = []
            for case in cases:
                try:
                    check(*(case if isinstance(case, tuple) else (case,)))
                except (AssertionError, BodysenseError) as error:
                    error.add_note(f"case: {case}")
                    errors.append(error)
            if errors:
                raise ExceptionGroup(f"{len(errors)} of {len(cases)} cases", errors)

        test.__doc__ = check.__doc__
        return test

    return decorate


@dataclass(frozen=True)
class Layout:
    """A rig and the properties of its files."""

    bones: Bones
    unit: float = 0.01  # metres of a file unit
    up: str = "y"
    rest: str = "T"  # or 'A', 'hanging', 'slanted', 'along y', 'odd'
    orders: tuple[str, ...] = ("ZXY",)  # of channels, taken in turn
    has_positions: bool = False  # position channels on every joint, which override offsets that say nothing
    still: tuple[str, ...] = ()  # joints of ours that must not turn, or the rig cannot hold the motion
    has_known_unit: bool = True  # False: the unit is unknown; the body comes out at 1.70 m
    lacks: tuple[str, ...] = field(default=())  # points of ours that no joint of the rig matches in position
    t_posed: bool = False  # a T-pose stands before the motion


def _turn_of(up: str) -> Rotation:
    """File ← our world."""
    return {
        "y": Rotation.identity(),
        "z": Rotation.from_euler("X", 90, degrees=True),
        "-z": Rotation.from_euler("X", -90, degrees=True),
        "-y": Rotation.from_euler("X", 180, degrees=True),
        "x": Rotation.from_euler("Z", -90, degrees=True),
        "-x": Rotation.from_euler("Z", 90, degrees=True),
    }[up]


def _rest_turns(kind: str, seed: int) -> dict[str, Rotation]:
    """Rotations of our joints in a rig's rest pose, in the world."""
    turns = {name: Rotation.identity() for name in OURS.joints}
    if kind in ("A", "hanging", "slanted"):
        for side, sign in (("left", -1), ("right", 1)):
            parts = {"A": ("shoulder", 45), "hanging": ("shoulder", 86), "slanted": ("hip", -20)}
            part, degrees = parts[kind]
            chain = ("shoulder", "elbow", "wrist") if part == "shoulder" else ("hip", "knee", "ankle", "foot")
            for joint in chain:
                turns[f"{side}_{joint}"] = Rotation.from_euler("Z", sign * degrees, degrees=True)
            if part == "shoulder":
                for finger in FINGERS:
                    for k in (1, 2, 3):
                        turns[f"{side}_{finger}{k}"] = Rotation.from_euler("Z", sign * degrees, degrees=True)
    elif kind == "odd":
        rng = np.random.default_rng(seed)
        turns = {name: Rotation.from_rotvec(rng.normal(scale=1.2, size=3)) for name in OURS.joints}
    return turns


def _along(bone: np.ndarray) -> Rotation:
    """A joint's axes with Y along its bone."""
    length = np.linalg.norm(bone)
    if length < 1e-9:
        return Rotation.identity()
    return Rotation.align_vectors(bone[None] / length, np.array([[0.0, 1.0, 0.0]]))[0]


def write(layout: Layout, clip: Clip, *, turn: Rotation | None = None, shift: float = 0.0, scale: float = 1.0) -> str:
    """A clip as BVH on a rig. `turn` and `shift` spoil the file's world; `scale` is more on top of the unit."""
    skeleton = clip.pose.skeleton
    rest = dict(zip(skeleton.points, skeleton.path @ skeleton.rest_offset, strict=True))
    position, rotation = forward_kinematics(clip.pose)
    world = _turn_of(layout.up) if turn is None else turn * _turn_of(layout.up)
    turns = _rest_turns(layout.rest, 1)

    def spot(place: str) -> tuple[str, np.ndarray]:
        if place == "0":
            return "", np.zeros(3)
        a, _, more = place.partition(">")
        b, _, share = more.partition(":")
        at = rest[a] + float(share or 0) * (rest[b or a] - rest[a])
        carrier = a if a in skeleton.joints else skeleton.joints[skeleton.parents[skeleton.index(a)]]
        return carrier, at

    joints = [bone for bone in layout.bones if bone[0] != "End Site"]
    spots = {name: spot(place) for name, _, place in joints}
    children: dict[str, list[tuple[str, str, str]]] = {}
    for bone in layout.bones:
        children.setdefault(bone[1], []).append(bone)
    frames = {}
    for name, (carrier, at) in spots.items():
        below = [spot(place)[1] for _, parent, place in layout.bones if parent == name]
        frames[name] = (
            _along(below[0] - at)
            if layout.rest == "along y" and below
            else turns.get(carrier, Rotation.identity()).inv()
        )
        if layout.rest == "along y" and not below:
            frames[name] = Rotation.identity()

    @cache
    def pose_of(name: str) -> tuple[np.ndarray, Rotation]:
        """Place (T, 3) and rotation of a joint in the file's world."""
        carrier, at = spots[name]
        if not carrier:
            return np.zeros((len(clip), 3)), Rotation.identity(len(clip))
        k = skeleton.index(carrier)
        turned = Rotation.from_quat(rotation[:, k], scalar_first=True)
        where = position[:, k] + turned.apply(at - rest[carrier]) + [0.0, shift, 0.0]
        return world.apply(where) * scale / layout.unit, world * turned * frames[name]

    lines, columns = [], []

    def emit(bone: tuple[str, str, str], depth: int) -> None:
        name, parent, place = bone
        pad = "  " * depth
        is_site = name == "End Site"
        at = spot(place)[1]
        offset = np.zeros(3)
        if parent != "-":
            offset = frames[parent].inv().apply(at - spots[parent][1]) * scale / layout.unit
        lines.append(f"{pad}{'End Site' if is_site else ('ROOT ' if parent == '-' else 'JOINT ') + name}")
        lines.append(pad + "{")
        offset_written = (
            np.array([0.0, 0.0, 0.043]) / layout.unit
            if layout.has_positions and not is_site and parent != "-"
            else offset
        )
        lines.append(f"{pad}  OFFSET {' '.join(f'{x:.8f}' for x in offset_written)}")
        if not is_site:
            where, turned = pose_of(name)
            if parent != "-":
                above, above_turned = pose_of(parent)
                where, turned = above_turned.inv().apply(where - above), above_turned.inv() * turned
            order = layout.orders[len(columns) % len(layout.orders)]
            has_place = layout.has_positions or parent == "-" or not spots[parent][0]
            channels = ("Xposition Yposition Zposition " if has_place else "") + " ".join(f"{a}rotation" for a in order)
            lines.append(f"{pad}  CHANNELS {len(channels.split())} {channels}")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of gimbal lock, which does not matter here
                angles = turned.as_euler(order, degrees=True)
            columns.append(np.hstack([where, angles] if has_place else [angles]))
            for child in children.get(name, []):
                emit(child, depth + 1)
            if name not in children:
                lines.append(f"{pad}  End Site\n{pad}  {{\n{pad}    OFFSET 0 0 0\n{pad}  }}")
        lines.append(pad + "}")

    for bone in children["-"]:
        emit(bone, 0)
    rows = "\n".join(" ".join(f"{x:.7f}" for x in row) for row in np.hstack(columns))
    head = "HIERARCHY\n" + "\n".join(lines)
    return f"{head}\nMOTION\nFrames: {len(clip)}\nFrame Time: {1 / clip.frame_rate:.9f}\n{rows}\n"


def read_plainly(text: str) -> dict[str, np.ndarray]:
    """World places (T, 3) of all joints of a BVH file, in file units: one plain loop, scipy's rotations."""
    head, body = text.split("MOTION\n")
    values = np.array([[float(x) for x in line.split()] for line in body.splitlines()[2:]])
    stack: list[tuple[np.ndarray, Rotation]] = []
    found: dict[str, np.ndarray] = {}
    column, name, offset = 0, "", np.zeros(3)
    for line in head.splitlines():
        words = line.split()
        if words[0] in ("ROOT", "JOINT"):
            name = " ".join(words[1:])
        elif words[0] == "End":
            name = ""
        elif words[0] == "OFFSET":
            offset = np.array([float(x) for x in words[1:]])
            if not name:
                stack.append(stack[-1])
        elif words[0] == "CHANNELS":
            place, turn = np.tile(offset, (len(values), 1)), Rotation.identity()
            for channel in words[2:]:
                if channel[1:] == "position":
                    place[:, "XYZ".index(channel[0])] = values[:, column]
                else:
                    turn = turn * Rotation.from_euler(channel[0], values[:, column : column + 1], degrees=True)
                column += 1
            if stack:
                above, turned = stack[-1]
                place, turn = above + turned.apply(place), turned * turn
            stack.append((place, turn))
            found[name] = place
        elif words[0] == "}":
            stack.pop()
    return found


def held_still(clip: Clip, layout: Layout) -> Clip:
    """Return the clip without rotations of joints that a rig lacks, so that the rig represents it exactly."""
    carriers = {re.split(">", place)[0] for name, _, place in layout.bones if name != "End Site"}
    rotation = clip.pose.rotation.copy()
    for k, joint in enumerate(clip.pose.skeleton.joints):
        if joint not in carriers or joint in layout.still:
            rotation[:, k] = [1, 0, 0, 0]
    root = clip.pose.root_position
    if layout.t_posed:
        rotation = np.concatenate([np.broadcast_to([1.0, 0, 0, 0], rotation[:1].shape), rotation])
        root = np.concatenate([clip.pose.skeleton.rest_offset[:1], root])
    return Clip(clip.name, Pose(clip.pose.skeleton, root, rotation), clip.frame_rate)


def of_other_size(clip: Clip, scale: float) -> Clip:
    """Return the rotations on a larger or smaller body."""
    skeleton = clip.pose.skeleton
    body = skeleton.with_offsets(skeleton.rest_offset * scale)
    return Clip(clip.name, Pose(body, clip.pose.root_position * scale, clip.pose.rotation), clip.frame_rate)


def mapped(layout: Layout) -> dict[str, str]:
    """Our point → the rig's joint, of joints that are where a point of ours is."""
    found = {}
    for name, _, place in layout.bones:
        if re.fullmatch(r"[a-z]\w+", place) and name != "End Site" and place not in layout.lacks:
            found.setdefault(place, name)
    return found


def joints_in(clip: Clip) -> dict[str, str]:
    """The joints that are recognised in a motion in memory, {name in the clip: ours}."""
    pose, skeleton = clip.pose, clip.pose.skeleton
    figure = Figure(
        name=clip.name,
        joints=skeleton.joints,
        end_sites=skeleton.end_sites,
        parents=skeleton.parents,
        offset=skeleton.rest_offset,
        rotation=np.asarray(pose.rotation),
        position={0: np.asarray(pose.root_position)},
        frame_rate=clip.frame_rate,
        nodes=tuple(range(len(skeleton.points))),
    )
    rig = recognise(figure, ReadingOptions(unit="m", up="y", floor=0.0))
    return {given: ours for ours, given in rig.joints.items()}
