"""Marker sets: the labels of a set, and recipes that compute points of the body. A set is one file in `sets/`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from importlib.resources import files
from typing import Any

from bodysense.body.hands.glove_set import plain
from bodysense.body.hands.hand import FINGERS
from bodysense.body.skeleton import default_skeleton
from bodysense.io.rigs.names import joints_of, words

FEWEST = 4  # fewest points of a body
JOINT_ACCURACY = 0.02  # m, of a marker named as a joint: the joint's centre, or a spot on the skin near it
_SIDES = {"left": ("L", "R"), "right": ("R", "L")}


@dataclass(frozen=True)
class SegmentFrame:
    """Axes of a segment from two directions, each from the mean of some markers to the mean of others."""

    name: str
    axes: tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...]  # the second is made orthogonal to the first
    joint: str | None = None  # the joint that has this rotation
    pitch: float = 0.0  # degrees by which its forward axis points below a standing body's
    lift: float = 0.0  # degrees by which its outward axis points above
    standing: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)  # m, usual positions
    either_side_of: str | None = None  # the frame whose left axis decides the side of marker 'left'


@dataclass(frozen=True)
class Recipe:
    """How a point is computed from markers and earlier points."""

    name: str
    how: str  # mean, hip, hinge, shoulder: `centres`
    markers: tuple[str, ...]
    accuracy: float  # m
    frames: tuple[str, ...] = ()  # the segment whose axes the offset is in; for a hinge, its two neighbours
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m: out (left, on the right side right), up, forward
    depth: float = 0.0  # m from the skin to the centre
    bends: str = ""  # forward, backward: of a hinge
    side: float = 1.0  # -1 on the right


@dataclass(frozen=True)
class MarkerSet:
    """A marker set with both sides expanded."""

    name: str
    labels: Mapping[str, str]  # normalised by `plain` → the set's own
    frames: tuple[SegmentFrame, ...] = ()
    points: tuple[Recipe, ...] = ()
    spans: tuple[tuple[str, str, float], ...] = ()  # usual distances, m
    low: tuple[str, ...] = ()
    high: tuple[str, ...] = ()
    floor: tuple[tuple[str, float], ...] = ()  # usual heights on a standing body, m
    bones: Mapping[str, str] = field(default_factory=dict)  # label → the joint whose rotation it has
    needs: str = ""  # a label without which a file is not of the set


@dataclass(frozen=True)
class Recognised:
    """The markers of a file assigned to a set."""

    markers: MarkerSet
    columns: Mapping[str, int]  # the set's label → the marker's index in the file


@lru_cache(maxsize=1)
def marker_sets() -> tuple[MarkerSet, ...]:
    """Return the packaged sets."""
    folder = files("bodysense.io.markers.sets")
    found = sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".toml"))
    return tuple(_parsed(tomllib.loads(folder.joinpath(name).read_text(encoding="utf-8"))) for name in found)


def recognised(names: Sequence[str], table: Mapping[str, str] | None = None) -> Recognised | None:
    """Return the set that yields the most points, among packaged sets and markers named as joints; or None.

    `table` names joints explicitly, and takes precedence.
    """
    if table:
        joints = {ours: k for k, name in enumerate(names) if (ours := table.get(name)) in default_skeleton().points}
        return (
            Recognised(_named(tuple(map(str, joints))), {str(ours): k for ours, k in joints.items()})
            if joints
            else None
        )
    best, most = None, (FEWEST - 1, len(names))
    for one in (*marker_sets(), None):
        found = _joints(names) if one is None else _columns(one, names)
        chosen = _named(tuple(found)) if one is None else one
        points = {recipe.name for recipe in chosen.points if follows(recipe, chosen, found)}
        count = len(points) if one is not None else len([name for name in points if not _of_hand(name)])
        sure = one is not None or best is None or len(found) > len(best.columns)  # a set goes before names alone
        if (count, len(found)) > most and sure:
            best, most = Recognised(chosen, found), (count, len(found))
    return None if best is None else _with_named_joints(best, names)


def _with_named_joints(best: Recognised, names: Sequence[str]) -> Recognised:
    """Add markers named as joints, such as 'Head' or 'Pelvis', that the set lacks and from which no joint follows."""
    taken = set(best.columns.values())
    rest = [name if k not in taken else "" for k, name in enumerate(names)]
    have = {recipe.name for recipe in best.markers.points if follows(recipe, best.markers, best.columns)}
    more = {ours: k for ours, k in _joints(rest).items() if ours not in have and not _of_hand(ours)}
    labels = {f"joint {ours}": k for ours, k in more.items()}
    points = tuple(Recipe(ours, "mean", (f"joint {ours}",), JOINT_ACCURACY) for ours in more)
    return Recognised(replace(best.markers, points=best.markers.points + points), {**best.columns, **labels})


def _of_hand(name: str) -> bool:
    """Whether a point is of a hand: a set of fingers has a wrist as well, but is not a body."""
    return name.partition("_")[2].startswith(("wrist", *FINGERS))


def follows(recipe: Recipe, markers: MarkerSet, found: Mapping[str, int]) -> bool:
    """Whether a point can be computed from the markers found, directly or through other points."""
    return all(
        name in found or any(other.name == name and follows(other, markers, found) for other in markers.points)
        for name in recipe.markers
    )


def nearest(names: Sequence[str]) -> str:
    """Describe unknown labels: which set is nearest, and how many of its markers are present."""
    counts = {one.name: len(_columns(one, names)) for one in marker_sets()}
    name = max(counts, key=lambda key: counts[key])
    return f"{counts[name]} of them are of {name}" if counts[name] else "none is of a marker set that is known"


def _columns(one: MarkerSet, names: Sequence[str]) -> dict[str, int]:
    """Return the first marker of each label; text before a '_' may be the subject's name."""
    found: dict[str, int] = {}
    for k, name in enumerate(names):
        tail = name.rpartition(":")[2]
        for candidate in (tail, *(tail[at.end() :] for at in re.finditer("[_ .]", tail))):
            label = one.labels.get(plain(candidate))
            if label is not None:
                found.setdefault(label, k)
                break
    return found if not one.needs or one.needs in found else {}


