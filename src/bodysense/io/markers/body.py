"""Body from markers: recognise the set, infer unit, up axis and floor, and compute joints."""

from __future__ import annotations

import re
import warnings
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import cast

import numpy as np

from bodysense.body.hands.glove_set import plain
from bodysense.body.hands.hand import FINGERS
from bodysense.body.skeleton import BODY, LEG, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import matrix_to_quaternion, quaternion_multiply, quaternion_rotate
from bodysense.io.markers.body_layout import (
    MarkerLayout,
    add_centres,
    observed_points,
    segment_axes,
    segment_rotations,
)
from bodysense.io.markers.centres import Places
from bodysense.io.markers.marker_sets import MarkerSet, Recognised
from bodysense.io.markers.raw_markers import (
    METRES,
    MarkerFormat,
    MarkerRecording,
    RawMarkers,
    Unit,
    convert_world,
    file_axes,
    listed,
    world_of,
)
from bodysense.observing.world import (
    USUAL,
    check_overruled,
    clearance_of,
    doubts,
    judged_up,
    moments,
    signed,
    told_warning,
)
from bodysense.observing.world_axes import TURNS, UpAxis
from bodysense.quality.plausible import doubts_about, flat_doubt, mirror_fix

SIZES = (0.55, 1.45)  # of an adult's size: range of a person's
SEEN = 0.1  # share of the frames in which a marker must be seen
FLOOR = 0.08  # m: a floor closer to 0 is taken as 0
UNKNOWN = 0.5  # share of unknown labels from which the recognised set is doubtful
SURE = 8  # joints that are enough for a set with that share of unknown labels
BETWEEN = 0.04  # m from the middle of an adult's hips: a pelvis that is closer is that middle
HANGING_ERROR = 0.26  # m: mean distance of walking people's wrists from hanging ones (20 validation clips of CMU)
_UNNAMED = re.compile(r"(\*|unlabel|u_?\d|new \d|uname)", re.IGNORECASE)  # labels that programs give to unnamed points
_LIMBS = (  # a bone's name, its end, its direction at rest; in Motive's words, then in ours
    ("UArm", "FArm", (1.0, 0.0, 0.0)),
    ("Thigh", "Shin", (0.0, -1.0, 0.0)),
    ("Shin", "Foot", (0.0, -1.0, 0.0)),
    ("shoulder", "elbow", (1.0, 0.0, 0.0)),
    ("hip", "knee", (0.0, -1.0, 0.0)),
    ("knee", "ankle", (0.0, -1.0, 0.0)),
)
AGREES = np.deg2rad(25.0)  # rad; the rotations of a file are used if they take our bones this close to its own


def body_of(
    raw: RawMarkers, form: MarkerFormat, known: Recognised, place: str, of_gloves: Mapping[str, str] = {}
) -> MarkerRecording:
    """Compute the points of the body that wears a marker set; `of_gloves` names the markers of gloves in the same file.

    Raises BodysenseError, naming `place`, if the markers are not on a body.
    """
    file_markers, markers, columns = raw, known.markers, known.columns
    share = np.isfinite(raw.position[..., 0]).mean(axis=0)
    here = {name: k for name, k in columns.items() if share[k] >= SEEN}
    file = {name: raw.position[:, k] for name, k in here.items()}
    if (flat := flat_doubt(file)) is not None:
        raise BodysenseError(f"{place}: {flat.text}")
    remarks = [_recognised(raw, known, here)]
    unit, size = _unit(markers, file, raw, form, place, remarks)
    raw = replace(raw, unit=unit)
    places: Places = {name: convert_world(position, raw, form) for name, position in file.items()}
    with np.errstate(invalid="ignore", divide="ignore"):
        accuracy, lengths = add_centres(markers, places, segment_axes(markers, places).axes, size)
    raw, alarms = _turned_upright(raw, places, accuracy, size, form, place, remarks)
    floor = _lower_to_floor(markers, places, accuracy, form, remarks)
    rotations, turn = _bones(raw, known, here, places, remarks)
    with np.errstate(invalid="ignore", divide="ignore"):
        frames, _, mirrored = segment_axes(markers, places)
        _check_mirror(markers, places, frames, place, form.left_handed)
        alarms += _check_body(places, accuracy, raw.frame_rate, place, form)
        hips = [places[name] for name in ("pelvis", "left_hip", "right_hip") if name in accuracy]
        apart = np.linalg.norm(hips[0] - (hips[1] + hips[2]) / 2, axis=-1) if len(hips) == 3 else np.array([np.nan])
        if np.isfinite(apart).any() and np.nanmedian(apart) < BETWEEN * size:  # as in key points of a video
            del accuracy["pelvis"]
            remarks.append("the pelvis is left out: it is the middle of the hips, and ours is 9 cm over it")
        rotations |= segment_rotations(markers, frames, rotations)
    others = _unknown_labels(raw, known, accuracy, place, of_gloves)
    world = world_of(raw, form, floor)
    observation = observed_points(raw.time, places, rotations, accuracy)
    seen = np.asarray(observation.has_position.any(axis=0) | observation.has_rotation.any(axis=0))
    points = [name for name, is_seen in zip(observation.points, seen, strict=True) if is_seen]
    arms_hang = not of_gloves and all(name.rpartition("_")[2] in ("pelvis", *LEG) for name in points)
    alarms = (
        *alarms,
        *_duplicate_warning(raw, known),
        *_guess_warning([*points, *of_gloves.values()], others, arms_hang),
    )
    return MarkerRecording(
        observation=observation,
        frame_rate=raw.frame_rate,
        sizes={},
        remarks=tuple(remarks),
        raw=file_markers,
        world=world,
        layout=MarkerLayout(markers, here, size, lengths, mirrored, accuracy, world, turn),
        warnings=alarms,
        arms_hang=arms_hang,
    )


