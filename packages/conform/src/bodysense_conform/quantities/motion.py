"""Motion: jumps, stutter, tremor and drift."""

from __future__ import annotations

import numpy as np

from bodysense.body.gaps import runs
from bodysense.body.rotation import geodesic_angle
from bodysense.body.skeleton import BODY
from bodysense_conform.series import Series, change, later, named, need
from bodysense_conform.subject import Subject

_KICK = 0.6  # weight of ankles in spikes: kicks are fast, and takes by markers flip feet
_MOVING = 0.15  # m/s; a body whose points move slower on average is too slow for stutter to be judged
_STEADY = 0.75  # of the mean of both neighbours' steps: shorter mean steps turn, and predict nothing
_STALLED, _REPEATS = 0.02, 1e-6  # m/s of the faster joints in a stall, and in one that repeats a frame
_ABRUPT = 0.15  # m/s of the faster joints in the frames beside a stall
_SLOW, _SLOW_TURN = 0.1, 20.0  # m/s and °/s; joints that are slower over a quarter of a second rest
_BASE = 0.25  # s over which slowness is measured, so that noise is no speed
_SLOWEST = 1 / 15  # s between frames; over longer intervals third differences contain motion
_THIRD = 6.88  # median length of the third difference of white noise of size 1 in each of three directions
_KEPT, _POSE = 2.0, 0.03  # s, and m/s: a pose is kept while no joint moves faster than that among the others
_TRAVEL = 0.2  # m/s; a body that keeps its pose and is faster is carried
_NEAR = 0.15  # s; over longer intervals any joint may turn about


def spike(subject: Subject) -> Series:
    """Departure of each joint, seen from the pelvis, from the frames around it: m beyond the curve of its motion."""
    need(subject.has("pelvis") and len(subject) >= 7, "no pelvis, or fewer than seven frames")
    columns = {}
    coarse = min(1.0, (1 / 20 / subject.interval) ** 2)  # curvature grows with the interval
    for name in _without_feet(subject):
        place = subject.line("pelvis", name)
        before, after = later(place, -1), later(place, 1)
        middle = (4 * (before + after) - later(place, -2) - later(place, 2)) / 6
        # A fast limb curves in the frames beside a spike, too; a spike of one frame leaves the path between them short.
        beside = np.linalg.norm(after - before, axis=-1) / 2
        counted = coarse * (_KICK if name.endswith("_ankle") else 1)
        columns[name] = counted * (np.linalg.norm(place - middle, axis=-1) - beside)
    return columns


def pace(subject: Subject) -> Series:
    """Step of the joints along the mean of their steps before and after, as half of them agree: 1 is even.

    A repeated frame is 0, a skipped one 2, a jump back is negative. Steps are velocities: frames that are missing from
    an even motion whose times are right do not count.
    """
    here = subject.velocity[:, subject.columns(_without_feet(subject))]
    found = np.full(len(subject), np.nan)
    if len(subject) <= 3:
        return found
    before, after = later(here, -1), later(here, 1)
    middle = (before + after) / 2
    size = np.linalg.norm(middle, axis=-1)
    beside = (np.linalg.norm(before, axis=-1) + np.linalg.norm(after, axis=-1)) / 2
    good = size > np.maximum(_MOVING, _STEADY * beside)
    steps = np.where(good, (here * middle).sum(axis=-1) / np.maximum(size, 1e-9) ** 2, np.nan)
    enough = good.sum(axis=1) > good.shape[1] / 2
    need(enough.any(), "the body moves too slowly")
    low, high = np.nanpercentile(steps[enough], [25, 75], axis=1)
    found[enough] = np.clip(1.0, low, high)  # of half the joints, the nearest to an even pace
    return found


