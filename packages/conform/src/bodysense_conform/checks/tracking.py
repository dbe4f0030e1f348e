"""Tracking: what happens when a signal is lost, when it comes back, and when the device is put on again?"""

from __future__ import annotations

from functools import partial

import numpy as np

from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.subject import Subject, is_finger

_OFF = 0.5  # s without any point: the device was taken off
_RECOVERED = 0.5  # s after its return the body must be whole
_JUMP = 0.1  # m in a frame, beyond what its velocity explains


def steps_where(lost: bool, subject: Subject) -> Value | Unanswered:
    """The greatest jump (cm) of a point in the frame in which its signal is lost, or returns."""
    if subject.measured is None:
        return Unanswered("it does not say what is measured and what is completed")
    change = np.diff(subject.measured.astype(np.int8), axis=0) == (-1 if lost else 1)
    change &= subject.known[1:] & subject.known[:-1]
    change[0] = False
    if not change.any():
        return Unanswered(f"no signal {'is lost' if lost else 'returns'} while its point goes on")
    jump = np.full(change.shape, np.nan)
    before = np.diff(subject.places, axis=0)
    jump[1:] = np.linalg.norm(before[1:] - before[:-1], axis=-1)
    jump = np.where(change, jump, np.nan)
    frame, point = np.unravel_index(int(np.nanargmax(jump)), jump.shape)
    return Value(100 * float(jump[frame, point]), subject.points[int(point)], int(frame) + 1)


def completed_drift(subject: Subject) -> Value | Unanswered:
    """The fastest (m/s) that a completed point goes beyond the fastest measured one."""
    if subject.measured is None or not (subject.known & ~subject.measured).any():
        return Unanswered("nothing is completed, or it does not say what")
    both = subject.known[1:] & subject.known[:-1]
    measured = both & subject.measured[1:] & subject.measured[:-1]
    completed = both & ~subject.measured[1:] & ~subject.measured[:-1]
    if not measured.any() or not completed.any():
        return Unanswered("nothing is measured, or nothing completed, in two frames")
    fastest = float(np.nanmax(np.where(measured, subject.speed, np.nan)))
    return Value(max(float(np.nanmax(np.where(completed, subject.speed, np.nan))) - fastest, 0.0))


def recovery(subject: Subject) -> Value | Unanswered:
    """The longest time from the device's return until the last jump of the two seconds after it."""
    returns = _returns(subject)
    if not returns:
        return Unanswered(f"it is never away for {_OFF:g} s")
    body = [k for k, name in enumerate(subject.points) if not is_finger(name)]
    before = np.diff(subject.places[:, body], axis=0)
    jump = np.zeros(len(subject))
    slow = min(1.0, (1 / 30 / subject.interval) ** 2) if subject.interval > 0 else 1.0  # curves grow with the interval
    jump[2:] = slow * np.nan_to_num(np.linalg.norm(before[1:] - before[:-1], axis=-1)).max(axis=1)
    worst = 0.0
    for back in returns:
        after = (subject.time > subject.time[back]) & (subject.time <= subject.time[back] + 2)
        late = np.flatnonzero(after & (jump > _JUMP))
        worst = max(worst, float(subject.time[late[-1]] - subject.time[back]) if len(late) else 0.0)
    return Value(worst, f"{len(returns)} returns", returns[0])


def same_body(subject: Subject) -> Value | Unanswered:
    """The greatest change of a limb's bone from before the device was taken off to half a second after its return."""
    returns = _returns(subject)
    if not returns:
        return Unanswered(f"it is never away for {_OFF:g} s")
    worst, where = 0.0, ""
    for back in returns:
        past = subject.time < subject.time[back]
        later = subject.time > subject.time[back] + _RECOVERED
        for side in ("left", "right"):
            for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist")):
                one, other = f"{side}_{a}", f"{side}_{b}"
                if not subject.has(one, other):
                    continue
                length = subject.length(one, other)
                if np.isfinite(length[past]).any() and np.isfinite(length[later]).any():
                    old, new = float(np.nanmedian(length[past])), float(np.nanmedian(length[later]))
                    change = 100 * abs(new - old) / max(old, 1e-3)
                    if change > worst:
                        worst, where = change, f"{one} – {other}"
    return Value(worst, where)


def returns_on_time(subject: Subject) -> Value | Unanswered:
    """How long after a step of the script that takes the device off the first point comes again."""
    steps = subject.labelled("remount")
    if not steps:
        return Unanswered("no step 'remount' in the script")
    present = subject.valid.any(axis=1)
    waits = []
    for step in steps:
        after = subject.time[present & (subject.time >= step.end)]
        waits.append(float(after[0] - step.end) if len(after) else float("inf"))
    return Value(max(waits))


def _returns(subject: Subject) -> list[int]:
    """Frames in which the device is back after being away, by empty frames or none."""
    present = np.flatnonzero(subject.valid.any(axis=1))
    away = np.flatnonzero(np.diff(subject.time[present]) >= max(_OFF, 6 * subject.interval))
    return [int(present[k + 1]) for k in away]


_TIMED = ("data.time_finite", "data.time_increases", "data.time_in_seconds", "anatomy.height")
_timed = partial(check_of, "motion", before=_TIMED)

CHECKS = (
    _timed(
        "step_at_loss",
        partial(steps_where, True),
        "cm",
        "A jump when a signal is lost.",
        most=10,
        after=("teleport", "pop"),
    ),
    _timed(
        "step_at_return",
        partial(steps_where, False),
        "cm",
        "A jump when a signal returns.",
        most=10,
        after=("teleport", "pop"),
    ),
    _timed(
        "completed_speed",
        completed_drift,
        "m/s",
        "Guessed limbs that whirl.",
        most=5,
        after=("joint_speed", "step_at_loss", "step_at_return"),
    ),
    _timed("return_after_remount", returns_on_time, "s", "Put on again, it stays away.", most=1),
    _timed(
        "recovery",
        recovery,
        "s",
        "Put on again, the body takes long to settle.",
        most=_RECOVERED,
        after=("return_after_remount",),
    ),
    _timed("same_body", same_body, "%", "Put on again, it is another body.", most=5, after=("recovery",)),
)
