"""Motion: jumps, stutter, tremor and drift."""

from __future__ import annotations

import numpy as np

from bodysense.body.skeleton import BODY
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import geodesic_angle
from bodysense_conform.series import Series, change, dot, later, need, norm
from bodysense_conform.subject import Subject

STEADY = tuple(name for name in BODY if not name.endswith("_foot"))
_KICK = 0.6  # weight of ankles in spikes: kicks are fast, and takes by markers flip feet
_MOVING = 0.15  # m/s; a body whose points move slower on average is too slow for stutter to be judged
_EQUAL = 0.05  # of the usual speed; a joint that is slower in one frame rests in it
_WIDEST = 3  # frames of a spike
_STEADY = 0.75  # of the mean of both neighbours' steps: shorter mean steps turn, and predict nothing
_STALLED, _REPEATS = 0.02, 1e-6  # m/s of the faster joints in a stall, and in one that repeats a frame
_ABRUPT = 0.15  # m/s of the faster joints in the frames around a stall
_BASE = 0.25  # s over which slowness is measured, so that noise is no speed
_SLOWEST = 1 / 15  # s between frames; over longer intervals third differences contain motion
_THIRD = 6.88  # median length of the third difference of white noise of size 1 in each of three directions
_KEPT, _POSE = 2.0, 0.03  # s, and m/s: a pose is kept while no joint moves faster than that among the others
_TRAVEL = 0.2  # m/s; a body that keeps its pose and is faster is carried
_NEAR = 0.15  # s; over longer intervals any joint may turn about


def spike(subject: Subject, joint: str) -> Series:
    """Departure of a joint, seen from the pelvis, from the frames around it: m beyond the curve of its motion.

    Spikes of up to `_WIDEST` frames count: their least departure from the cubic through the two frames before and the
    two after.
    """
    need(len(subject) >= 7, "no pelvis, or fewer than seven frames")
    coarse = min(1.0, (1 / 20 / subject.interval) ** 2)  # curvature grows with the interval
    place = subject.line("pelvis", joint)
    found = np.full(len(subject), np.nan)
    for width in range(1, _WIDEST + 1):
        near = (-1, 0, width + 1, width + 2)  # frames around a spike, whose first frame is 1
        around = [later(place, frame - 1) for frame in near]
        least = np.full(len(subject), np.inf)
        for frame in range(1, width + 1):
            weights = [np.prod([(frame - b) / (a - b) for b in near if b != a]) for a in near]
            curve = sum(weight * one for weight, one in zip(weights, around, strict=True))
            least = np.minimum(least, norm(later(place, frame - 1) - curve))
        # A fast limb curves in the frames around a spike, too; a spike leaves the path between them short.
        found = np.fmax(found, least - norm(around[2] - around[1]) / 2)
    return coarse * (_KICK if joint.endswith("_ankle") else 1) * found


def repeats(subject: Subject) -> Series:
    """Whether a frame of a moving body equals the one before: half of its joints rest for that frame alone."""
    names = _joints(subject)
    step = norm(subject.velocity[:, subject.columns(names)])
    usual = _slow_speed(subject, names)
    moving = usual > _MOVING
    rests = np.where(np.isfinite(step), step < _EQUAL * usual, False)
    share = (rests & moving).sum(axis=1) / np.maximum(moving.sum(axis=1), 1)
    return np.where(2 * moving.sum(axis=1) > len(names), share > 1 / 2, np.nan)


def pace(subject: Subject) -> Series:
    """Step of the joints along the mean of their steps before and after, as half of them agree: 1 is even.

    A repeated frame is 0, a skipped one 2, a jump back is negative. Steps are velocities: frames that are missing from
    an even motion whose times are right do not count.
    """
    here = subject.velocity[:, subject.columns(_joints(subject))]
    slow = _slow_speed(subject, _joints(subject))
    found = np.full(len(subject), np.nan)
    if len(subject) <= 3:
        return found
    before, after = later(here, -1), later(here, 1)
    middle = (before + after) / 2
    size = norm(middle)
    beside = (norm(before) + norm(after)) / 2
    good = (size > np.maximum(_MOVING, _STEADY * beside)) & (slow > _MOVING)
    steps = np.where(good, dot(here, middle) / np.maximum(size, 1e-9) ** 2, np.nan)
    enough = good.sum(axis=1) > good.shape[1] / 2
    need(enough.any(), "the body moves too slowly")
    low, high = np.nanpercentile(steps[enough], [25, 75], axis=1)
    found[enough] = np.clip(1.0, low, high)  # of half the joints, the nearest to an even pace
    return found


