"""Poses: angles and heights that the steps of a script ask for.

The head is what every tracker knows best. If it is not where the pose puts it, the performer did something else.
"""

from __future__ import annotations

import numpy as np

from bodysense_conform.quantities.shape import angle
from bodysense_conform.series import Series, need
from bodysense_conform.subject import SIDES, UP, Subject

_THIGHS = ("left_hip>left_knee", "right_hip>right_knee")
_LEG = ("hip", "knee", "ankle")
_BOW = 0.5  # of the trunk's length: way of the head down if the trunk bends forward by 60°
_BEAT = 4.0  # s; a longer time between two lifts is a pause
_DEEP = 0.9  # of the deepest position of the head: frames of a squat that are judged
_RAISED = 25  # degrees of a raised thigh from straight down


def bend(subject: Subject, start: str, middle: str, end: str) -> dict[str, np.ndarray]:
    """Bend of a limb at its middle joint, degrees; 0 is straight."""
    _check(subject, start, middle, end)
    limbs = [[f"{side}_{part}" for part in (start, middle, end)] for side in SIDES]
    return {b: angle(subject.line(a, b), subject.line(b, c)) for a, b, c in limbs}


def from_down(subject: Subject, *limbs: str) -> dict[str, np.ndarray]:
    """Angle of the lines between pairs of joints from straight down, degrees."""
    pairs = [name.split(">") for name in limbs]
    _check(subject, *(name.partition("_")[2] for pair in pairs for name in pair))
    return {end: angle(subject.line(start, end), -UP) for start, end in pairs}


def both_raised(subject: Subject) -> Series:
    """Whether both thighs are raised by 25°."""
    return np.minimum(*from_down(subject, *_THIGHS).values()) > _RAISED


def lift_interval(subject: Subject) -> Series:
    """Time from one lift of the left thigh to the next, s, in frames in which it is lifted."""
    (thigh,) = from_down(subject, _THIGHS[0]).values()
    raised = np.nan_to_num(thigh) > _RAISED
    lifts = np.flatnonzero(raised[1:] & ~raised[:-1]) + 1
    found = np.full(len(subject), np.nan)
    found[lifts[1:]] = np.diff(subject.time[lifts])
    return np.where(found < _BEAT, found, np.nan)


def trunk_lean(subject: Subject) -> Series:
    """Angle of the trunk from upright, degrees."""
    _check(subject)
    return angle(subject.line("pelvis", "head"), UP)


def head_drop(subject: Subject) -> np.ndarray:
    """Way of the head down from where it is when the body stands, % of that height."""
    _check(subject)
    labels, head = ("stand", "t_pose", "a_pose"), subject.at("head")[:, 1] - subject.ground
    if subject.labelled(*labels):
        high = float(np.nanmedian(head[subject.within(*labels)]))
    else:
        high = float(np.nanpercentile(head, 98))
    return 100 * (high - head) / high


def hands_over_head(subject: Subject) -> Series:
    """Height of each wrist over the head's joint, cm."""
    _check(subject, "wrist")
    return {f"{side}_wrist": 100 * subject.line("head", f"{side}_wrist")[:, 1] for side in SIDES}


def knees_lack(subject: Subject) -> Series:
    """Bend that the knees lack for the way of the head down, in the deepest frames of a squat, degrees."""
    bends = bend(subject, *_LEG)
    down = head_drop(subject)
    legs = subject.along([f"left_{part}" for part in _LEG])
    standing = np.nanmedian(subject.at("head")[:, 1] - subject.ground) / (1 - np.nanmedian(down) / 100)
    rest = down / 100 * standing - _BOW * np.nanmedian(subject.length("pelvis", "head"))
    needed = 2 * np.degrees(np.arccos(np.clip(1 - rest / legs, 0, 1)))
    deep = (down > _DEEP * np.nanmax(down)) & (rest > 0.05)
    return np.where(deep, needed - np.maximum(*bends.values()), np.nan)


def knees_differ(subject: Subject) -> Series:
    """Difference between the bends of both knees in the deepest frames of a squat, degrees."""
    down = head_drop(subject)
    left, right = bend(subject, *_LEG).values()
    return np.where(down > _DEEP * np.nanmax(down), np.abs(left - right), np.nan)


def ankles_differ(subject: Subject) -> Series:
    """Difference between the heights of both ankles, cm."""
    _check(subject, "ankle")
    return 100 * np.abs(subject.line("left_ankle", "right_ankle")[:, 1])


def place(subject: Subject, *names: str) -> Series:
    """Place of joints on the floor, cm, a column each way."""
    need(subject.has(*names), f"no {' or '.join(names)}")
    return {f"{name} {way}": 100 * subject.at(name)[:, k] for name in names for way, k in (("x", 0), ("z", 2))}


def _check(subject: Subject, *parts: str) -> None:
    """Raise NotEnough if the trunk or these parts of either side are missing."""
    known = subject.has("head", "pelvis", *(f"{side}_{part}" for side in SIDES for part in parts))
    need(known, f"some of head, pelvis{''.join(f', {part}' for part in parts)} do not come")
