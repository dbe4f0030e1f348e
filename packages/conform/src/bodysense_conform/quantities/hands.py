"""Hands: sizes, sides and order of the fingers, and gestures. Missing hands are not judged."""

from __future__ import annotations

import numpy as np

from bodysense_conform.series import Series, angle, dot, need
from bodysense_conform.subject import SIDES, Subject, is_finger

_FINGERS = ("index", "middle", "ring", "pinky")
_ALL = ("thumb", *_FINGERS)
_TOUCH = 0.04  # m; a thumb this near to a fingertip touches it
_CURLED = 0.9  # straightness of fingers that are curled


def hands(subject: Subject) -> list[str]:
    """Return the wrists of the hands that have all their joints."""
    found = [f"{side}_wrist" for side in SIDES if subject.has(f"{side}_wrist", *_joints(side))]
    return need(found, "no hand comes with all its fingers")


def fingertips(subject: Subject) -> list[str]:
    """Return the ends of all fingers of whole hands."""
    sides = [wrist.removesuffix("_wrist") for wrist in hands(subject)]
    return [_chain(subject, side, finger)[-1] for side in sides for finger in _ALL]


def fingers(subject: Subject) -> list[str]:
    """Return the known points of fingers."""
    return [name for name in subject.points if is_finger(name) and subject.has(name)]


def missing_joints(subject: Subject) -> Series:
    """Whether a joint of a hand is missing although others are present."""
    sides = [side for side in SIDES if any(subject.has(name) for name in _joints(side))]
    return {name: not subject.has(name) for side in need(sides, "no finger comes") for name in _joints(side)}


def hand_size(subject: Subject, side: str) -> float:
    """Length from wrist to the end of the middle finger along the bones, cm; 15 % more without its tip."""
    chain = [f"{side}_wrist", *_chain(subject, side, "middle")]
    return 100 * subject.along(chain) * (1 if chain[-1].endswith("tip") else 1.15)


def order_wrong(subject: Subject, side: str) -> np.ndarray:
    """Whether the knuckles do not follow each other from index to little finger."""
    knuckles = np.stack([subject.at(f"{side}_{finger}1") for finger in _FINGERS])
    along = dot(knuckles - knuckles[0], knuckles[-1] - knuckles[0])
    return np.asarray((np.diff(along, axis=0) <= 0).any(axis=0))


def curl(subject: Subject, side: str) -> np.ndarray:
    """Distance of curled fingertips from the palm, times its area, m³: negative on the back of the hand."""
    along = subject.line(f"{side}_wrist", f"{side}_middle1")
    palm = np.cross(along, _knuckles(subject, side)) * (-1 if side == "right" else 1)
    ends = np.mean([subject.line(f"{side}_{finger}1", f"{side}_{finger}3") for finger in _FINGERS], axis=0)
    return np.where(straightness(subject, side) < _CURLED, dot(ends, palm), np.nan)


def wrist_axes(subject: Subject, side: str) -> np.ndarray:
    """Angle between the hand and its wrist's rotation, degrees: of its direction, or half of its knuckles' twist."""
    wrist = f"{side}_wrist"
    along = subject.carried(wrist, subject.line(wrist, f"{side}_middle1"))
    outward, ahead = np.array([1.0 if side == "left" else -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    twist = angle(subject.carried(wrist, _knuckles(subject, side)), ahead) / 2  # knuckles may be skewed
    return np.maximum(angle(along, outward), twist)


def from_wrist(subject: Subject, tip: str) -> np.ndarray:
    """Place (T, 3) of a fingertip in the frame of its wrist, in the world's axes if that has no rotation, m."""
    wrist = f"{tip.partition('_')[0]}_wrist"
    place = subject.line(wrist, tip)
    return subject.carried(wrist, place) if subject.has_rotation(wrist) else place


def straightness(subject: Subject, side: str) -> np.ndarray:
    """Distance from root to tip of the fingers, as a share of their bones: 1 is straight."""
    chains = [_chain(subject, side, finger) for finger in _FINGERS]
    return np.mean([subject.length(chain[0], chain[-1]) / subject.along(chain) for chain in chains], axis=0)


def thumb_to_fingers(subject: Subject, side: str) -> np.ndarray:
    """Distances (4, T) from the thumb's end to those of the fingers, m."""
    thumb = _chain(subject, side, "thumb")[-1]
    return np.stack([subject.length(thumb, _chain(subject, side, finger)[-1]) for finger in _FINGERS])


def touches_other(subject: Subject, side: str, finger: str) -> np.ndarray:
    """Whether the thumb touches another finger than this, in frames in which it touches one."""
    apart = thumb_to_fingers(subject, side)
    wrong = np.argmin(np.nan_to_num(apart, nan=9.0), axis=0) != _FINGERS.index(finger)
    return np.where(apart.min(axis=0) < _TOUCH, wrong, np.nan)


def turned(subject: Subject, side: str) -> np.ndarray:
    """Turn of the knuckles since the first frame of a step 'wrist_rotate', degrees."""
    starts = [int(np.argmax(subject.during(step))) for step in subject.labelled("wrist_rotate")] or [0]
    since = np.array(starts)[np.maximum(np.searchsorted(starts, np.arange(len(subject)), side="right") - 1, 0)]
    knuckles = _knuckles(subject, side)
    return angle(knuckles, knuckles[since])


def _joints(side: str) -> list[str]:
    return [f"{side}_{finger}{k}" for finger in _ALL for k in (1, 2, 3)]


def _chain(subject: Subject, side: str, finger: str) -> list[str]:
    """Return the joints of a finger, with its tip if it is known."""
    names = [f"{side}_{finger}{k}" for k in ("1", "2", "3", "_tip")]
    return names if subject.has(names[-1]) else names[:-1]


def _knuckles(subject: Subject, side: str) -> np.ndarray:
    return subject.line(f"{side}_pinky1", f"{side}_index1")
