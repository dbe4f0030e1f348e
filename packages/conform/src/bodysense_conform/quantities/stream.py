"""Stream: times, messages, valid and repeated values."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from bodysense_conform.series import Series, change, need
from bodysense_conform.subject import SIDES, Subject

_LIMBS = ("shoulder", "elbow", "hip", "knee", "ankle")
NEEDED = ("pelvis", "head", *(f"{side}_{part}" for side in SIDES for part in _LIMBS))
_TREND = 120  # frames at either end that are compared
_SEARCHED = 0.6  # s; lags behind a reference are searched up to this
_COMPARED = 2.0  # s of motion from which one lag is found
_EVERY = 0.01  # s between the lags that are tried
_ALIKE = 0.8  # correlation with the reference from which a lag counts


def take_seconds(subject: Subject) -> Series:
    """Length of the take, s."""
    found = f"{len(subject)} frames in {subject.seconds:.2f} s; judgement needs 10 frames and 1 s"
    need(len(subject) >= 10 and not subject.seconds < 1, found)
    return subject.seconds


def intervals_away(subject: Subject) -> np.ndarray:
    """Time from the frame before in median intervals, outside of steps that take the device off."""
    off = subject.within("remount")
    return np.where(off | np.roll(off, 1), 1, change(subject.time) / subject.interval)


def absent(subject: Subject) -> Series:
    """Share of missing frames by their times, %, outside of steps that take the device off."""
    missing = np.nansum(np.maximum(np.round(intervals_away(subject)[1:]) - 1, 0))
    return 100 * missing / max(missing + len(subject), 1)


def clock_drift(subject: Subject) -> Series:
    """Drift of the device's clock from the sample clock, parts per million."""
    device = need(subject.transport.device_time, "no clock of the device over 5 s")
    need(subject.seconds >= 5, "no clock of the device over 5 s")
    return 1e6 * abs(np.polyfit(subject.time - subject.time[0], device - device[0], 1)[0] - 1)


def lag(subject: Subject) -> Series:
    """Time by which the motion is behind the reference's, ms, from the speeds of head and wrists over two seconds."""
    other = need(subject.reference, "no reference of the same performance (--reference)")
    names = [name for name in ("head", "left_wrist", "right_wrist") if subject.has(name) and other.has(name)]
    in_common = bool(names) and min(len(subject), len(other)) >= 2
    need(in_common, "the reference has neither head nor wrists in common, or no two frames")
    grid = np.arange(max(subject.time[0], other.time[0]), min(subject.time[-1], other.time[-1]), _EVERY)
    reach, window = round(_SEARCHED / _EVERY), round(_COMPARED / _EVERY)
    ours, theirs = (
        np.stack([np.interp(grid, one.time[1:], speed) for speed in np.nan_to_num(one.speed(names)[1:]).T])
        for one in (subject, other)
    )
    found = np.full(len(subject), np.nan)
    for start in range(reach, len(grid) - window - reach, window // 2):
        here = ours[:, start : start + window].ravel()
        others = sliding_window_view(theirs[:, start - reach : start + reach + window], window, axis=1)
        shifted = others.swapaxes(0, 1)[::-1].reshape(2 * reach + 1, -1)
        here, shifted = here - here.mean(), shifted - shifted.mean(axis=1, keepdims=True)
        alike = shifted @ here / np.sqrt((here @ here) * np.sum(shifted**2, axis=1))  # Pearson's correlations
        best = int(np.nanargmax(alike)) if np.isfinite(alike).any() else 0
        if alike[best] > _ALIKE:
            first, end = np.searchsorted(subject.time, [grid[start], grid[start + window // 2]])
            found[first:end] = 1000 * _EVERY * (best - reach)
    return found


def validity(subject: Subject) -> dict[str, np.ndarray]:
    """Whether a needed joint is valid, in frames with any point."""
    here, names = subject.valid.any(axis=1), [name for name in NEEDED if name in subject.points]
    return {name: np.where(here, subject.valid[:, subject.points.index(name)], np.nan) for name in names}


def validity_trend(subject: Subject) -> Series:
    """Fall of the share of valid needed joints from the first frames to the last, %."""
    need(len(subject) >= 2 * _TREND, f"{len(subject)} frames; {2 * _TREND} are needed")
    share = np.nanmean(np.reshape([*validity(subject).values()], (-1, len(subject))), axis=0)
    return 100 * (np.nanmean(share[:_TREND]) - np.nanmean(share[-_TREND:]))


def wrong_steps(subject: Subject) -> Series:
    """Steps of the script that end before they begin, or overlap the one before."""
    steps = need(subject.steps, "no script")
    overlap = sum(b.start < a.end - 1e-9 for a, b in pairwise(steps))
    return overlap + sum(not step.end > step.start for step in steps)


def empty_steps(subject: Subject) -> Series:
    """Steps of the script that lack frames in more than 2 % of their time."""
    count = 0
    for step in need(subject.steps, "no script"):
        edges = np.diff(np.concatenate([[step.start], subject.time[subject.during(step)], [step.end]]))
        missing = float(edges[edges > 3 * subject.interval].sum())
        count += step.label != "remount" and missing > 0.02 * (step.end - step.start) + 3 * subject.interval
    return count
