"""Rig: the recognised joints of a figure, and the transform between its world and ours.

Joints are those of a joint map, if one is given: JSON, {name in the file: ours}, '' for joints that are omitted. Unit,
upward axis and floor are inferred from gravity and a person's size, unless options give them.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_json
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import parts_lacking
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.rigs.body import WORST
from bodysense.io.rigs.figure import Figure, Tree, measured, usual_length
from bodysense.io.rigs.halves import find_body
from bodysense.io.rigs.names import ARMS, LEGS, family_of
from bodysense.observing.world import HABIT, REST_POSE, clearance_of, doubts, judged_up, moments, told_warning
from bodysense.observing.world_axes import TURNS, UpAxis

_PERSON = (1.3, 2.3)  # m: height of a person
_CHILD = 0.9  # m: height of a smaller person, allowed in metres, centimetres or millimetres
USUAL_HEIGHT = 1.70  # m: height given to a body of unknown unit
_FLOOR_TOLERANCE = 0.10  # m: soles this close to zero are on the floor
_UNIT_NAMES = {"m": "metres", "cm": "centimetres", "mm": "millimetres", "in": "inches", "ft": "feet"}
_KNOWN_UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "units of 0.056444 m": 0.056444,
}
_CMU_TENTH = ("units of 0.0056444 m", 0.0056444)

_PELVIS = (0.15, 0.62)  # of a person's height: range of the pelvis's height while sitting or standing
_SOLE = {"ankle": 0.08, "foot": 0.02, "toe": 0.0}  # of a leg's length: height of each joint above the sole
_NEVER_UPRIGHT = 0.5  # mean cosine of body and axis below which an axis without other evidence is not upward
_ALONG = 0.85  # least cosine of trunk and legs with the axis along which a rest pose stands
_SAME_LENGTH = 0.35  # share by which bones of the rest pose and of the motion may differ
_SIDES = ("left", "right")

_Places = Mapping[str, np.ndarray]  # (S, 3) of points of ours, by name, file units


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
    warnings: tuple[str, ...] = ()  # doubts about its world, with the option that settles each

    @property
    def turn(self) -> np.ndarray:
        """Rotation (4,) of our world ← the file's."""
        return TURNS[self.up]

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


def recognise(figure: Figure, options: ReadingOptions = AS_FOUND, format_up: UpAxis | None = None) -> Rig:
    """Recognise a figure: its joints, unit, upward axis and floor; `options` take precedence over inference.

    `format_up` is the upward axis that a format defines, which is taken unchecked.

    Raises BodysenseError, naming the file, if it is not a humanoid or the options do not fit it.
    """
    tree = measured(figure)
    try:
        if options.joints is None:
            found = find_body(tree)
            points, penalty, remarks = found.points, found.penalty, ()
        else:
            points, penalty, remarks = _mapped(options.joints, figure.points), 0.0, ("joints as given",)
    except BodysenseError as error:
        way_on = f"; if it is a body, name its joints: bodysense data joints {figure.name} -o joints.json, and --joints"
        raise BodysenseError(f"{figure.name}: {error}{'' if options.joints else way_on}") from None
    place = {name: tree.place[:, point] for name, point in points.items()}
    family, size = family_of(figure.points), _stature(place)
    if not size > 0:
        raise BodysenseError(f"{figure.name}: its bones have no length; export it with its skeleton")
    if options.metres is None:
        unit_name, unit = _find_unit(size, family == "CMU")
    else:
        unit_name, unit = _UNIT_NAMES.get(str(options.unit), f"units of {options.metres:g} m"), options.metres
    if format_up is None:
        up, upright, warnings = _upward(tree, points, size, options.up)
    else:
        up, upright, warnings = format_up, 1.0, []
    sole = _find_floor(place, size, up) * unit
    lift = -options.floor if options.floor is not None else 0.0 if abs(sole) <= _FLOOR_TOLERANCE else -sole
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
        warnings=tuple(warnings),
    )


