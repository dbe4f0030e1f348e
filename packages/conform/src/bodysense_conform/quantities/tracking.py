"""Tracking: lost and returning signals, and a device that is put on again."""

from __future__ import annotations

import numpy as np

from bodysense_conform.quantities.shape import CORE
from bodysense_conform.series import NotEnough, Series, series, stacked
from bodysense_conform.subject import Subject

_OFF = 0.5  # s without any point: the device was taken off
_SETTLED = 0.5  # s after its return the body must be whole
_WATCHED = 2.0  # s after a return in which jumps belong to it


def jump(subject: Subject, moment: tuple[str, ...]) -> Series:
    """Jump of a point, cm beyond its velocity, in the frame of its signal's 'loss' or 'return'."""
    if subject.measured is None:
        raise NotEnough("no mark of which points are measured")
    change = np.diff(subject.measured.astype(np.int8), axis=0, prepend=0) == (-1 if moment == ("loss",) else 1)
    change[:2] = False
    change[1:] &= subject.known[1:] & subject.known[:-1]
    if not change.any():
        raise NotEnough(f"no {moment[0]} of a signal while its point goes on")
    steps = np.diff(subject.places, axis=0, prepend=np.nan)
    beyond = np.linalg.norm(steps - np.roll(steps, 1, axis=0), axis=-1)
    return Series(np.where(change, 100 * beyond, np.nan), subject.points)


def wait(subject: Subject) -> Series:
    """Time from the end of a step 'remount' to the first point, s."""
    steps = subject.labelled("remount")
    if not steps:
        raise NotEnough("no step 'remount' in the script")
    here = subject.time[subject.valid.any(axis=1)]
    waits = [np.min(here[here >= step.end] - step.end, initial=np.inf) for step in steps]
    return series(np.minimum(max(waits), 1e6))


def unsettled(subject: Subject) -> Series:
    """Time since the device's return in frames in which a joint still jumps by 10 cm, s."""
    returns = _returns(subject)
    steps = np.diff(subject.places[:, subject.columns(subject.body)], axis=0, prepend=np.nan)
    jump = np.nan_to_num(np.linalg.norm(steps - np.roll(steps, 1, axis=0), axis=-1)).max(axis=1)
    jump *= min(1.0, (1 / 30 / subject.interval) ** 2)  # curvature grows with the interval
    found = np.zeros(len(subject))
    for back in returns:
        since = subject.time - subject.time[back]
        late = (since > 0) & (since <= _WATCHED) & (jump > 0.1)
        found[late] = since[late]
    return series(found)


def other_body(subject: Subject) -> Series:
    """Change of each limb's length from before the device was taken off to after its return, %."""
    columns = {}
    for back in _returns(subject):
        moment = subject.time[back]
        for a, b in CORE:
            if subject.has(a, b):
                length = subject.length(a, b)
                old = np.nanmedian(length[subject.time < moment])
                new = np.nanmedian(length[subject.time > moment + _SETTLED])
                columns[f"{a}, {b}"] = np.array([100 * abs(new - old) / old])
    return stacked(columns, "no limb")


def _returns(subject: Subject) -> list[int]:
    """Frames in which the device is back after it was away."""
    present = np.flatnonzero(subject.valid.any(axis=1))
    away = np.flatnonzero(np.diff(subject.time[present]) >= max(_OFF, 6 * subject.interval))
    if not len(away):
        raise NotEnough(f"the device is never away for {_OFF:g} s")
    return [int(present[k + 1]) for k in away]
