"""Hands: sizes, sides and order of the fingers, and gestures. Hands that never come are not judged."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense_conform.quantities.motion import noise
from bodysense_conform.quantities.shape import SIDES, angle
from bodysense_conform.series import NotEnough, Series, stacked
from bodysense_conform.subject import Subject, is_finger

_FINGERS = ("index", "middle", "ring", "pinky")
_ALL = ("thumb", *_FINGERS)
_TOUCH = 0.04  # m; a thumb this near to a fingertip touches it
_CURLED = 0.9  # straightness of fingers that are curled


def missing_joints(subject: Subject) -> Series:
    """Whether a joint of a hand never comes although others of it do."""
    columns = {}
    for side in SIDES:
        names = [f"{side}_{finger}{k}" for finger in _ALL for k in (1, 2, 3)]
        if any(subject.has(name) for name in names):
            columns |= {name: np.array([not subject.has(name)]) for name in names}
    return stacked(columns, "no finger comes")


def missing(subject: Subject) -> Series:
    """Whether a point of a finger that comes at all is missing in a frame whose wrist is valid."""
    columns = {}
    for name in subject.points:
        wrist = f"{name.partition('_')[0]}_wrist"
        if is_finger(name) and subject.has(name, wrist):
            k, w = subject.columns([name, wrist])
            columns[name] = np.where(subject.valid[:, w], ~subject.valid[:, k], np.nan)
    return stacked(columns, "no finger comes")


def size(subject: Subject) -> Series:
    """Length from wrist to the end of the middle finger along the bones, cm; 15 % more without its tip."""
    columns = {}
    for side in _hands(subject):
        chain = [f"{side}_wrist", *_chain(subject, side, "middle")]
        columns[chain[0]] = 100 * _along(subject, chain) * (1 if chain[-1].endswith("tip") else 1.15)
    return stacked(columns, "")


def finger_share(subject: Subject) -> Series:
    """Length of the middle finger's first two bones, as a share of the palm."""
    names = {
        side: [f"{side}_{part}" for part in ("wrist", "middle1", "middle2", "middle3")] for side in _hands(subject)
    }
    return stacked({name[0]: _along(subject, name[1:]) / _along(subject, name[:2]) for name in names.values()}, "")


def order_wrong(subject: Subject) -> Series:
    """Whether the knuckles do not follow each other from index to little finger."""
    columns = {}
    for side in _hands(subject):
        knuckles = np.stack([subject.at(f"{side}_{finger}1") for finger in _FINGERS])
        along = ((knuckles - knuckles[0]) * (knuckles[-1] - knuckles[0])).sum(axis=-1)
        columns[f"{side}_wrist"] = (np.diff(along, axis=0) <= 0).any(axis=0)
    return stacked(columns, "")


def thumb_way(subject: Subject) -> Series:
    """Distance of the thumb from the index finger's knuckle less that from the little finger's, cm."""
    columns = {}
    for side in _hands(subject):
        near, far = (subject.length(f"{side}_thumb2", f"{side}_{finger}1") for finger in ("index", "pinky"))
        columns[f"{side}_wrist"] = 100 * (near - far)
    return stacked(columns, "")


def curl(subject: Subject) -> Series:
    """Way of curled fingers' ends to the palm times its area, m³: negative on the back of the hand."""
    columns = {}
    for side in _hands(subject):
        along = subject.at(f"{side}_middle1") - subject.at(f"{side}_wrist")
        palm = np.cross(along, _across(subject, side)) * (-1 if side == "right" else 1)
        ends = np.mean([subject.at(f"{side}_{f}3") - subject.at(f"{side}_{f}1") for f in _FINGERS], axis=0)
        columns[f"{side}_wrist"] = np.where(_straight(subject, side) < _CURLED, (ends * palm).sum(axis=-1), np.nan)
    return stacked(columns, "")