def _recognised(raw: RawMarkers, known: Recognised, here: Mapping[str, int]) -> str:
    """Describe the recognised set in one line."""
    others = [name for k, name in enumerate(raw.names) if k not in known.columns.values()]
    rarely = [name for name in known.columns if name not in here]
    text = f"{known.markers.name}: {len(here)} markers at {raw.frame_rate:g} Hz"
    text += f"; hardly seen: {listed(rarely)}" if rarely else ""
    return text + (f"; left out: {listed(others)}" if others else "")


def _unknown_labels(
    raw: RawMarkers, known: Recognised, accuracy: Mapping[str, float], place: str, of_gloves: Mapping[str, str]
) -> list[str]:
    """Return the unknown labels.

    Raises BodysenseError if many are unknown and so few points follow that the set is doubtful.
    """
    used = {*(raw.names[k] for k in known.columns.values()), *of_gloves}
    others = [name for name in raw.names if name not in used and not _UNNAMED.match(name)]
    if len(others) >= UNKNOWN * (len(others) + len(known.columns)) and len(accuracy) < SURE:
        raise BodysenseError(
            f"{place}: {len(known.columns)} labels are of {known.markers.name}, too few to be sure; {len(others)} are "
            f"unknown: {listed(others)}; map them in a table of names, --names (docs/markers.md)"
        )
    return others


def _duplicate_warning(raw: RawMarkers, known: Recognised) -> list[str]:
    """Return a warning about duplicate labels, or nothing."""
    labels = [plain(name.rpartition(":")[2]) for name in raw.names]
    used = {labels[k] for k in known.columns.values()}
    unused = sorted(set(range(len(labels))) - set(known.columns.values()))
    again = [raw.names[k] for k in unused if labels[k] in used]
    return [f"duplicate labels: {listed(again)}; only the first marker of each is used"] if again else []


def _guess_warning(points: Collection[str], others: list[str], arms_hang: bool) -> list[str]:
    """Return a warning about limbs without a joint: how they are completed, and the unknown labels."""
    parts = {"arm": ("elbow", "wrist", "glove", *FINGERS), "leg": ("knee", "ankle", "foot")}
    limbs = {f"{side} {limb}": (side, parts[limb]) for limb in parts for side in ("left", "right")}
    bare = [
        limb
        for limb, (side, names) in limbs.items()
        if not any(point.startswith(tuple(f"{side}_{name}" for name in names)) for point in points)
    ]
    hanging = [limb for limb in bare if arms_hang and limb.endswith("arm")]
    error = f"wrists ±{100 * HANGING_ERROR:.0f} cm in a walk"
    fates = {
        f"hang at the sides, guessed ({error}; with --causal by the network)": hanging,
        "guessed by the network": [limb for limb in bare if limb not in hanging],
    }
    labels = f"; unknown labels: {listed(others)}; name those that are there with --names (docs/markers.md)"
    return [
        f"{' and '.join(lacking)}: {fate}, for no joint there follows from the markers{labels if others else ''}"
        for fate, lacking in fates.items()
        if lacking
    ]


