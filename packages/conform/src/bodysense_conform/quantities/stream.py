"""Stream: times, messages, valid and repeated values."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense_conform.series import NotEnough, Series, series
from bodysense_conform.subject import Subject

_LIMBS = ("shoulder", "elbow", "hip", "knee", "ankle")
NEEDED = ("pelvis", "head", *(f"{side}_{part}" for side in ("left", "right") for part in _LIMBS))
_TREND = 120  # frames at either end that are compared
_SEARCHED = 0.6  # s; lags behind a reference are searched up to this
_COMPARED = 2.0  # s of motion from which one lag is found
_ALIKE = 0.8  # correlation with the reference from which a lag counts


def bad_times(subject: Subject) -> Series:
    """Whether the time of a frame is no finite number."""
    return series(~np.isfinite(subject.time))


def interval(subject: Subject) -> Series:
    """Time from the frame before, s."""
    return series(np.diff(subject.time, prepend=np.nan))


def rate(subject: Subject) -> Series:
    """Frames a second."""
    return series(1 / subject.interval if subject.interval > 0 else np.nan)


def seconds(subject: Subject) -> Series:
    """Length of the take, s."""
    if len(subject) < 10 or subject.seconds < 1:
        raise NotEnough(f"{len(subject)} frames in {subject.seconds:.2f} s; judgement needs 10 frames and 1 s")
    return series(subject.seconds)


def intervals_away(subject: Subject) -> Series:
    """Time from the frame before in median intervals, outside of steps that take the device off."""
    step = np.diff(subject.time, prepend=np.nan) / subject.interval
    for one in subject.labelled("remount"):
        inside = subject.during(one)
        step[inside | np.roll(inside, 1)] = 1
    return series(step)


def absent(subject: Subject) -> Series:
    """Share of frames that the times miss, %, outside of steps that take the device off."""
    missing = np.maximum(np.round(intervals_away(subject).values[1:, 0]) - 1, 0)
    return series(100 * np.nansum(missing) / max(np.nansum(missing) + len(subject), 1))


def latency(subject: Subject) -> Series:
    """Time from sample to availability, ms."""
    if subject.transport.available is None:
        raise NotEnough("no times of availability")
    return series(1000 * (subject.transport.available - subject.time))


def log_interval(subject: Subject) -> Series:
    """Time from the writing of the message before, s."""
    if subject.transport.log_time is None:
        raise NotEnough("no times of writing")
    return series(np.diff(subject.transport.log_time, prepend=np.nan))


def clock_drift(subject: Subject) -> Series:
    """Speed at which the device's clock leaves the sample clock, parts per million."""
    device = subject.transport.device_time
    if device is None or subject.seconds < 5:
        raise NotEnough("no clock of the device over 5 s")
    slope = np.polyfit(subject.time - subject.time[0], device - device[0], 1)[0]
    return series(1e6 * abs(slope - 1))


