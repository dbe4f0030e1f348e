"""Motion: jumps, stutter, tremor and drift."""

from __future__ import annotations

import numpy as np

from bodysense.body.gaps import runs
from bodysense.body.rotation import geodesic_angle
from bodysense.body.skeleton import BODY
from bodysense_conform.series import NotEnough, Series, series, stacked
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
    if not subject.has("pelvis") or len(subject) < 7:
        raise NotEnough("no pelvis, or fewer than seven frames")
    columns = {}
    coarse = min(1.0, (1 / 20 / subject.interval) ** 2)  # curvature grows with the interval
    for name in _without_feet(subject):
        place = subject.at(name) - subject.at("pelvis")
        counted = coarse * (_KICK if name.endswith("_ankle") else 1)
        middle = (4 * (place[1:-3] + place[3:-1]) - place[:-4] - place[4:]) / 6
        off = np.full(len(place), np.nan)
        off[2:-2] = np.linalg.norm(place[2:-2] - middle, axis=-1)
        # A fast limb curves in the frames beside a spike, too; a spike of one frame leaves the path between them short.
        beside = np.full(len(place), np.nan)
        beside[2:-2] = np.linalg.norm(place[3:-1] - place[1:-3], axis=-1) / 2
        columns[name] = counted * (off - beside)
    return stacked(columns, "no joint")


def pace(subject: Subject) -> Series:
    """Step of the joints along the mean of their steps before and after, as half of them agree: 1 is even.

    A repeated frame is 0, a skipped one 2, a jump back is negative. Steps are velocities: frames that are missing from
    an even motion whose times are right do not count.
    """
    velocity = subject.velocity[:, subject.columns(_without_feet(subject))]
    found = np.full(len(subject), np.nan)
    if len(subject) > 3:
        before, here, after = velocity[:-2], velocity[1:-1], velocity[2:]
        middle = (before + after) / 2
        size = np.linalg.norm(middle, axis=-1)
        beside = (np.linalg.norm(before, axis=-1) + np.linalg.norm(after, axis=-1)) / 2
        good = size > np.maximum(_MOVING, _STEADY * beside)
        steps = np.where(good, (here * middle).sum(axis=-1) / np.maximum(size, 1e-9) ** 2, np.nan)
        enough = good.sum(axis=1) > good.shape[1] / 2
        if not enough.any():
            raise NotEnough("the body moves too slowly")
        low, high = np.nanpercentile(steps[enough], [25, 75], axis=1)
        found[1:-1][enough] = np.clip(1.0, low, high)  # of half the joints, the nearest to an even pace
    return series(found)


def stalled(subject: Subject) -> Series:
    """Whether the body is in a stall: it stops within a frame and goes on within a frame."""
    speed = subject.speed[:, subject.columns(_without_feet(subject))]
    known = np.asarray(np.isfinite(speed).all(axis=1))
    fast = np.percentile(np.where(known[:, None], speed, 0), 90, axis=1)
    stops = np.zeros(len(subject), dtype=bool)
    for first, end in runs(known & (fast < _STALLED)):
        edges = [fast[k] for k in (first - 1, end) if 0 <= k < len(fast)]
        # A file may hold its first or last pose; a stream may not.
        judged = len(edges) == 2 or subject.transport.messages > 0
        repeats = fast[first:end].max() < _REPEATS  # no body keeps still to that degree: one abrupt end is enough
        stops[first:end] = judged and (max if repeats else min)(edges, default=0) > _ABRUPT
    return series(stops)


