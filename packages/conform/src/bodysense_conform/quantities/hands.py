"""Hands: sizes, sides and order of the fingers, and gestures. Hands that never come are not judged."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense_conform.quantities.motion import noise
from bodysense_conform.quantities.shape import angle
from bodysense_conform.series import Series, change, need
from bodysense_conform.subject import SIDES, Subject, is_finger

_FINGERS = ("index", "middle", "ring", "pinky")
_ALL = ("thumb", *_FINGERS)
_TOUCH = 0.04  # m; a thumb this near to a fingertip touches it
_CURLED = 0.9  # straightness of fingers that are curled


def _each(measure: Callable[..., np.ndarray | float]) -> Callable[..., dict[str, Any]]:
    """Turn a figure of one side's hand into a quantity: a column, named by the wrist, for each whole hand."""

    @wraps(measure)
    def of_both(subject: Subject, *of: str) -> dict[str, Any]:
        return {f"{side}_wrist": measure(subject, side, *of) for side in _hands(subject)}

    return of_both


def missing_joints(subject: Subject) -> Series:
    """Whether a joint of a hand never comes although others of it do."""
    columns = {}
    for side in SIDES:
        names = [f"{side}_{finger}{k}" for finger in _ALL for k in (1, 2, 3)]
        if any(subject.has(name) for name in names):
            columns |= {name: not subject.has(name) for name in names}
    return need(columns, "no finger comes")


def missing(subject: Subject) -> Series:
    """Whether a point of a finger that comes at all is missing in a frame whose wrist is valid."""
    columns = {}
    for name in subject.points:
        wrist = f"{name.partition('_')[0]}_wrist"
        if is_finger(name) and subject.has(name, wrist):
            k, w = subject.columns([name, wrist])
            columns[name] = np.where(subject.valid[:, w], ~subject.valid[:, k], np.nan)
    return need(columns, "no finger comes")


@_each
def size(subject: Subject, side: str) -> float:
    """Length from wrist to the end of the middle finger along the bones, cm; 15 % more without its tip."""
    chain = [f"{side}_wrist", *_chain(subject, side, "middle")]
    return 100 * subject.along(chain) * (1 if chain[-1].endswith("tip") else 1.15)


@_each
def finger_share(subject: Subject, side: str) -> float:
    """Length of the middle finger's first two bones, as a share of the palm."""
    names = [f"{side}_{part}" for part in ("wrist", "middle1", "middle2", "middle3")]
    return subject.along(names[1:]) / subject.along(names[:2])


@_each
def order_wrong(subject: Subject, side: str) -> np.ndarray:
    """Whether the knuckles do not follow each other from index to little finger."""
    knuckles = np.stack([subject.at(f"{side}_{finger}1") for finger in _FINGERS])
    along = ((knuckles - knuckles[0]) * (knuckles[-1] - knuckles[0])).sum(axis=-1)
    return (np.diff(along, axis=0) <= 0).any(axis=0)


@_each
def thumb_way(subject: Subject, side: str) -> np.ndarray:
    """Distance of the thumb from the index finger's knuckle less that from the little finger's, cm."""
    near, far = (subject.length(f"{side}_thumb2", f"{side}_{finger}1") for finger in ("index", "pinky"))
    return 100 * (near - far)


@_each
def curl(subject: Subject, side: str) -> np.ndarray:
    """Way of curled fingers' ends to the palm times its area, m³: negative on the back of the hand."""
    along = subject.line(f"{side}_wrist", f"{side}_middle1")
    palm = np.cross(along, _knuckles(subject, side)) * (-1 if side == "right" else 1)
    ends = np.mean([subject.line(f"{side}_{finger}1", f"{side}_{finger}3") for finger in _FINGERS], axis=0)
    return np.where(straightness(subject)[f"{side}_wrist"] < _CURLED, (ends * palm).sum(axis=-1), np.nan)


