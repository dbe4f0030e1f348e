"""Poses: angles and heights that the steps of a script require.

Trackers measure the head best. If it is not where the pose puts it, the performer did something else.
"""

from __future__ import annotations

import numpy as np

from bodysense_conform.series import Series, angle, need
from bodysense_conform.subject import SIDES, UP, Subject

_LEGS = [[f"{side}_{part}" for part in ("hip", "knee", "ankle")] for side in SIDES]
_BOW = 0.5  # of the trunk's length: drop of the head if the trunk bends forward by 60°
_BEAT = 4.0  # s; a longer time between two lifts is a pause
_DEEP = 0.9  # of the deepest position of the head: frames of a squat that are judged
RAISED = 25  # degrees of a raised thigh from straight down


def line_of(subject: Subject, start: str, end: str) -> np.ndarray:
    """Return vectors (T, 3) between two points; the trunk and the points of the other side must be known, too."""
    _check(subject, start, end)
    return subject.line(start, end)


def bend(subject: Subject, start: str, middle: str, end: str) -> np.ndarray:
    """Bend of a limb at its middle joint, degrees; 0 is straight."""
    _check(subject, start, middle, end)
    return angle(subject.line(start, middle), subject.line(middle, end))


def from_down(subject: Subject, start: str, end: str) -> np.ndarray:
    """Angle of the line between two joints from straight down, degrees."""
    return angle(line_of(subject, start, end), -UP)


def lift_interval(subject: Subject) -> Series:
    """Time from one lift of the left thigh to the next, s, in frames in which it is lifted."""
    raised = np.nan_to_num(from_down(subject, "left_hip", "left_knee")) > RAISED
    lifts = np.flatnonzero(raised[1:] & ~raised[:-1]) + 1
    found = np.full(len(subject), np.nan)
    found[lifts[1:]] = np.diff(subject.time[lifts])
    return np.where(found < _BEAT, found, np.nan)


def head_drop(subject: Subject) -> np.ndarray:
    """Drop of the head from its standing height, % of that height."""
    _check(subject)
    labels, head = ("stand", "t_pose", "a_pose"), subject.at("head")[:, 1] - subject.ground
    if subject.labelled(*labels):
        high = float(np.nanmedian(head[subject.within(*labels)]))
    else:
        high = float(np.nanpercentile(head, 98))
    return 100 * (high - head) / high


def knees_lack(subject: Subject) -> Series:
    """Missing bend of the knees for the drop of the head, in the deepest frames of a squat, degrees."""
    bends = [bend(subject, *leg) for leg in _LEGS]
    down = head_drop(subject)
    standing = np.nanmedian(subject.at("head")[:, 1] - subject.ground) / (1 - np.nanmedian(down) / 100)
    rest = down / 100 * standing - _BOW * subject.along(["pelvis", "head"])
    needed = 2 * np.degrees(np.arccos(np.clip(1 - rest / subject.along(_LEGS[0]), 0, 1)))
    deep = (down > _DEEP * np.nanmax(down)) & (rest > 0.05)
    return np.where(deep, needed - np.maximum(*bends), np.nan)


def knees_differ(subject: Subject) -> Series:
    """Difference between the bends of both knees in the deepest frames of a squat, degrees."""
    down = head_drop(subject)
    left, right = (bend(subject, *leg) for leg in _LEGS)
    return np.where(down > _DEEP * np.nanmax(down), np.abs(left - right), np.nan)


def place(subject: Subject, *names: str) -> Series:
    """Position of joints on the floor, cm, one column per axis."""
    need(subject.has(*names), f"no {' or '.join(names)}")
    return {f"{name} {way}": 100 * subject.at(name)[:, k] for name in names for way, k in (("x", 0), ("z", 2))}


def _check(subject: Subject, *names: str) -> None:
    """Raise NotEnough if the trunk or these points of either side are missing."""
    parts = [*filter(None, dict.fromkeys(name.partition("_")[2] for name in names))]
    known = subject.has("head", "pelvis", *(f"{side}_{part}" for side in SIDES for part in parts))
    need(known, f"some of head, pelvis{''.join(f', {part}' for part in parts)} do not come")