# --- joint maps ---


def joint_map(path: Path) -> dict[str, str]:
    """Return a joint map, {name in the file: ours}, without omitted joints. Raises BodysenseError for other files."""
    table = read_json(path, "draft it with bodysense data joints", "--joints")
    if not isinstance(table, dict) or not all(isinstance(ours, str) for ours in table.values()):
        raise BodysenseError(f'--joints {path}: must be one object of names, {{"name in the file": "our name"}}')
    return {given: ours for given, ours in table.items() if ours}


def _mapped(path: Path, points: Sequence[str]) -> dict[str, int]:
    """Return the points that a joint map names, {ours: index}. Raises BodysenseError if it does not fit them."""
    index, known = {name: point for point, name in enumerate(points)}, default_skeleton().points
    found: dict[str, int] = {}
    for given, ours in joint_map(path).items():
        if given not in index:
            raise BodysenseError(f"--joints {path}: the file has no joint {given!r}{_near(given, points)}")
        if ours not in known:
            raise BodysenseError(f"--joints {path}: no joint of ours is {ours!r}{_near(ours, known)}")
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


def _near(name: str, names: Sequence[str]) -> str:
    """Return the nearest known names, for a message."""
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    return f"; near are {', '.join(near)}" if near else ""


def joint_map_text(points: Sequence[str], joints: Mapping[str, str]) -> str:
    """Return the draft of a joint map: every point of a file, with our name for it or ''; `joints` is {ours: given}."""
    ours = {given: name for name, given in joints.items()}
    return json.dumps({name: ours.get(name, "") for name in points}, indent=1, ensure_ascii=False) + "\n"


# --- units, upward axis and floor ---


def _stature(place: _Places) -> float:
    """Return the height of a body, sole to crown, in file units, from its legs and trunk, or arms and trunk."""
    body = default_skeleton()
    rest = body.path @ body.rest_offset
    usual = {name: rest[None, body.index(name)] for name in place if name in body.points}
    limb = ("hip", "knee", "ankle") if "left_hip" in place else ("shoulder", "elbow", "wrist")
    found, default = (
        sum(_bone(one, f"{side}_{a}", f"{side}_{b}") for side in ("left", "right") for a, b in pairwise(limb)) / 2
        + usual_length(_trunk(one))
        for one in (place, usual)
    )
    return body.height * found / default


def _bone(place: _Places, start: str, end: str) -> float:
    return usual_length(place[start] - place[end])


def _middle(place: _Places, part: str) -> np.ndarray:
    """Return the midpoint (S, 3) of left and right; the pelvis of a body that lacks the part."""
    return (place[f"left_{part}"] + place[f"right_{part}"]) / 2 if f"left_{part}" in place else place["pelvis"]


def _trunk(place: _Places) -> np.ndarray:
    """Return the vector (S, 3) from hips to shoulders, or to or from the pelvis of half a body."""
    return _middle(place, "shoulder") - _middle(place, "hip")


def _find_unit(height: float, is_cmu: bool) -> tuple[str, float]:
    """Return name and metres of the unit in which a body measures `height`."""
    low, high = _PERSON
    for name, metres in [*_KNOWN_UNITS.items(), *([_CMU_TENTH] if is_cmu else [])]:
        if low <= height * metres <= high:
            return name, metres
    for name in ("metres", "centimetres", "millimetres"):
        if _CHILD <= height * _KNOWN_UNITS[name] < low:
            return name, _KNOWN_UNITS[name]
    return "", USUAL_HEIGHT / height