_TURNED = ("pelvis", "spine3", "head", *(f"{side}_{part}" for side in _SIDES for part in ("wrist", "ankle")))


_ON_MUSCLES = frozenset(("bicep", "biceps"))  # bones of rigs, but markers in the middle of a limb


def _joints(names: Sequence[str]) -> dict[str, int]:
    """Return markers named as joints: 'LeftElbow', 'l_knee', 'RHJC', or a program's name of the joint."""
    ours = joints_of([name for name in names if not _ON_MUSCLES & set(words(name))])
    return {ours[name]: k for k, name in enumerate(names) if name in ours}


def _named(points: tuple[str, ...]) -> MarkerSet:
    """Return the set of markers named as joints."""
    spans = [("hip", "knee", 0.41), ("knee", "ankle", 0.41), ("shoulder", "elbow", 0.27), ("elbow", "wrist", 0.24)]
    return MarkerSet(
        name="markers named as joints",
        labels={plain(name): name for name in points},
        points=tuple(Recipe(name, "mean", (name,), JOINT_ACCURACY) for name in points),
        spans=tuple((f"{side}_{a}", f"{side}_{b}", d) for side in _SIDES for a, b, d in spans),
        low=("left_ankle", "right_ankle", "left_foot", "right_foot"),
        high=("pelvis", "left_hip", "right_hip", "left_shoulder", "right_shoulder", "neck", "head"),
        floor=tuple((f"{side}_{name}", high) for side in _SIDES for name, high in (("ankle", 0.08), ("foot", 0.03))),
        bones={name: name for name in _TURNED if name in points},
    )