def drift(subject: Subject) -> Series:
    """Speed, in cm/s over two seconds, at which a body that keeps its pose moves: the joint that moves least."""
    frames = subject.frames(_KEPT)
    names = [name for name in subject.body if name in BODY]
    if len(subject) <= frames or len(names) < 4:
        raise NotEnough("shorter than two seconds")
    place = subject.places[:, subject.columns(names)]
    moved = place[frames:] - place[:-frames]
    seconds = (subject.time[frames:] - subject.time[:-frames])[:, None]
    own = np.linalg.norm(moved - np.nanmedian(moved, axis=1, keepdims=True), axis=-1) / seconds
    half = (
        place[frames // 2 : len(place) - frames + frames // 2] - place[:-frames]
    )  # a stride may repeat after two seconds
    own = np.maximum(own, np.linalg.norm(half - np.nanmedian(half, axis=1, keepdims=True), axis=-1) / seconds)
    least = np.nanmin(np.linalg.norm(moved, axis=-1) / seconds, axis=1)
    found = np.full(len(subject), np.nan)
    keeps = (np.nanmax(own, axis=1) < _POSE) & (least < _TRAVEL)
    found[frames:] = np.where(keeps, 100 * least, np.nan)
    return series(found)


def tremor(subject: Subject) -> Series:
    """Noise of each joint at rest, in mm, from third differences, which motion hardly has at the rates of trackers."""
    joints = [name for name in _without_feet(subject) if name in BODY]
    return stacked({name: 1000 * noise(subject.at(name), subject, _SLOW) for name in joints}, "no joint")


def rotation_tremor(subject: Subject) -> Series:
    """Noise of each joint's rotation at rest, in degrees."""
    columns = {}
    for name in subject.body:
        if subject.has_rotation(name):
            turn = subject.turn(name)
            flips = np.where((turn[1:] * turn[:-1]).sum(axis=-1) < 0, -1.0, 1.0)
            whole = turn * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
            columns[name] = np.degrees(2 * noise(whole, subject, np.radians(_SLOW_TURN) / 2))
    return stacked(columns, "no rotations")


def noise(values: np.ndarray, subject: Subject, slow: float) -> np.ndarray:
    """Return noise (T,) of a signal (T, n) in each direction, in frames in which it rests; its median counts."""
    if not 0 < subject.interval <= _SLOWEST:
        raise NotEnough("fewer than 15 frames a second")
    base, found = subject.frames(_BASE), np.full(len(values), np.nan)
    if len(values) < 2 * base + 4:
        return found
    whole = np.cumsum(np.concatenate([np.zeros_like(values[:1]), values]), axis=0)
    smooth = (whole[base:] - whole[:-base]) / base
    moved = np.linalg.norm(smooth[base:] - smooth[:-base], axis=-1)  # at frame `base` and after
    third = np.linalg.norm(np.diff(values, 3, axis=0), axis=-1) / _THIRD
    rests = moved < slow * _BASE
    inside = slice(base, base + len(rests))
    found[3:] = third
    found[inside] = np.where(rests, found[inside], np.nan)
    found[: inside.start] = found[inside.stop :] = np.nan
    return found


def teleport(subject: Subject) -> Series:
    """Distance of the pelvis from where its speed would have taken it, m."""
    if not subject.has("pelvis") or len(subject) < 3:
        raise NotEnough("no pelvis, or fewer than three frames")
    step = np.diff(subject.time, prepend=np.nan)[:, None]
    moved = np.diff(subject.at("pelvis"), axis=0, prepend=np.nan)
    ahead = np.linalg.norm(moved - np.roll(moved / np.where(step > 0, step, np.nan), 1, axis=0) * step, axis=-1)
    return series(np.minimum(ahead, np.linalg.norm(moved, axis=-1)))  # a sudden start is ahead of its old speed


def travel(subject: Subject) -> Series:
    """Speed of the pelvis over half a second, m/s."""
    frames = subject.frames(0.5)
    if not subject.has("pelvis") or frames >= len(subject):
        raise NotEnough("no pelvis over half a second")
    moved = np.linalg.norm(subject.at("pelvis")[frames:] - subject.at("pelvis")[:-frames], axis=-1)
    return series(np.concatenate([np.full(frames, np.nan), moved / (subject.time[frames:] - subject.time[:-frames])]))


def speed(subject: Subject) -> Series:
    """Speed of each joint, m/s."""
    names = _without_feet(subject)
    return Series(subject.speed[:, subject.columns(names)], tuple(names))


def fastest(subject: Subject) -> Series:
    """Speed of the fastest joint in a script that asks for motion, m/s."""
    _check_motion_asked(subject)
    return series(np.nan_to_num(speed(subject).values).max(axis=1))


def sway(subject: Subject) -> Series:
    """Distance of the head from its usual place in a script that asks for motion, mm."""
    _check_motion_asked(subject)
    if not subject.has("head"):
        raise NotEnough("no head")
    head = subject.at("head")
    return series(1000 * np.linalg.norm(head - np.nanmedian(head, axis=0), axis=1))


def _check_motion_asked(subject: Subject) -> None:
    if not {step.label for step in subject.steps} - {"stand", "sit"}:
        raise NotEnough("no script that asks for motion")


def flip(subject: Subject) -> Series:
    """Turn of each joint in its parent from the frame before, degrees; of the pelvis in the world."""
    columns = {}
    for parent, child in (("", "pelvis"), *subject.bones):
        if subject.has_rotation(child) and (not parent or subject.has_rotation(parent)):
            turn = subject.local(parent, child) if parent else subject.turn(child)
            near = np.diff(subject.time, prepend=np.nan) <= _NEAR
            change = np.degrees(geodesic_angle(turn, np.roll(turn, 1, axis=0)))
            columns[child] = np.where(near, change, np.nan)
    return stacked(columns, "no rotations")


def _without_feet(subject: Subject) -> list[str]:
    """Points of the body without feet and toes, which takes by markers spin."""
    found = [name for name in subject.body if not name.endswith(("_foot", "_toe"))]
    if not found:
        raise NotEnough("no point of the body is known")
    return found