def stalled(subject: Subject) -> Series:
    """Whether the body is in a stall: it stops within a frame and goes on within a frame."""
    speed = subject.speed(_joints(subject))
    known = np.asarray(np.isfinite(speed).all(axis=1))
    fast = np.percentile(np.where(known[:, None], speed, 0), 90, axis=1)
    stops = np.zeros(len(subject), dtype=bool)
    for first, end in runs(known & (fast < _STALLED)):
        edges = [fast[k] for k in (first - 1, end) if 0 <= k < len(fast)]
        # A file may hold its first or last pose; a stream may not.
        judged = len(edges) == 2 or subject.transport.messages is not None
        repeats = fast[first:end].max() < _REPEATS  # no body keeps still to that degree: one abrupt end is enough
        stops[first:end] = judged and (max if repeats else min)(edges, default=0) > _ABRUPT
    return stops


def drift(subject: Subject) -> Series:
    """Speed, in cm/s over two seconds, at which a body that keeps its pose moves: the joint that moves least."""
    frames = subject.frames(_KEPT)
    names = [name for name in subject.body if name in BODY]
    need(len(subject) > frames and len(names) >= 4, "shorter than two seconds")
    place = subject.places[:, subject.columns(names)]
    seconds = change(subject.time, frames)[:, None]
    movement = change(place, frames)
    half = later(place, frames // 2 - frames) - later(place, -frames)  # a stride may repeat after two seconds
    own = [norm(way - np.nanmedian(way, axis=1, keepdims=True)) / seconds for way in (movement, half)]
    least = np.fmin.reduce(norm(movement) / seconds, axis=1)
    keeps = (np.fmax.reduce(np.maximum(*own), axis=1) < _POSE) & (least < _TRAVEL)
    return np.where(keeps, 100 * least, np.nan)


def noise(subject: Subject, values: np.ndarray, slow: float) -> np.ndarray:
    """Noise of a signal (T, n) in each direction while it rests, slower than `slow` a second; its median counts.

    It is measured by third differences, which motion hardly has at the rates of trackers.
    """
    need(0 < subject.interval <= _SLOWEST, "fewer than 15 frames a second")
    base = subject.frames(_BASE)
    sums = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    mean = ((later(sums, base) - sums) / base)[:-1]  # of the quarter of a second from each frame on
    rests = norm(change(mean, base)) < slow * _BASE
    third = norm(change(change(change(values)))) / _THIRD
    return np.where(rests, third, np.nan)


def teleport(subject: Subject) -> Series:
    """Distance of the pelvis from where its speed would have taken it, m."""
    need(subject.has("pelvis") and len(subject) >= 3, "no pelvis, or fewer than three frames")
    step, movement = change(subject.time)[:, None], change(subject.at("pelvis"))
    expected = later(movement / np.where(step > 0, step, np.nan), -1) * step
    return np.minimum(norm(movement - expected), norm(movement))  # a sudden start is ahead of its old speed


def travel(subject: Subject) -> Series:
    """Speed of the pelvis over half a second, m/s."""
    frames = subject.frames(0.5)
    need(subject.has("pelvis") and frames < len(subject), "no pelvis over half a second")
    return norm(change(subject.at("pelvis"), frames)) / change(subject.time, frames)


def fastest(subject: Subject) -> Series:
    """Speed of the fastest joint in a script that asks for motion, m/s."""
    _check_motion_expected(subject)
    return np.nan_to_num(subject.speed(_joints(subject))).max(axis=1)


def sway(subject: Subject) -> Series:
    """Distance of the head from its usual place in a script that asks for motion, mm."""
    _check_motion_expected(subject)
    head = subject.at("head")
    return 1000 * norm(head - np.nanmedian(head, axis=0))


def _check_motion_expected(subject: Subject) -> None:
    need({step.label for step in subject.steps} - {"stand", "sit"}, "no script that asks for motion")


def flip(subject: Subject, joint: str) -> Series:
    """Turn of a joint in its parent from the frame before, degrees; of the pelvis in the world."""
    turn = subject.turn(joint) if joint == "pelvis" else subject.local(subject.parent(joint), joint)
    near = change(subject.time) <= _NEAR
    return np.where(near, np.degrees(geodesic_angle(turn, later(turn, -1))), np.nan)


def _slow_speed(subject: Subject, names: tuple[str, ...]) -> np.ndarray:
    """Return speeds (T, K) of points over a quarter of a second around each frame, m/s: noise is no speed."""
    half = max(subject.frames(_BASE / 2), 1)
    place = subject.places[:, subject.columns(names)]
    seconds = later(subject.time, half) - later(subject.time, -half)
    return norm(later(place, half) - later(place, -half)) / np.where(seconds > 0, seconds, np.nan)[:, None]


def _joints(subject: Subject) -> tuple[str, ...]:
    return need(subject.trunk_and_limbs, "no point of the body is known")
