"""Tracking: lost and returning signals, and a device that is put on again."""

from __future__ import annotations

import numpy as np

from bodysense_conform.series import Series, change, need, norm
from bodysense_conform.subject import Subject

_OFF = 0.5  # s without any point: the device was taken off
_SETTLED = 0.5  # s after its return the body must be whole
_WATCHED = 2.0  # s after a return in which jumps belong to it


def jump(subject: Subject, moment: str) -> Series:
    """Jump of each point, cm beyond its velocity, in the frame of its signal's 'loss' or 'return'."""
    measured = need(subject.measured, "no mark of which points are measured")
    here = change(measured.astype(float)) == (-1 if moment == "loss" else 1)
    here[:2] = False
    here[1:] &= subject.known[1:] & subject.known[:-1]
    need(here.any(), f"no {moment} of a signal while its point goes on")
    return np.where(here, 100 * _beyond(subject.places), np.nan)


def wait(subject: Subject) -> Series:
    """Time from the end of a step 'remount' to the first point, s."""
    steps = need(subject.labelled("remount"), "no step 'remount' in the script")
    here = subject.time[subject.valid.any(axis=1)]
    return min(max(np.min(here[here >= step.end] - step.end, initial=np.inf) for step in steps), 1e6)


def unsettled(subject: Subject) -> Series:
    """Time since the device's return, s, in frames in which a joint still jumps by 10 cm."""
    returns = _returns(subject)
    jump = np.nan_to_num(_beyond(subject.places[:, subject.columns(subject.body)])).max(axis=1, initial=0)
    jump *= min(1.0, (1 / 30 / subject.interval) ** 2)  # curvature grows with the interval
    found = np.zeros(len(subject))
    for back in returns:
        since = subject.time - subject.time[back]
        found = np.where((since > 0) & (since <= _WATCHED) & (jump > 0.1), since, found)
    return found


def changed_length(subject: Subject, start: str, end: str) -> Series:
    """Change of a limb's length from before the device was last taken off to after its return, %."""
    moment, length = subject.time[_returns(subject)[-1]], subject.length(start, end)
    old = np.nanmedian(length[subject.time < moment])
    return 100 * abs(np.nanmedian(length[subject.time > moment + _SETTLED]) - old) / old


def _beyond(places: np.ndarray) -> np.ndarray:
    """Return how far points (T, P, 3) are from where their velocity would have taken them, (T, P) m."""
    return norm(change(change(places)))


def _returns(subject: Subject) -> list[int]:
    """Return the frames in which the device is back after an absence."""
    present = np.flatnonzero(subject.valid.any(axis=1))
    away = np.flatnonzero(np.diff(subject.time[present]) >= max(_OFF, 6 * subject.interval))
    return need(present[away + 1].tolist(), f"the device is never away for {_OFF:g} s")
