"""Rig: the recognised joints of a figure, and the transform between its world and ours.

Names also tell the family of a rig, which is printed for the user and decides nothing.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import BODY
from bodysense.body.world_axes import TURNS, UpAxis
from bodysense.errors import BodysenseError
from bodysense.io.clip import parts_lacking
from bodysense.io.rigs.body import WORST, find_body
from bodysense.io.rigs.figure import Figure, measured
from bodysense.io.rigs.named import read_joint_map
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions
from bodysense.io.rigs.words import NAMESPACE
from bodysense.io.rigs.world import FLOOR_TOLERANCE, find_floor, find_unit, find_up, stature

# The first family whose names are all present (lower case, no punctuation; '*' matches any beginning).
_FAMILIES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("Mixamo", ("*mixamorig",)),
    ("Reallusion (CC, iClone)", ("*ccbase",)),
    ("VRoid", ("*jbip",)),
    ("3ds Max Biped", ("*bip",)),
    ("CMU", ("lhipjoint", "leftupleg")),
    ("Rocketbox", ("lowerback", "leftupleg", "lefthandindex1")),
    ("cgspeed's Daz and 3ds Max rig", ("lbuttock", "lthigh", "lshldr")),
    ("Daz, Poser", ("lshldr", "lforearm")),
    ("MakeHuman, as MocapNET writes", ("lbuttock", "lhip", "lknee", "lelbow")),
    ("Bandai-Namco", ("jointroot", "upperarml", "lowerarml")),
    ("Xsens, lower-case names", ("lhip", "lknee", "lankle", "lclavicle")),
    ("Xsens MVN", ("pelvis", "l5", "t8")),
    ("Meta", ("broot", "blupleg")),
    ("OpenNI", ("torso", "lefthip", "leftknee", "leftfoot")),
    ("Kinect", ("spinebase", "hipleft")),
    ("Blender Rigify", ("*def",)),
    ("Blender's human metarig", ("thighl", "shinl", "upperarml")),
    ("Unreal", ("pelvis", "thighl", "upperarml")),
    ("Auto-Rig Pro", ("thighstretchl", "armstretchl")),
    ("MakeHuman", ("upperarm01l", "lowerleg02l")),
    ("Daz Genesis", ("lshldrbend", "lthighbend")),
    ("Daz Genesis", ("lupperarm", "lshin", "abdomen")),
    ("ARKit", ("hipsjoint", "spine7joint")),
    ("mocopi", ("torso7", "luparm")),
    ("Second Life", ("mpelvis", "mtorso")),
    ("OptiTrack", ("luarm", "lfarm")),
    ("CMU", ("lfemur", "ltibia", "lhumerus")),
    ("Roblox", ("humanoidrootpart", "lowertorso")),
    ("Rokoko", ("leftthigh", "leftshin", "leftarm")),
    ("Unity, VRM", ("leftupperleg", "leftlowerleg")),
    ("Perception Neuron", ("leftinhandindex",)),
    ("SMPL", ("lefthip", "leftknee", "leftcollar", "spine1")),
    ("SMPL", ("lhip", "lknee", "lcollar", "spine1")),
    ("Biovision", ("lefthip", "leftknee", "leftankle", "leftcollar")),
    ("Biovision", ("leftcollar", "leftuparm", "leftlowarm")),
    ("3-D pose lifter", ("lefthip", "leftknee", "leftankle", "leftelbow")),
    ("Vicon, MotionBuilder", ("leftupleg", "leftleg", "leftforearm")),
    ("MikuMikuDance", ("センター",)),
)


def family_of(names: Sequence[str]) -> str | None:
    """Return the family of rigs with such joint names; None if unknown."""
    plain = {re.sub(r"[\W_]", "", NAMESPACE.sub("", name).lower()) for name in names}
    whole = {re.sub(r"[\W_]", "", name.lower()) for name in names}
    for family, needed in _FAMILIES:
        if all(_has(word, plain, whole) for word in needed):
            return family
    return None


def _has(word: str, plain: set[str], whole: set[str]) -> bool:
    if word.startswith("*"):
        return sum(name.startswith(word[1:]) for name in whole) > 5
    return word in plain


_UNIT_NAMES = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches", "ft": "feet"}


@dataclass(frozen=True, eq=False)
class Rig:
    """A recognised rig: its joints that are ours, and the transform of its world.

    A position in the file is `turn` · position · `unit` + (0, `lift`, 0) in our world (metres, +Y up, floor at 0).
    """

    family: str  # 'Mixamo' …, or 'unnamed'
    joints: Mapping[str, str]  # our joint or end site → the figure's joint or end site
    unit: float  # metres of one file unit
    unit_name: str  # 'centimetres' …; '' if the body was scaled to the usual height
    up: UpAxis  # of the file
    lift: float  # m: added to heights, so that the floor is at 0
    height: float  # m, sole to crown, approximate
    confidence: float  # 0 to 1
    frame_rate: float
    count: int  # joints of the figure
    used: int  # of them, the joints that are ours
    notes: tuple[str, ...] = ()
    turn: np.ndarray = field(init=False, repr=False)  # (4,) our world ← the file's

    def __post_init__(self) -> None:
        object.__setattr__(self, "turn", TURNS[self.up])

    @property
    def hub(self) -> str:
        """The figure's joint that carries the legs: the pelvis, or without one the lowest joint of the spine."""
        return self.joints.get("pelvis") or self.joints["spine1"]

    @property
    def missing(self) -> tuple[str, ...]:
        """Joints of our body (fingers not counted) that the figure lacks; they are filled in."""
        return tuple(name for name in BODY if name not in self.joints)

    @property
    def lacking(self) -> list[str]:
        """Missing joints, without sides, each once."""
        return list(dict.fromkeys(name.removeprefix("left_").removeprefix("right_") for name in self.missing))

    @property
    def made_up(self) -> list[str]:
        """Remarks on how missing large parts of the body are filled in."""
        done = {"head": "its head is put over the shoulders", "legs": "its legs keep still", "arms": "its arms hang"}
        return [done[part] for part in parts_lacking(self.joints)]

    @property
    def has_fingers(self) -> bool:
        """Whether it has finger joints."""
        return any(name.endswith("2") and name[-2:] != "e2" for name in self.joints)

    @property
    def _raised(self) -> np.ndarray:
        return np.array([0.0, self.lift, 0.0])

    def to_world(self, place: np.ndarray) -> np.ndarray:
        """Return positions (..., 3) of the file's world in ours, metres."""
        return quaternion_rotate(self.turn, np.asarray(place, dtype=float) * self.unit) + self._raised

    def to_file(self, place: np.ndarray) -> np.ndarray:
        """Return positions (..., 3) of our world in the file's, in its units."""
        return quaternion_rotate(quaternion_conjugate(self.turn), np.asarray(place) - self._raised) / self.unit

    def turned_to_world(self, rotation: np.ndarray) -> np.ndarray:
        """Return world rotations (..., 4) of the file in our world."""
        return quaternion_multiply(self.turn, rotation)

    def line(self) -> str:
        """Describe the rig in one line."""
        unit = self.unit_name or f"unknown unit, scaled to {self.height:.2f} m"
        floor = "floor at 0" if self.lift == 0 else f"floor at {-self.lift:.2f} m"
        up = {"y": "y up", "-y": "upside down (-y up)"}.get(self.up, f"{self.up} up")
        lacking = f", without {', '.join(self.lacking)}" if self.missing else ""
        fingers = "fingers" if self.has_fingers else "no fingers"
        return (
            f"{self.family}, {self.count} joints, {unit}, {self.height:.2f} m tall, {up}, {floor}, "
            f"{self.frame_rate:g} Hz, {fingers}{lacking}"
            + "".join(f"; {note}" for note in (*self.made_up, *self.notes))
        )


