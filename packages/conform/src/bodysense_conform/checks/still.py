"""Stillness: does what stands tremble or drift? And how smooth is the whole?"""

from __future__ import annotations

from functools import partial

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.checks.motion import TIMED, body_points, is_rotated
from bodysense_conform.subject import Subject

_WINDOW = 1.0  # s over which noise is measured
_SLOW, _SLOW_TURN = 0.1, 20.0  # m/s, °/s: what is slower over a quarter of a second stands
_BASE = 0.25  # s: over which slowness is measured, so that noise is no speed
_ALIVE = 0.001  # m: people who stand as still as they can move the head farther within seconds
_SLOWEST = 1 / 15  # s between frames: over more, third differences are of motion, too
_THIRD = np.sqrt(20.0)  # of white noise of size 1, the size of its third difference


def noise_floor(values: np.ndarray, subject: Subject, slow: float) -> float:
    """Noise of a signal (T, n) in the second that has least of it, of those in which it stands; NaN if it never does.

    From third differences, which motion hardly has at the rates of trackers. Noise of the sensor is in every second.
    """
    if not 0 < subject.interval <= _SLOWEST:
        return float("nan")
    window, base = (max(round(span / subject.interval), 2) for span in (_WINDOW, _BASE))
    if len(values) < window + 2 * base + 3:
        return float("nan")
    third = np.square(np.diff(values, 3, axis=0)).mean(axis=-1)
    whole = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    smooth = (whole[base:] - whole[:-base]) / base
    moved = np.linalg.norm(smooth[base:] - smooth[:-base], axis=-1)
    count = min(len(third), len(moved)) - window + 1
    if count < 1:
        return float("nan")
    power = np.lib.stride_tricks.sliding_window_view(third, window)[:count].mean(axis=-1)
    rest = np.lib.stride_tricks.sliding_window_view(moved, window)[:count].max(axis=-1) < slow * _BASE
    power = power[rest & np.isfinite(power)]
    return float(np.sqrt(power.min())) / _THIRD if len(power) else float("nan")


def shake(subject: Subject) -> Value | Unanswered:
    """The noise of the noisiest joint in its calmest second."""
    joints = [name for name in body_points(subject) if name in BODY]  # the end of a foot says how its joint is turned
    noise = {name: 1000 * noise_floor(subject.at(name), subject, _SLOW) for name in joints}
    return noisiest(noise)


def rotation_shake(subject: Subject) -> Value | Unanswered:
    """The noise of the noisiest joint's rotation in its calmest second."""
    noise = {}
    for name in body_points(subject):
        if is_rotated(subject, name):
            turn = subject.turn(name)
            flips = np.where((turn[1:] * turn[:-1]).sum(axis=-1) < 0, -1.0, 1.0)
            whole = turn * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
            noise[name] = np.degrees(2 * noise_floor(whole, subject, np.radians(_SLOW_TURN) / 2))
    return noisiest(noise)


def drift(subject: Subject) -> Value | Unanswered:
    """The median speed of the joints in the calmest second."""
    if subject.calm is None:
        return Unanswered("no second without gaps")
    names = [subject.points.index(name) for name in body_points(subject)]
    return Value(100 * float(np.median(subject.speed[subject.calm][:-1][:, names])), "", subject.calm.start)


def jitter(subject: Subject) -> Value | Unanswered:
    """Mean third derivative of the joints' places (10² m/s³), as papers print it: depends on the rate."""
    if len(subject) < 4 or not subject.interval > 0:
        return Unanswered("fewer than four frames")
    names = [subject.points.index(name) for name in body_points(subject)]
    third = np.diff(subject.places[:, names], 3, axis=0) / subject.interval**3
    return Value(float(np.nanmean(np.linalg.norm(third, axis=-1))) / 100)


def dead(subject: Subject) -> Value | Unanswered:
    """Of a script that asks for motion: the speed of its fastest joint, at the 90th percentile.

    Nobody keeps the head within a millimetre: where even that stands still it is the device that does.
    """
    if not {step.label for step in subject.steps} - {"stand", "sit"} or not len(subject.speed):
        return Unanswered("no script that asks for motion")
    speed = subject.speed[:, [subject.points.index(name) for name in body_points(subject)]]
    fastest = float(np.nanpercentile(np.nan_to_num(speed).max(axis=1), 90))
    head = subject.at("head") if subject.has("head") else subject.places[:, 0]
    sway = float(np.nanmax(np.linalg.norm(head - np.nanmedian(head, axis=0), axis=1)))
    return Value(fastest, f"the head moved by {1000 * sway:.1f} mm", blame="performer" if sway > _ALIVE else "device")


def noisiest(
    noise: dict[str, float], none: str = "nothing stands for a second, or there are fewer than 15 frames a second"
) -> Value | Unanswered:
    """The largest noise and whose it is; why there is no figure where none is known."""
    known = {name: value for name, value in noise.items() if np.isfinite(value)}
    if not known:
        return Unanswered(none)
    worst = max(known, key=lambda name: known[name])
    return Value(known[worst], worst)


_timed = partial(check_of, "motion", before=TIMED)

CHECKS = (
    _timed("shake", shake, "mm", "What stands trembles.", most=20),
    _timed(
        "rotation_shake",
        rotation_shake,
        "°",
        "What stands trembles in its rotations.",
        most=3.5,
        after=("anatomy.component_order",),
    ),
    _timed("drift", drift, "cm/s", "How calm the calmest second is."),
    _timed("jitter", jitter, "10² m/s³", "Third derivative, to compare with papers."),
    _timed("dead", dead, "m/s", "A script was performed and nothing moved.", least=0.05),
)
