"""Motion: does it move as a body does, without jumping?"""

from __future__ import annotations

from functools import partial

import numpy as np

from bodysense.body.rotation import geodesic_angle
from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.subject import Subject, is_finger


def joint_speed(subject: Subject) -> Value | Unanswered:
    """The fastest joint of the body."""
    return _greatest(subject, subject.speed, _without_toes(subject))


def body_speed(subject: Subject) -> Value | Unanswered:
    """The fastest half second of the pelvis."""
    frames = max(round(0.5 / subject.interval), 1) if subject.interval > 0 else 0
    if not subject.has("pelvis") or not 0 < frames < len(subject):
        return Unanswered("no pelvis over half a second")
    place, time = subject.at("pelvis"), subject.time
    speed = np.linalg.norm(place[frames:] - place[:-frames], axis=-1) / (time[frames:] - time[:-frames])
    return Value(float(np.nanmax(speed)), "pelvis", int(np.nanargmax(speed))) if np.isfinite(speed).any() else _NONE


def teleport(subject: Subject) -> Value | Unanswered:
    """The greatest jump of the pelvis from where its speed would have taken it."""
    if not subject.has("pelvis"):
        return Unanswered("no pelvis")
    off = _surprise(subject.at("pelvis"), subject.step)
    return _most(off, "pelvis")


def pop(subject: Subject) -> Value | Unanswered:
    """The greatest departure of a joint, seen from the pelvis, from the middle of the frames beside it."""
    if not subject.has("pelvis"):
        return Unanswered("no pelvis")
    best: Value | Unanswered = Unanswered("too few frames")
    slow = min(1.0, (1 / 30 / subject.interval) ** 2) if subject.interval > 0 else 1.0  # curves grow with the interval
    for name in _without_toes(subject):
        place = subject.at(name) - subject.at("pelvis")
        if len(place) < 5:
            break
        # A spike departs from both neighbours at once; what merely moves fast departs from the middle of four less.
        middle = (4 * (place[1:-3] + place[3:-1]) - place[:-4] - place[4:]) / 6
        found = _most(slow * np.linalg.norm(place[2:-2] - middle, axis=-1), name)
        if isinstance(found, Value) and (isinstance(best, Unanswered) or found.value > best.value):
            best = Value(found.value, name, None if found.frame is None else found.frame + 2)
    return best


def rotation_flip(subject: Subject) -> Value | Unanswered:
    """The greatest turn of a joint in its parent between two frames."""
    best: Value | Unanswered = Unanswered("no rotations")
    near = subject.step <= 0.15  # s: over longer anyone turns
    for parent, child in subject.bones:
        if not is_rotated(subject, parent, child):
            continue
        local = subject.local(parent, child)
        angle = np.where(near, np.degrees(geodesic_angle(local[:-1], local[1:])), np.nan)
        found = _most(angle, child)
        if isinstance(found, Value) and (isinstance(best, Unanswered) or found.value > best.value):
            best = found
    return best


def body_flip(subject: Subject) -> Value | Unanswered:
    """The greatest turn of the pelvis between two frames."""
    if not subject.has("pelvis") or not is_rotated(subject, "pelvis"):
        return Unanswered("no rotation of the pelvis")
    turn = subject.turn("pelvis")
    near = subject.step <= 0.15
    return _most(np.where(near, np.degrees(geodesic_angle(turn[:-1], turn[1:])), np.nan), "pelvis")


def _surprise(place: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(T - 1,) m: how far each place lies from where the velocity before it would have taken it; NaN at first."""
    if len(place) < 3:
        return np.full(max(len(place) - 1, 0), np.nan)
    before = np.diff(place, axis=0)[:-1] / np.where(step[:-1] > 0, step[:-1], np.nan)[:, None]
    after = np.diff(place, axis=0)[1:]
    # Who accelerates is ahead of a prediction by his old speed alone: the shorter of the two ways counts.
    ahead = np.linalg.norm(after - before * step[1:, None], axis=-1)
    return np.concatenate([[np.nan], np.minimum(ahead, np.linalg.norm(after, axis=-1))])


def body_points(subject: Subject) -> list[str]:
    """Points of the body that are there, without fingers."""
    return [name for name in subject.points if not is_finger(name) and subject.has(name)]


def _without_toes(subject: Subject) -> list[str]:
    """The same without feet beyond the ankles, which say how these are turned: takes by markers spin them."""
    return [name for name in body_points(subject) if not name.endswith(("_foot", "_toe"))]


def is_rotated(subject: Subject, *names: str) -> bool:
    """Whether all these points have rotations."""
    return all(bool(subject.rotated[subject.points.index(name)]) for name in names)


def _greatest(subject: Subject, values: np.ndarray, names: list[str]) -> Value | Unanswered:
    columns = values[:, [subject.points.index(name) for name in names]]
    if not np.isfinite(columns).any():
        return _NONE
    frame, column = np.unravel_index(int(np.nanargmax(columns)), columns.shape)
    return Value(float(columns[frame, column]), names[int(column)], int(frame))


def _most(values: np.ndarray, where: str) -> Value | Unanswered:
    if not np.isfinite(values).any():
        return _NONE
    return Value(float(np.nanmax(values)), where, int(np.nanargmax(values)))


_NONE = Unanswered("no frames that follow each other")
TIMED = ("data.time_finite", "data.time_increases", "data.time_in_seconds", "data.gaps", "anatomy.height")
_timed = partial(check_of, "motion", before=TIMED)

CHECKS = (
    _timed("teleport", teleport, "m", "The whole body jumps.", most=0.5),
    _timed("body_speed", body_speed, "m/s", "Nobody runs faster than 11 m/s.", most=11, after=("teleport",)),
    _timed("pop", pop, "m", "A joint leaps away for a frame and is back.", most=0.5, after=("teleport",)),
    _timed(
        "joint_speed",
        joint_speed,
        "m/s",
        "No joint of a body goes faster than 22 m/s.",
        most=22,
        after=("teleport", "pop"),
    ),
    _timed("body_flip", body_flip, "°", "The body turns about within a frame.", most=120),
    _timed(
        "rotation_flip",
        rotation_flip,
        "°",
        "A joint turns about within a frame.",
        most=165,
        after=("body_flip", "anatomy.component_order"),
    ),
)