def _parsed(stored: dict[str, Any]) -> MarkerSet:
    """Parse a set's file and expand both sides; a set of `landmarks` uses labels as names of those."""
    named = stored["labels"]
    if "landmarks" in stored:
        folder = files("bodysense.io.markers.landmarks")
        stored = tomllib.loads(folder.joinpath(f"{stored['landmarks']}.toml").read_text(encoding="utf-8")) | stored
        stored["other_labels"], named = named, stored.get("others", ())
    labels = {plain(label): label for written in named for label in _both_sides(written)}
    for theirs, ours in stored.get("other_labels", {}).items():
        for label, own in zip(_both_sides(theirs), _both_sides(ours), strict=True):
            labels.setdefault(plain(label), own)
    frames = [
        SegmentFrame(
            name=_point(row["name"], side),
            joint=_point(row["joint"], side) if "joint" in row else None,
            axes=tuple(
                (axis, _ends(row[axis][0], side), _ends(row[axis][1], side))
                for axis in row
                if axis in ("left", "up", "forward", "out")
            ),
            pitch=row.get("pitch", 0.0),
            lift=row.get("lift", 0.0),
            standing={name: tuple(place) for name, place in row.get("standing", {}).items()},
            either_side_of=row.get("either_side_of"),
        )
        for row in stored.get("frame", ())
        for side in _sides_of(row["name"])
    ]
    points = [
        Recipe(
            name=_point(row["name"], side),
            how=row["how"],
            markers=tuple(_label(name, side) for name in row["from"]),
            accuracy=row["accuracy"],
            frames=tuple(_point(name, side) for name in row.get("frames", ())),
            offset=tuple(row.get("offset", (0.0, 0.0, 0.0))),
            depth=row.get("depth", 0.0),
            bends=row.get("bends", ""),
            side=-1.0 if side == "right" else 1.0,
        )
        for row in stored["point"]
        for side in _sides_of(row["name"])
    ]
    whole = MarkerSet(
        name=stored["name"],
        labels=labels,
        frames=tuple(frames),
        points=tuple(points),
        spans=tuple(
            (own, other, far)
            for a, b, far in stored["spans"]
            for own, other in dict.fromkeys(zip(_both_sides(a), _both_sides(b), strict=True))
        ),
        low=tuple(label for name in stored["low"] for label in _both_sides(name)),
        high=tuple(label for name in stored["high"] for label in _both_sides(name)),
        floor=tuple((label, high) for name, high in stored["floor"] for label in _both_sides(name)),
        bones={
            _label(name, side): _point(joint, side)
            for name, joint in stored.get("bones", {}).items()
            for side in _sides_of(name)
        },
        needs=stored.get("needs", ""),
    )
    return _without_missing_landmarks(whole) if "landmarks" in stored else whole


def _without_missing_landmarks(whole: MarkerSet) -> MarkerSet:
    """Drop recipes that need landmarks missing from the set."""
    has = set(whole.labels.values())
    frames = tuple(
        frame for frame in whole.frames if has >= {name for _, start, end in frame.axes for name in (*start, *end)}
    )
    named = {frame.name for frame in frames}
    points = tuple(
        replace(recipe, frames=tuple(name for name in recipe.frames if name in named))
        for recipe in whole.points
        if follows(recipe, whole, dict.fromkeys(has, 0)) and (recipe.how == "hinge" or named >= set(recipe.frames))
    )
    return replace(
        whole,
        frames=frames,
        points=points,
        spans=tuple(span for span in whole.spans if has >= {*span[:2]}),
        low=tuple(name for name in whole.low if name in has),
        high=tuple(name for name in whole.high if name in has),
        floor=tuple((name, high) for name, high in whole.floor if name in has),
    )


def _ends(names: Sequence[str], side: str) -> tuple[str, ...]:
    return tuple(_label(name, side) for name in names)


def _sides_of(name: str) -> tuple[str, ...]:
    return tuple(_SIDES) if "*" in name else ("",)


def _both_sides(name: str) -> tuple[str, ...]:
    """Return a label on both sides; twice the same label if it is in the middle."""
    return tuple(name.replace("*", own).replace("@", side) for side, (own, _) in _SIDES.items())


def _label(name: str, side: str) -> str:
    """Return a label, or a point, on a side; '~' is the other side."""
    if not side:
        return name
    if name.startswith("*_") and name[2:3].islower():
        return _point(name, side)
    own, other = _SIDES[side]
    return name.replace("*", own).replace("~", other)


def _point(name: str, side: str) -> str:
    return name.replace("*", side)