def _upward(tree: Tree, points: Mapping[str, int], size: float, told: UpAxis | None) -> tuple[UpAxis, float, list[str]]:
    """Return the upward axis, the mean cosine between the body and it, and warnings.

    Raises BodysenseError if no axis is likely, and for a told axis that the motion contradicts.
    """
    figure, metres = tree.figure, USUAL_HEIGHT / size
    points = {name: point for name, point in points.items() if name in BODY or name.endswith(("_toe", "_top"))}
    names = list(points)
    first, later, moment = moments(len(figure), figure.frame_rate)
    place, after = (figure.frames(frames).world(list(points.values()))[0] * metres for frames in (first, later))
    by_name = {name: place[:, k] for k, name in enumerate(names)}
    if "left_hip" in points:
        body = _middle(by_name, "shoulder") - _middle(by_name, "ankle")
    else:  # what it stands on is not in the file
        body, place, after = _trunk(by_name), place * np.nan, after * np.nan
    rest = _resting_axis(tree, points)
    words: dict[UpAxis, float] = {"y": HABIT} if rest is None else {rest: REST_POSE}
    clearance = clearance_of(names)
    found = judged_up(place, after, moment, body, clearance=clearance, words=words)
    if told is not None:
        return told, 1.0, told_warning(told, judged_up(place, after, moment, body, clearance=clearance))
    if rest is None and found.is_unsure and found.stands < _NEVER_UPRIGHT:
        raise BodysenseError(
            f"{figure.name}: it never stands upright, so that no upward axis was found; give it, as --up y or --up z"
        )
    if rest is None:
        found = replace(found, word=None)
    return found.axis, max(found.stands, 0.0 if rest is None else 0.5), doubts(found, "its rest pose")


def _resting_axis(tree: Tree, points: Mapping[str, int]) -> UpAxis | None:
    """Return the axis along which the file's rest pose stands; None if it is not a standing body of the same size."""
    if "left_hip" not in points or "left_shoulder" not in points:
        return None
    rest = tree.figure.offset.copy()
    for point, parent in enumerate(tree.figure.parents):
        if parent >= 0:
            rest[point] += rest[parent]
    place = {name: rest[point][None] for name, point in points.items()}
    for side in ("left", "right"):
        for a, b in (*pairwise(f"{side}_{part}" for part in ("hip", "knee", "ankle")),):
            usual = tree.distance(points[a], points[b])
            if not abs(_bone(place, a, b) - usual) < _SAME_LENGTH * usual:
                return None
    way = np.stack([_trunk(place)[0], *(place[f"{side}_hip"][0] - place[f"{side}_ankle"][0] for side in _SIDES)])
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    if not (length > 0).all():
        return None
    way = way / length
    mean = way.mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if not (np.sign(mean[axis]) * way[:, axis] > _ALONG).all():
        return None
    return cast(UpAxis, ("" if mean[axis] > 0 else "-") + "xyz"[axis])


def _find_floor(place: _Places, size: float, up: UpAxis) -> float:
    """Return the lowest height of the soles along the upward axis, file units.

    Without legs it is 0 if the pelvis is at the height of a standing or sitting one, else inferred from the pelvis.
    """
    turned = quaternion_rotate(TURNS[up], np.stack(list(place.values())))
    height = dict(zip(place, turned[..., 1], strict=True))
    if "left_hip" not in place:
        pelvis = float(np.median(height["pelvis"]))
        body, (low, high) = default_skeleton(), _PELVIS
        return 0.0 if low * size < pelvis < high * size else pelvis - size * body.rest_offset[0, 1] / body.height
    leg = _bone(place, "left_hip", "left_knee") + _bone(place, "left_knee", "left_ankle")
    soles = [height[name] - _SOLE[part] * leg for name in place if (part := name.partition("_")[2]) in _SOLE]
    # People who lie, crawl or stand on their hands rest on other joints.
    others = [name for name in place if name in BODY and name.partition("_")[2] not in _SOLE]
    resting = clearance_of(others) * size / USUAL_HEIGHT
    lowest = [*soles, *(height[name] - over for name, over in zip(others, resting, strict=True))]
    return float(np.percentile(np.min(lowest, axis=0), 5))
