"""Timing: does it come in order, evenly, without gaps, by clocks that can be believed?"""

from __future__ import annotations

from functools import partial

import numpy as np

from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.subject import Subject


def time_finite(subject: Subject) -> Value:
    """Times that are no numbers."""
    return Value(int((~np.isfinite(subject.time)).sum()))


def time_increases(subject: Subject) -> Value:
    """Steps back in time."""
    back = subject.step < 0
    return Value(int(back.sum()), "", int(np.argmax(back)) if back.any() else None)


def time_repeats(subject: Subject) -> Value:
    """Share of frames at the time of the one before."""
    same = subject.step == 0
    return Value(100 * float(same.mean()) if len(same) else 0.0, "", int(np.argmax(same)) if same.any() else None)


def time_in_seconds(subject: Subject) -> Value:
    """Median time between frames."""
    return Value(subject.interval)


def rate(subject: Subject) -> Value:
    """Frames a second."""
    return Value(1 / subject.interval if subject.interval > 0 else float("nan"))


def interval_regular(subject: Subject) -> Value:
    """Mean departure from the median interval, as a share of it."""
    off = float(np.mean(np.abs(subject.step - subject.interval)))
    return Value(100 * off / subject.interval if subject.interval > 0 else float("nan"))


def gaps(subject: Subject) -> Value:
    """The longest time without a frame, in median intervals, where no step of the script asks for it."""
    step = subject.step.copy()
    for one in subject.labelled("remount"):
        step[subject.during(one)[1:] | subject.during(one)[:-1]] = 0
    worst = int(np.argmax(step)) if len(step) else 0
    longest = float(step[worst]) if len(step) else 0.0
    return Value(longest / subject.interval if subject.interval > 0 else float("nan"), f"{longest:.3f} s", worst)


def log_times_increase(subject: Subject) -> Value | Unanswered:
    """Messages that were written before the one before them."""
    log = subject.transport.log_time
    if log is None:
        return Unanswered("no times of writing")
    return Value(int((np.diff(log) < 0).sum()))


def available_after_sample(subject: Subject) -> Value | Unanswered:
    """Samples that are said to be available before they were taken."""
    available = subject.transport.available
    if available is None:
        return Unanswered("it does not say when samples became available")
    early = available < subject.time - 1e-9
    return Value(int(early.sum()), "", int(np.argmax(early)) if early.any() else None)


def latency(subject: Subject) -> Value | Unanswered:
    """Median time from sample to availability."""
    available = subject.transport.available
    if available is None:
        return Unanswered("it does not say when samples became available")
    return Value(1000 * float(np.median(available - subject.time)))


def device_clock(subject: Subject) -> Value | Unanswered:
    """Share of frames whose device clock is the sample clock: a copy says nothing of drift."""
    device = subject.transport.device_time
    if device is None:
        return Unanswered("no clock of the device")
    return Value(100 * float((device == subject.time).mean()))


def clock_drift(subject: Subject) -> Value | Unanswered:
    """How fast the device's clock runs away from the sample clock."""
    device = subject.transport.device_time
    if device is None or subject.seconds < 5:
        return Unanswered("no clock of the device over 5 s")
    slope = np.polyfit(subject.time - subject.time[0], device - device[0], 1)[0]
    return Value(1e6 * abs(float(slope) - 1))


TIMED = ("data.time_finite", "data.time_increases", "data.time_in_seconds")
_check = partial(check_of, "data")
_timed = partial(check_of, "data", before=TIMED)

CHECKS = (
    _check("time_finite", time_finite, "times", "Frames without a time cannot be put in order.", most=0),
    _check(
        "time_increases", time_increases, "steps", "A step back in time breaks every filter.", most=0, required=True
    ),
    _check("time_repeats", time_repeats, "%", "Two frames at one time have no speed.", most=1),
    _check(
        "time_in_seconds",
        time_in_seconds,
        "s",
        "Milliseconds taken for seconds stop a body.",
        least=0.0005,
        most=1.5,
        after=("time_finite",),
    ),
    _timed("rate", rate, "Hz", "Below 10 Hz motion is a slide show.", least=10),
    _timed("interval_regular", interval_regular, "%", "Uneven frames are seen as judder.", most=20),
    _timed("gaps", gaps, "intervals", "A gap is seen as a freeze and a jump.", most=5),
    _check("log_times_increase", log_times_increase, "messages", "Players read files in their order.", most=0),
    _check(
        "available_after_sample",
        available_after_sample,
        "frames",
        "What is available before it was measured has a wrong clock.",
        most=0,
        after=("time_finite",),
    ),
    _check("latency", latency, "ms", "How late the body is.", after=("available_after_sample",)),
    _check("device_clock", device_clock, "%", "Share of frames whose device clock is a copy."),
    _timed("clock_drift", clock_drift, "ppm", "Clocks that drift part video and body within minutes.", most=500),
)