def wrist_axes(subject: Subject) -> Series:
    """Angle between the hand and its wrist's rotation, degrees: of its direction, or half of its knuckles' twist."""
    columns = {}
    for side in _hands(subject):
        wrist = f"{side}_wrist"
        if not subject.has_rotation(wrist):
            raise NotEnough("no rotations of the wrists")
        back, along = quaternion_conjugate(subject.turn(wrist)), subject.at(f"{side}_middle1") - subject.at(wrist)
        outward, ahead = np.array([1.0 if side == "left" else -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        twist = angle(quaternion_rotate(back, _across(subject, side)), ahead) / 2  # knuckles may be skewed
        columns[wrist] = np.maximum(angle(quaternion_rotate(back, along), outward), twist)
    return stacked(columns, "")


def tremor(subject: Subject) -> Series:
    """Noise of the fingertips at rest, seen from the wrist, mm."""
    return stacked({tip: 1000 * noise(place, subject, 0.1) for tip, place in _tips(subject).items()}, "")


def leap(subject: Subject) -> Series:
    """Way of a fingertip, seen from the wrist, within a frame, cm."""
    near = np.diff(subject.time, prepend=np.nan)[:, None] <= 0.1
    ways = {
        tip: np.where(near, np.diff(place, axis=0, prepend=np.nan), np.nan) for tip, place in _tips(subject).items()
    }
    return stacked({tip: 100 * np.linalg.norm(way, axis=-1) for tip, way in ways.items()}, "")


def straightness(subject: Subject) -> Series:
    """Distance from root to tip of the fingers, as a share of their bones: 1 is straight."""
    return stacked({f"{side}_wrist": _straight(subject, side) for side in _hands(subject)}, "")


def touch(subject: Subject) -> Series:
    """Distance from the thumb's tip to the nearest fingertip, cm."""
    return stacked({f"{side}_wrist": 100 * _apart(subject, side).min(axis=0) for side in _hands(subject)}, "")


def touches_other(subject: Subject, fingers: tuple[str, ...]) -> Series:
    """Whether the thumb touches another finger than this, in frames in which it touches one."""
    columns = {}
    for side in _hands(subject):
        apart = _apart(subject, side)
        wrong = np.argmin(np.nan_to_num(apart, nan=9.0), axis=0) != _FINGERS.index(fingers[0])
        columns[f"{side}_wrist"] = np.where(apart.min(axis=0) < _TOUCH, wrong, np.nan)
    return stacked(columns, "")


def turned(subject: Subject) -> Series:
    """Turn of the knuckles since the first frame of a step 'wrist_rotate', degrees."""
    starts = [int(np.argmax(subject.during(step))) for step in subject.labelled("wrist_rotate")] or [0]
    since = np.array(starts)[np.maximum(np.searchsorted(starts, np.arange(len(subject)), side="right") - 1, 0)]
    across = {f"{side}_wrist": _across(subject, side) for side in _hands(subject)}
    return stacked({wrist: angle(line, line[since]) for wrist, line in across.items()}, "")


def _hands(subject: Subject) -> list[str]:
    """Sides of the hands that come with all their joints."""
    names = [*(f"{finger}{k}" for finger in _ALL for k in (1, 2, 3)), "wrist"]
    found = [side for side in SIDES if subject.has(*(f"{side}_{name}" for name in names))]
    if not found:
        raise NotEnough("no hand comes with all its fingers")
    return found


def _tips(subject: Subject) -> dict[str, np.ndarray]:
    """Place (T, 3) of every fingertip in the frame of its wrist, m."""
    places = {}
    for side in _hands(subject):
        wrist = f"{side}_wrist"
        for tip in (_chain(subject, side, finger)[-1] for finger in _ALL):
            places[tip] = subject.at(tip) - subject.at(wrist)
            if subject.has_rotation(wrist):
                places[tip] = quaternion_rotate(quaternion_conjugate(subject.turn(wrist)), places[tip])
    return places


def _chain(subject: Subject, side: str, finger: str) -> list[str]:
    """Joints of a finger, with its tip if it comes."""
    names = [f"{side}_{finger}{k}" for k in ("1", "2", "3", "_tip")]
    return names if subject.has(names[-1]) else names[:-1]


def _along(subject: Subject, chain: list[str]) -> np.ndarray:
    return np.array([sum(np.nanmedian(subject.length(a, b)) for a, b in pairwise(chain))])


def _across(subject: Subject, side: str) -> np.ndarray:
    return subject.at(f"{side}_index1") - subject.at(f"{side}_pinky1")


def _straight(subject: Subject, side: str) -> np.ndarray:
    chains = [_chain(subject, side, finger) for finger in _FINGERS]
    return np.mean([subject.length(chain[0], chain[-1]) / _along(subject, chain) for chain in chains], axis=0)


def _apart(subject: Subject, side: str) -> np.ndarray:
    """Distances (4, T) from the thumb's end to those of the fingers, m."""
    thumb = _chain(subject, side, "thumb")[-1]
    return np.stack([subject.length(thumb, _chain(subject, side, finger)[-1]) for finger in _FINGERS])