def lag(subject: Subject) -> Series:
    """Time by which the motion is behind the reference's, ms, from the speeds of head and wrists over two seconds."""
    other = subject.reference
    if other is None:
        raise NotEnough("no reference of the same performance (--reference)")
    names = [name for name in ("head", "left_wrist", "right_wrist") if subject.has(name) and other.has(name)]
    if not names or min(len(subject), len(other)) < 2:
        raise NotEnough("the reference has neither head nor wrists in common, or no two frames")
    every = 0.01
    grid = np.arange(max(subject.time[0], other.time[0]), min(subject.time[-1], other.time[-1]), every)
    reach, window = round(_SEARCHED / every), round(_COMPARED / every)
    found = np.full(len(subject), np.nan)
    ours, theirs = (
        np.stack([np.interp(grid, one.time[1:], np.nan_to_num(one.speed[1:, k])) for k in one.columns(names)])
        for one in (subject, other)
    )
    for start in range(reach, len(grid) - window - reach, window // 2):
        here = ours[:, start : start + window].ravel()
        alike = [
            np.corrcoef(here, theirs[:, start - k : start - k + window].ravel())[0, 1] for k in range(-reach, reach + 1)
        ]
        best = int(np.nanargmax(alike)) if np.isfinite(alike).any() else 0
        if alike[best] > _ALIKE:
            at = np.searchsorted(subject.time, [grid[start], grid[start + window // 2]])
            found[at[0] : at[1]] = 1000 * every * (best - reach)
    return series(found)


def bad_messages(subject: Subject, kind: tuple[str, ...]) -> Series:
    """Share of messages that are 'malformed' or 'lost', which the sequence numbers miss, %."""
    if not subject.transport.messages:
        raise NotEnough("no messages in a file of motion")
    count = getattr(subject.transport, kind[0])
    return series(100 * count / (subject.transport.messages + (count if kind == ("lost",) else 0)))


def missing_joints(subject: Subject) -> Series:
    """Whether a needed joint never comes; wrists may honestly be missing."""
    return Series(np.array([[not subject.has(name) for name in NEEDED]], dtype=float), NEEDED)


def not_finite(subject: Subject) -> Series:
    """Whether a valid point has a value that is no finite number."""
    position = ~np.isfinite(subject.position).all(axis=-1)
    rotation = subject.rotated & ~np.isfinite(subject.rotation).all(axis=-1)
    return Series((subject.valid & (position | rotation)).astype(float), subject.points)


def at_zero(subject: Subject) -> Series:
    """Whether a known point is exactly at (0, 0, 0), like memory that was never set."""
    zero = np.where(subject.known, (subject.position == 0).all(axis=-1), np.nan)
    return Series(zero[:, 1:], subject.points[1:]) if subject.points[0] == "pelvis" else Series(zero, subject.points)


def distance(subject: Subject) -> Series:
    """Distance from the origin, m."""
    return Series(np.linalg.norm(subject.places, axis=-1), subject.points)


def quaternion_error(subject: Subject) -> Series:
    """Departure of a rotation's length from 1."""
    length = np.linalg.norm(subject.rotation, axis=-1)
    return Series(np.where(subject.valid & subject.rotated, np.abs(length - 1), np.nan), subject.points)


def present(subject: Subject) -> Series:
    """Whether a frame has any point, outside of steps that take the device off."""
    found = subject.valid.any(axis=1).astype(float)
    for step in subject.labelled("remount"):
        found[subject.during(step)] = np.nan
    return series(found)


def validity(subject: Subject) -> Series:
    """Whether a needed joint is valid, in frames with any point."""
    here = np.asarray(subject.valid.any(axis=1))
    columns = subject.columns([name for name in NEEDED if name in subject.points])
    return Series(np.where(here[:, None], subject.valid[:, columns], np.nan), tuple(subject.points[k] for k in columns))


def validity_trend(subject: Subject) -> Series:
    """Fall of the share of valid needed joints from the first frames to the last, %."""
    if len(subject) < 2 * _TREND:
        raise NotEnough(f"{len(subject)} frames; {2 * _TREND} are needed")
    share = np.nanmean(validity(subject).values, axis=1)
    return series(100 * (np.nanmean(share[:_TREND]) - np.nanmean(share[-_TREND:])))


def flag_wrong(subject: Subject) -> Series:
    """Whether the device's flag 'all tracked' contradicts its joints."""
    flag = subject.transport.all_tracked
    if flag is None:
        raise NotEnough("no flag 'all tracked'")
    return series(flag != subject.valid[:, [name in BODY for name in subject.points]].all(axis=1))


def wrong_steps(subject: Subject) -> Series:
    """Steps of the script that end before they begin, or overlap the one before."""
    if not subject.steps:
        raise NotEnough("no script")
    overlap = sum(b.start < a.end - 1e-9 for a, b in pairwise(subject.steps))
    return series(overlap + sum(not step.end > step.start for step in subject.steps))


def empty_steps(subject: Subject) -> Series:
    """Steps of the script that lack frames in more than 2 % of their time."""
    if not subject.steps:
        raise NotEnough("no script")
    count = 0
    for step in subject.steps:
        edges = np.diff(np.concatenate([[step.start], subject.time[subject.during(step)], [step.end]]))
        missing = float(edges[edges > 3 * subject.interval].sum())
        count += step.label != "remount" and missing > 0.02 * (step.end - step.start) + 3 * subject.interval
    return series(count)
