"""Poses: angles and heights that the steps of a script ask for.

The head is what every tracker knows best. If it is not where the pose puts it, the performer did something else.
"""

from __future__ import annotations

import numpy as np

from bodysense_conform.quantities.shape import SIDES, angle
from bodysense_conform.series import NotEnough, Series, series, stacked
from bodysense_conform.subject import Subject

_UP = np.array([0.0, 1.0, 0.0])
_THIGHS = ("left_hip>left_knee", "right_hip>right_knee")
_BOW = 0.5  # of the trunk's length: way of the head down if the trunk bends forward by 60°
_BEAT = 4.0  # s; a longer time between two lifts is a pause
_DEEP = 0.9  # of the deepest position of the head: frames of a squat that are judged


def bend(subject: Subject, parts: tuple[str, ...]) -> Series:
    """Bend of a limb at its middle joint, degrees; 0 is straight."""
    _check(subject, *parts)
    columns = {}
    for side in SIDES:
        a, b, c = (subject.at(f"{side}_{part}") for part in parts)
        columns[f"{side}_{parts[1]}"] = angle(b - a, c - b)
    return stacked(columns, "")


def from_down(subject: Subject, limbs: tuple[str, ...]) -> Series:
    """Angle of the lines between pairs of joints from straight down, degrees."""
    names = [name.split(">") for name in limbs]
    _check(subject, *(name.partition("_")[2] for pair in names for name in pair))
    lines = {end: subject.at(end) - subject.at(start) for start, end in names}
    return stacked({name: angle(line, np.broadcast_to(-_UP, line.shape)) for name, line in lines.items()}, "")


def both_raised(subject: Subject) -> Series:
    """Whether both thighs are raised by 25°."""
    return series(from_down(subject, _THIGHS).values.min(axis=1) > 25)


def lift_interval(subject: Subject) -> Series:
    """Time from one lift of the left thigh to the next, s, in frames in which it is lifted."""
    raised = np.nan_to_num(from_down(subject, _THIGHS[:1]).values[:, 0]) > 25
    lifts = np.flatnonzero(raised[1:] & ~raised[:-1]) + 1
    found = np.full(len(subject), np.nan)
    found[lifts[1:]] = np.diff(subject.time[lifts])
    return series(np.where(found < _BEAT, found, np.nan))


def trunk_lean(subject: Subject) -> Series:
    """Angle of the trunk from upright, degrees."""
    _check(subject)
    trunk = subject.at("head") - subject.at("pelvis")
    return series(angle(trunk, np.broadcast_to(_UP, trunk.shape)))


def head_drop(subject: Subject) -> Series:
    """Way of the head down from where it is when the body stands, % of that height."""
    _check(subject)
    head = subject.at("head")[:, 1] - subject.ground
    steps = subject.labelled("stand", "t_pose", "a_pose")
    standing = head[np.any([subject.during(step) for step in steps], axis=0)] if steps else head
    high = float(np.nanmedian(standing)) if steps else float(np.nanpercentile(standing, 98))
    return series(100 * (high - head) / high)


def hands_over_head(subject: Subject) -> Series:
    """Height of each wrist over the head's joint, cm."""
    _check(subject, "wrist")
    head = subject.at("head")[:, 1]
    return stacked({f"{side}_wrist": 100 * (subject.at(f"{side}_wrist")[:, 1] - head) for side in SIDES}, "")


def knees_lack(subject: Subject) -> Series:
    """Bend that the knees lack for the way of the head down, in the deepest frames of a squat, degrees."""
    _check(subject, "hip", "knee", "ankle")
    down = head_drop(subject).values[:, 0]
    legs = sum(np.nanmedian(subject.length(f"left_{a}", f"left_{b}")) for a, b in (("hip", "knee"), ("knee", "ankle")))
    standing = np.nanmedian(subject.at("head")[:, 1] - subject.ground) / (1 - np.nanmedian(down) / 100)
    rest = down / 100 * standing - _BOW * np.nanmedian(subject.length("pelvis", "head"))
    needed = 2 * np.degrees(np.arccos(np.clip(1 - rest / legs, 0, 1)))
    lack = needed - bend(subject, ("hip", "knee", "ankle")).values.max(axis=1)
    return series(np.where((down > _DEEP * np.nanmax(down)) & (rest > 0.05), lack, np.nan))


def knees_differ(subject: Subject) -> Series:
    """Difference between the bends of both knees in the deepest frames of a squat, degrees."""
    down = head_drop(subject).values[:, 0]
    left, right = bend(subject, ("hip", "knee", "ankle")).values.T
    return series(np.where(down > _DEEP * np.nanmax(down), np.abs(left - right), np.nan))


def ankles_differ(subject: Subject) -> Series:
    """Difference between the heights of both ankles, cm."""
    _check(subject, "ankle")
    return series(100 * np.abs(subject.at("left_ankle")[:, 1] - subject.at("right_ankle")[:, 1]))


def place(subject: Subject, names: tuple[str, ...]) -> Series:
    """Place of joints on the floor, cm, a column each way."""
    if not subject.has(*names):
        raise NotEnough(f"no {' or '.join(names)}")
    return stacked(
        {f"{name} {way}": 100 * subject.at(name)[:, k] for name in names for way, k in (("x", 0), ("z", 2))}, ""
    )


def _check(subject: Subject, *parts: str) -> None:
    """Raise NotEnough if the trunk or these parts of either side are missing."""
    if not subject.has("head", "pelvis", *(f"{side}_{part}" for side in SIDES for part in parts)):
        raise NotEnough(f"some of head, pelvis{''.join(f', {part}' for part in parts)} do not come")