def stalled(subject: Subject) -> Series:
    """Whether the body is in a stall: it stops within a frame and goes on within a frame."""
    speed = subject.speed(_without_feet(subject))
    known = np.asarray(np.isfinite(speed).all(axis=1))
    fast = np.percentile(np.where(known[:, None], speed, 0), 90, axis=1)
    stops = np.zeros(len(subject), dtype=bool)
    for first, end in runs(known & (fast < _STALLED)):
        edges = [fast[k] for k in (first - 1, end) if 0 <= k < len(fast)]
        # A file may hold its first or last pose; a stream may not.
        judged = len(edges) == 2 or subject.transport.messages > 0
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
    moved = change(place, frames)
    half = later(place, frames // 2 - frames) - later(place, -frames)  # a stride may repeat after two seconds
    own = [np.linalg.norm(way - np.nanmedian(way, axis=1, keepdims=True), axis=-1) / seconds for way in (moved, half)]
    least = np.fmin.reduce(np.linalg.norm(moved, axis=-1) / seconds, axis=1)
    keeps = (np.fmax.reduce(np.maximum(*own), axis=1) < _POSE) & (least < _TRAVEL)
    return np.where(keeps, 100 * least, np.nan)


def tremor(subject: Subject) -> Series:
    """Noise of each joint at rest, in mm, from third differences, which motion hardly has at the rates of trackers."""
    joints = [name for name in _without_feet(subject) if name in BODY]
    return need({name: 1000 * noise(subject.at(name), subject, _SLOW) for name in joints}, "no joint")


def rotation_tremor(subject: Subject) -> Series:
    """Noise of each joint's rotation at rest, in degrees."""
    columns = {}
    for name in subject.body:
        if subject.has_rotation(name):
            turn = subject.turn(name)
            flips = np.where((turn[1:] * turn[:-1]).sum(axis=-1) < 0, -1.0, 1.0)
            whole = turn * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
            columns[name] = np.degrees(2 * noise(whole, subject, np.radians(_SLOW_TURN) / 2))
    return need(columns, "no rotations")


def noise(values: np.ndarray, subject: Subject, slow: float) -> np.ndarray:
    """Return noise (T,) of a signal (T, n) in each direction, in frames in which it rests; its median counts."""
    need(0 < subject.interval <= _SLOWEST, "fewer than 15 frames a second")
    base = subject.frames(_BASE)
    sums = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    mean = ((later(sums, base) - sums) / base)[:-1]  # of the quarter of a second from each frame on
    rests = np.linalg.norm(change(mean, base), axis=-1) < slow * _BASE
    third = np.linalg.norm(change(change(change(values))), axis=-1) / _THIRD
    return np.where(rests, third, np.nan)


def teleport(subject: Subject) -> Series:
    """Distance of the pelvis from where its speed would have taken it, m."""
    need(subject.has("pelvis") and len(subject) >= 3, "no pelvis, or fewer than three frames")
    step, moved = change(subject.time)[:, None], change(subject.at("pelvis"))
    expected = later(moved / np.where(step > 0, step, np.nan), -1) * step
    ahead = np.linalg.norm(moved - expected, axis=-1)
    return np.minimum(ahead, np.linalg.norm(moved, axis=-1))  # a sudden start is ahead of its old speed


def travel(subject: Subject) -> Series:
    """Speed of the pelvis over half a second, m/s."""
    frames = subject.frames(0.5)
    need(subject.has("pelvis") and frames < len(subject), "no pelvis over half a second")
    return np.linalg.norm(change(subject.at("pelvis"), frames), axis=-1) / change(subject.time, frames)


def speed(subject: Subject) -> dict[str, np.ndarray]:
    """Speed of each joint, m/s."""
    names = _without_feet(subject)
    return named(names, subject.speed(names))


def fastest(subject: Subject) -> Series:
    """Speed of the fastest joint in a script that asks for motion, m/s."""
    _check_motion_asked(subject)
    return np.nan_to_num([*speed(subject).values()]).max(axis=0)


def sway(subject: Subject) -> Series:
    """Distance of the head from its usual place in a script that asks for motion, mm."""
    _check_motion_asked(subject)
    need(subject.has("head"), "no head")
    head = subject.at("head")
    return 1000 * np.linalg.norm(head - np.nanmedian(head, axis=0), axis=1)


def _check_motion_asked(subject: Subject) -> None:
    need({step.label for step in subject.steps} - {"stand", "sit"}, "no script that asks for motion")


def flip(subject: Subject) -> Series:
    """Turn of each joint in its parent from the frame before, degrees; of the pelvis in the world."""
    near = change(subject.time) <= _NEAR
    columns = {}
    for parent, child in (("", "pelvis"), *subject.bones):
        if subject.has_rotation(child) and (not parent or subject.has_rotation(parent)):
            turn = subject.local(parent, child) if parent else subject.turn(child)
            columns[child] = np.where(near, np.degrees(geodesic_angle(turn, later(turn, -1))), np.nan)
    return need(columns, "no rotations")


def _without_feet(subject: Subject) -> list[str]:
    """Points of the body without feet and toes, which takes by markers spin."""
    found = [name for name in subject.body if not name.endswith(("_foot", "_toe"))]
    return need(found, "no point of the body is known")