@_each
def wrist_axes(subject: Subject, side: str) -> np.ndarray:
    """Angle between the hand and its wrist's rotation, degrees: of its direction, or half of its knuckles' twist."""
    wrist = f"{side}_wrist"
    need(subject.has_rotation(wrist), "no rotations of the wrists")
    back, along = quaternion_conjugate(subject.turn(wrist)), subject.line(wrist, f"{side}_middle1")
    outward, ahead = np.array([1.0 if side == "left" else -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    twist = angle(quaternion_rotate(back, _knuckles(subject, side)), ahead) / 2  # knuckles may be skewed
    return np.maximum(angle(quaternion_rotate(back, along), outward), twist)


def tremor(subject: Subject) -> Series:
    """Noise of the fingertips at rest, seen from the wrist, mm."""
    return {tip: 1000 * noise(place, subject, 0.1) for tip, place in _tips(subject).items()}


def leap(subject: Subject) -> Series:
    """Way of a fingertip, seen from the wrist, within a frame, cm."""
    near = change(subject.time) <= 0.1
    ways = {tip: 100 * np.linalg.norm(change(place), axis=-1) for tip, place in _tips(subject).items()}
    return {tip: np.where(near, way, np.nan) for tip, way in ways.items()}


@_each
def straightness(subject: Subject, side: str) -> np.ndarray:
    """Distance from root to tip of the fingers, as a share of their bones: 1 is straight."""
    chains = [_chain(subject, side, finger) for finger in _FINGERS]
    return np.mean([subject.length(chain[0], chain[-1]) / subject.along(chain) for chain in chains], axis=0)


@_each
def touch(subject: Subject, side: str) -> np.ndarray:
    """Distance from the thumb's tip to the nearest fingertip, cm."""
    return 100 * _apart(subject, side).min(axis=0)


@_each
def touches_other(subject: Subject, side: str, finger: str) -> np.ndarray:
    """Whether the thumb touches another finger than this, in frames in which it touches one."""
    apart = _apart(subject, side)
    wrong = np.argmin(np.nan_to_num(apart, nan=9.0), axis=0) != _FINGERS.index(finger)
    return np.where(apart.min(axis=0) < _TOUCH, wrong, np.nan)


@_each
def turned(subject: Subject, side: str) -> np.ndarray:
    """Turn of the knuckles since the first frame of a step 'wrist_rotate', degrees."""
    starts = [int(np.argmax(subject.during(step))) for step in subject.labelled("wrist_rotate")] or [0]
    since = np.array(starts)[np.maximum(np.searchsorted(starts, np.arange(len(subject)), side="right") - 1, 0)]
    knuckles = _knuckles(subject, side)
    return angle(knuckles, knuckles[since])


def _hands(subject: Subject) -> list[str]:
    """Sides of the hands that come with all their joints."""
    names = [*(f"{finger}{k}" for finger in _ALL for k in (1, 2, 3)), "wrist"]
    found = [side for side in SIDES if subject.has(*(f"{side}_{name}" for name in names))]
    return need(found, "no hand comes with all its fingers")


def _tips(subject: Subject) -> dict[str, np.ndarray]:
    """Place (T, 3) of every fingertip in the frame of its wrist, m."""
    places = {}
    for side in _hands(subject):
        wrist = f"{side}_wrist"
        for tip in (_chain(subject, side, finger)[-1] for finger in _ALL):
            places[tip] = subject.line(wrist, tip)
            if subject.has_rotation(wrist):
                places[tip] = quaternion_rotate(quaternion_conjugate(subject.turn(wrist)), places[tip])
    return places


def _chain(subject: Subject, side: str, finger: str) -> list[str]:
    """Joints of a finger, with its tip if it comes."""
    names = [f"{side}_{finger}{k}" for k in ("1", "2", "3", "_tip")]
    return names if subject.has(names[-1]) else names[:-1]


def _knuckles(subject: Subject, side: str) -> np.ndarray:
    return subject.line(f"{side}_pinky1", f"{side}_index1")


def _apart(subject: Subject, side: str) -> np.ndarray:
    """Distances (4, T) from the thumb's end to those of the fingers, m."""
    thumb = _chain(subject, side, "thumb")[-1]
    return np.stack([subject.length(thumb, _chain(subject, side, finger)[-1]) for finger in _FINGERS])