def _unit(
    markers: MarkerSet,
    file: Places,
    raw: RawMarkers,
    form: MarkerFormat,
    place: str,
    remarks: list[str],
) -> tuple[Unit, float]:
    """Return the unit at which marker distances fit a person, and the size as a factor of an adult's."""
    ratios = []
    for a, b, usual in markers.spans:
        if a in file and b in file:
            apart = np.linalg.norm(file[a] - file[b], axis=-1)
            if np.isfinite(apart).any():
                ratios.append(float(np.nanmedian(apart)) / usual)
    declared: Unit = form.unit or raw.unit
    if not ratios:
        return declared, 1.0
    ratio = float(np.median(ratios))
    fits: list[Unit] = [unit for unit, metres in METRES.items() if SIZES[0] <= ratio * metres <= SIZES[1]]  # type: ignore[misc]
    if declared in fits:
        return declared, ratio * METRES[declared]
    if not fits or form.unit is not None:
        declared_as = f" read as {declared}" if fits else ""
        fix = f"the numbers are {fits[0]}: give --unit {fits[0]}" if fits else "see that the labels are right (--names)"
        raise BodysenseError(
            f"{place}: the markers of {markers.name}{declared_as} are {ratio * METRES[declared]:.3g} times as far "
            f"apart as on a person; {fix}"
        )
    remarks.append(f"the numbers are {fits[0]}, not {declared} as the file says")
    return fits[0], ratio * METRES[fits[0]]