def recognise(figure: Figure, options: ReadingOptions = AS_FOUND) -> Rig:
    """Recognise a figure: its joints, unit, upward axis and floor; `options` take precedence over inference.

    Raises BodysenseError, naming the file, if it is not a humanoid or the options do not fit it.
    """
    tree = measured(figure)
    try:
        if options.joints is None:
            found = find_body(tree)
            points, penalty, remarks = found.points, found.penalty, found.remarks
        else:
            points, penalty, remarks = read_joint_map(options.joints, figure), 0.0, ("joints as given",)
    except BodysenseError as error:
        raise BodysenseError(f"{figure.name}: {error}{_way_on(figure, options)}") from None
    family = family_of(figure.points)
    size = stature(tree, points)
    if not size > 0:
        raise BodysenseError(f"{figure.name}: its bones have no length; export it with its skeleton")
    if options.metres is None:
        unit_name, unit = find_unit(size, family == "CMU")
    else:
        unit_name, unit = _UNIT_NAMES.get(str(options.unit), f"units of {options.metres:g} m"), options.metres
    up, upright = find_up(tree, points) if options.up is None else (options.up, 1.0)
    if upright < 0.1:
        raise BodysenseError(
            f"{figure.name}: it never stands upright, so that no upward axis was found; say which, as --up y or --up z"
        )
    sole = find_floor(tree, points, up) * unit
    lift = -options.floor if options.floor is not None else 0.0 if abs(sole) <= FLOOR_TOLERANCE else -sole
    return Rig(
        family=family or "unnamed rig",
        joints={name: figure.points[point] for name, point in points.items()},
        unit=unit,
        unit_name=unit_name,
        up=up,
        lift=lift,
        height=size * unit,
        confidence=float(np.clip(1 - max(0.0, penalty) / WORST, 0, 1) * np.clip(0.5 + upright / 2, 0, 1)),
        frame_rate=figure.frame_rate,
        count=len(figure.joints),
        used=sum(point < len(figure.joints) for point in points.values()),
        notes=remarks,
    )


def _way_on(figure: Figure, options: ReadingOptions) -> str:
    """Return the advice for an unrecognised body without a joint map."""
    if options.joints is not None:
        return ""
    return (
        f"; if it is a body, say which joint is which: bodysense data joints {figure.name} -o joints.json, and --joints"
    )