def _turned_upright(
    raw: RawMarkers,
    places: Places,
    joints: Collection[str],
    size: float,
    form: MarkerFormat,
    place: str,
    remarks: list[str],
) -> tuple[RawMarkers, list[str]]:
    """Turn `places` upright, and return the markers with their axes, and warnings.

    Raises BodysenseError for a given axis that the motion excludes.
    """
    names = [name for name in joints if name in default_skeleton().points]
    low = [name for name in names if name.endswith(("ankle", "foot", "toe", "knee"))]
    high = [name for name in names if name.endswith(("shoulder", "neck", "head", "spine3"))]
    if not low:
        low = [name for name in names if name.endswith(("hip", "pelvis"))]
    if not high:
        high = [name for name in names if name.endswith(("hip", "pelvis"))]
    if not low or not high or low == high:
        return raw, []
    axes = file_axes(raw, form)
    first, later, moment = moments(len(raw.time), raw.frame_rate)
    points = np.stack([places[name] for name in names], axis=1) @ axes / max(size, 0.3)  # in the file's axes
    ends = [points[first][:, [names.index(name) for name in end]] for end in (low, high)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # frames without a point
        bottom, top = (np.nanmean(end, axis=1) for end in ends)
    clearance = clearance_of(names)
    if form.up is not None:
        motion = judged_up(points[first], points[later], moment, top - bottom, clearance=clearance)
        return raw, told_warning(form.up, motion)
    upward = int(np.argmax(np.abs(axes[1])))
    declared = cast(UpAxis, ("" if axes[1, upward] > 0 else "-") + "xyz"[upward])
    words: dict[UpAxis, float] = {declared: USUAL}
    found = judged_up(points[first], points[later], moment, top - bottom, clearance=clearance, words=words)
    if found.axis == declared:
        return raw, doubts(found, "the file")
    check_overruled(place, found)
    way = quaternion_rotate(TURNS[found.axis] * [1, -1, -1, -1], np.array([0.0, 1.0, 0.0])).round()
    along = np.roll(np.abs(way), 1)
    raw = replace(raw, axes=np.stack([along, way, np.cross(along, way)]))
    turn = file_axes(raw, form) @ axes.T
    for name in places:
        places[name] = places[name] @ turn.T
    remarks.append(f"{signed(found.axis)} is up: the body stands along it (--up overrides)")
    return raw, []


def _check_body(places: Places, joints: Collection[str], rate: float, place: str, form: MarkerFormat) -> list[str]:
    """Return warnings about a body unlike a person's. Raises BodysenseError for a body in a mirror."""
    names = [name for name in joints if name in BODY or name.endswith("_toe")]
    if not names:
        return []
    first, later, moment = moments(len(places[names[0]]), rate)
    one, other = ({name: places[name][frames] for name in names} for frames in (first, later))
    found = doubts_about(one, other, moment, rate, unit=form.unit, left_handed=form.left_handed)
    for doubt in found:
        if doubt.kind == "mirror":
            raise BodysenseError(f"{place}: the body is a body only in a mirror: {doubt.text} (--names)")
    return [doubt.text for doubt in found]


def _lower_to_floor(
    markers: MarkerSet, places: Places, joints: Collection[str], form: MarkerFormat, remarks: list[str]
) -> float:
    """Move the body so that the floor under its feet is y = 0, if it is elsewhere and no floor is given.

    Returns the previous height of the floor, m.
    """
    feet = [places[name][:, 1] - high for name, high in markers.floor if name in places]
    if feet:  # who lies or crawls rests on other joints
        others = [name for name in joints if name in BODY and not name.endswith(("ankle", "foot"))]
        feet += [places[name][:, 1] - high for name, high in zip(others, clearance_of(others), strict=True)]
    if form.floor is not None or not feet:
        return 0.0
    lowest = np.stack(feet)
    known = np.isfinite(lowest).any(axis=0)
    if not known.any():
        return 0.0
    floor = float(np.percentile(np.nanmin(lowest[:, known], axis=0), 10))
    if abs(floor) <= FLOOR:
        return 0.0
    remarks.append(f"the feet stand at y = {floor:.2f} m: the floor was moved from there to 0 (--floor keeps it)")
    for name in places:
        places[name] = places[name] - [0.0, floor, 0.0]
    return floor


def _bones(
    raw: RawMarkers, known: Recognised, here: Mapping[str, int], places: Places, remarks: list[str]
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Return rotations (T, 4) of bones whose rest pose is ours: they take our bones to the file's directions.

    Also return our axes in the file's, (4,) wxyz; None if the rotations are not used.
    """
    if raw.rotation is None or not known.markers.bones:
        return {}, None
    file = np.eye(3) if raw.axes is None else raw.axes
    turn = matrix_to_quaternion(file)
    back = turn * np.array([1.0, -1.0, -1.0, -1.0])
    turned = {
        name: quaternion_multiply(quaternion_multiply(turn, raw.rotation[:, k]), back) for name, k in here.items()
    }
    off = []
    for side, x in (("L", 1.0), ("R", -1.0), ("left_", 1.0), ("right_", -1.0)):
        for bone, end, rest in _LIMBS:
            start, beyond = f"{side}{bone}", f"{side}{end}"
            if start in turned and beyond in places:
                off += _angles(turned[start], np.array([x * rest[0], *rest[1:]]), places[beyond] - places[start])
    if not off or not np.median(off) < AGREES:
        remarks.append("rotations of its bones are left out: they are not from a T-pose that faces +Z")
        return {}, None
    return {joint: turned[bone] for bone, joint in known.markers.bones.items() if bone in turned}, turn


def _angles(rotation: np.ndarray, rest: np.ndarray, way: np.ndarray) -> list[float]:
    """Return angles (radians) between resting bones (3,) rotated (T, 4) and their measured directions (T, 3)."""
    seen = np.isfinite(way).all(axis=-1) & np.isfinite(rotation).all(axis=-1)
    way = way[seen]
    cosine = (quaternion_rotate(rotation[seen], np.broadcast_to(rest, way.shape)) * way).sum(axis=-1)
    return np.arccos(np.clip(cosine / np.linalg.norm(way, axis=-1), -1, 1)).tolist()


def _check_mirror(
    markers: MarkerSet, places: Places, frames: Mapping[str, np.ndarray], place: str, left_handed: bool
) -> None:
    """Refuse a body whose pelvis is upside down while it stands: sides are swapped, or the world is mirrored."""
    pelvis = next((frame for frame in markers.frames if frame.name == "pelvis" and frame.name in frames), None)
    ends = [[places[name] for name in names if name in places] for names in (markers.low, markers.high)]
    if pelvis is None or not all(ends):
        return
    low, high = (np.nanmedian(np.concatenate(end), axis=0) for end in ends)
    upright = (frames["pelvis"][..., 1] * (high - low)).sum(axis=-1)
    if np.isfinite(upright).any() and np.nanmedian(upright) < 0:
        raise BodysenseError(
            f"{place}: the body is a body only in a mirror: {mirror_fix(left_handed, 'labels')} (--names)"
        )
