"""Motion: does it move as a body does, on a floor, without shaking, jumping or sliding?"""

from __future__ import annotations

import numpy as np

from bodysense.body.rotation import geodesic_angle
from bodysense.conform.check import Check, Unanswered, Value
from bodysense.conform.checks.data import longest_run
from bodysense.conform.subject import Subject, is_finger, nan_min

_TRAVELS = 0.4  # m/s: a pelvis this fast goes somewhere
CALM_SPEED = 0.1  # m/s: a body that is faster in its calmest second never stands
_IDLE = 0.06  # m/s: a head this slow stands
_STEP = 0.35  # m/s: a foot this fast steps
_THIRD = np.sqrt(20.0)  # of white noise of size 1, the size of its third difference


def joint_speed(subject: Subject) -> Value | Unanswered:
    """The fastest joint of the body."""
    return _greatest(subject, subject.speed, _body(subject))


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
    for name in _body(subject):
        place = subject.at(name) - subject.at("pelvis")
        if len(place) < 5:
            break
        # A spike departs from both neighbours at once; what merely moves fast departs from the middle of four less.
        middle = (4 * (place[1:-3] + place[3:-1]) - place[:-4] - place[4:]) / 6
        found = _most(np.linalg.norm(place[2:-2] - middle, axis=-1), name)
        if isinstance(found, Value) and (isinstance(best, Unanswered) or found.value > best.value):
            best = Value(found.value, name, None if found.frame is None else found.frame + 2)
    return best


def rotation_flip(subject: Subject) -> Value | Unanswered:
    """The greatest turn of a joint in its parent between two frames."""
    best: Value | Unanswered = Unanswered("no rotations")
    near = subject.step <= 0.15  # s: over longer anyone turns
    for parent, child in subject.bones:
        if not _rotated(subject, parent, child):
            continue
        local = subject.local(parent, child)
        angle = np.where(near, np.degrees(geodesic_angle(local[:-1], local[1:])), np.nan)
        found = _most(angle, child)
        if isinstance(found, Value) and (isinstance(best, Unanswered) or found.value > best.value):
            best = found
    return best


def body_flip(subject: Subject) -> Value | Unanswered:
    """The greatest turn of the pelvis between two frames."""
    if not subject.has("pelvis") or not _rotated(subject, "pelvis"):
        return Unanswered("no rotation of the pelvis")
    turn = subject.turn("pelvis")
    near = subject.step <= 0.15
    return _most(np.where(near, np.degrees(geodesic_angle(turn[:-1], turn[1:])), np.nan), "pelvis")


def shake(subject: Subject) -> Value | Unanswered:
    """The noise of the noisiest joint in the calmest second, from third differences."""
    if not is_calm(subject):
        return Unanswered("it never stands still for a second")
    names = _body(subject)
    place = subject.places[subject.calm][:, [subject.points.index(name) for name in names]]
    noise = 1000 * np.sqrt(np.mean(np.square(np.diff(place, 3, axis=0)), axis=(0, 2))) / _THIRD
    return Value(float(noise.max()), names[int(np.argmax(noise))], subject.calm.start)


def rotation_shake(subject: Subject) -> Value | Unanswered:
    """The noise of the noisiest joint's rotation in the calmest second."""
    rotated = [name for name in _body(subject) if _rotated(subject, name)]
    if not is_calm(subject) or not rotated:
        return Unanswered("it never stands still for a second, or has no rotations")
    noise = {}
    for name in rotated:
        turn = subject.turn(name)[subject.calm]
        turn = turn * np.where((turn * turn[:1]).sum(axis=-1, keepdims=True) < 0, -1, 1)
        noise[name] = np.degrees(2 * np.sqrt(np.mean(np.square(np.diff(turn, 3, axis=0)).sum(-1)) / 3)) / _THIRD
    worst = max(noise, key=lambda name: np.nan_to_num(noise[name]))
    return Value(float(noise[worst]), worst, subject.calm.start)


def drift(subject: Subject) -> Value | Unanswered:
    """The median speed of the joints in the calmest second."""
    if subject.calm is None:
        return Unanswered("no second without gaps")
    names = [subject.points.index(name) for name in _body(subject)]
    return Value(100 * float(np.median(subject.speed[subject.calm][:-1][:, names])), "", subject.calm.start)


def jitter(subject: Subject) -> Value | Unanswered:
    """Mean third derivative of the joints' places (10² m/s³), as papers print it: depends on the rate."""
    if len(subject) < 4 or not subject.interval > 0:
        return Unanswered("fewer than four frames")
    names = [subject.points.index(name) for name in _body(subject)]
    third = np.diff(subject.places[:, names], 3, axis=0) / subject.interval**3
    return Value(float(np.nanmean(np.linalg.norm(third, axis=-1))) / 100)


def skate(subject: Subject) -> Value | Unanswered:
    """How far the slower foot goes while the body goes one metre: 0 in a firm walk, 1 for who glides."""
    feet = [name for name in ("left_ankle", "right_ankle") if subject.has(name)]
    if len(feet) < 2 or not subject.has("pelvis"):
        return Unanswered("no feet")
    flat = np.array([1.0, 0.0, 1.0])
    moved = np.linalg.norm(np.diff(subject.at("pelvis"), axis=0) * flat, axis=-1)
    ways = [np.linalg.norm(np.diff(subject.at(name), axis=0) * flat, axis=-1) for name in feet]
    slower = nan_min(np.stack(ways), axis=0)
    low = nan_min(np.stack([subject.at(name)[:, 1] for name in feet]), axis=0)[1:] - subject.ground
    counted = (moved > _TRAVELS * subject.step) & np.isfinite(slower) & (low < 0.25) & (subject.step > 0)
    if counted.sum() * subject.interval < 2.0 or not _alternates(subject, counted):
        return Unanswered("the body walks for less than two seconds")
    return Value(float(slower[counted].sum() / moved[counted].sum()))


def under_floor(subject: Subject) -> Value | Unanswered:
    """How deep the lowest point of the feet is under the floor, for a tenth of the time."""
    if not subject.feet or not np.isfinite(subject.ground):
        return Unanswered("no feet")
    return Value(max(-100 * float(np.nanpercentile(_above(subject), 10)), 0.0))


def deepest(subject: Subject) -> Value | Unanswered:
    """How deep a foot ever is under the floor."""
    if not subject.feet or not np.isfinite(subject.ground):
        return Unanswered("no feet")
    above = _above(subject)
    return Value(max(-100 * float(np.nanmin(above)), 0.0), "", int(np.nanargmin(above)))


def floor_level(subject: Subject) -> Value | Unanswered:
    """How far the floor that the feet stand on is from where it was said to be."""
    if subject.floor is None or not subject.feet:
        return Unanswered("nobody said where the floor is: --floor 0")
    return Value(100 * abs(float(np.nanpercentile(_above(subject), 5))))


def hover(subject: Subject) -> Value | Unanswered:
    """The longest time of a script with all points 25 cm and more over the floor: no jump takes a second."""
    if not subject.steps or not np.isfinite(subject.ground):
        return Unanswered("no script, and without one nobody knows what the body stands on")
    lowest = nan_min(subject.places[..., 1], axis=1) - subject.ground
    run, start = longest_run(lowest > 0.25)
    return Value(run * subject.interval, "", start)


def idle_steps(subject: Subject) -> Value | Unanswered:
    """Steps of the feet per minute of standing still."""
    feet = [name for name in ("left_ankle", "right_ankle") if subject.has(name)]
    if not feet or not subject.has("head") or not subject.interval > 0:
        return Unanswered("no feet or no head")
    window = max(round(0.5 / subject.interval), 1)
    head = subject.speed[:, subject.points.index("head")]
    idle = np.convolve(np.nan_to_num(head, nan=9.0), np.ones(2 * window + 1) / (2 * window + 1), "same") < _IDLE
    minutes = float(idle.sum()) * subject.interval / 60
    if minutes * 60 < 4:
        return Unanswered("it stands still for less than 4 s")
    steps = 0
    for name in feet:
        fast = np.nan_to_num(subject.speed[:, subject.points.index(name)]) > _STEP
        begins = fast[1:] & ~fast[:-1] & idle[1:]
        steps += int(begins.sum())
    return Value(steps / minutes, f"{steps} steps in {60 * minutes:.0f} s")


def dead(subject: Subject) -> Value | Unanswered:
    """Of a script that asks for motion: the speed of its fastest joint, at the 90th percentile."""
    if not subject.steps or not len(subject.speed):
        return Unanswered("no script")
    speed = subject.speed[:, [subject.points.index(name) for name in _body(subject)]]
    return Value(float(np.nanpercentile(np.nan_to_num(speed).max(axis=1), 90)))


def is_calm(subject: Subject) -> bool:
    """Whether the body stands in its calmest second."""
    if subject.calm is None:
        return False
    names = [subject.points.index(name) for name in _body(subject)]
    return float(np.median(subject.speed[subject.calm][:-1][:, names])) < CALM_SPEED


def _alternates(subject: Subject, counted: np.ndarray) -> bool:
    """Whether the thighs swing against each other, as in walking."""
    if not subject.has("left_hip", "right_hip", "left_knee", "right_knee"):
        return False
    ahead = np.diff(subject.at("pelvis"), axis=0)[counted]
    swings = [
        ((subject.at(f"{s}_knee") - subject.at(f"{s}_hip"))[1:][counted] * ahead).sum(axis=-1)
        for s in ("left", "right")
    ]
    good = np.isfinite(swings[0]) & np.isfinite(swings[1])
    return bool(good.sum() > 10 and np.corrcoef(swings[0][good], swings[1][good])[0, 1] < -0.3)


_NONE = Unanswered("no frames that follow each other")


def _surprise(place: np.ndarray, step: np.ndarray) -> np.ndarray:
    """(T - 1,) m: how far each place lies from where the velocity before it would have taken it; NaN at first."""
    if len(place) < 3:
        return np.full(max(len(place) - 1, 0), np.nan)
    before = np.diff(place, axis=0)[:-1] / np.where(step[:-1] > 0, step[:-1], np.nan)[:, None]
    after = np.diff(place, axis=0)[1:]
    # Who accelerates is ahead of a prediction by his old speed alone: the shorter of the two ways counts.
    ahead = np.linalg.norm(after - before * step[1:, None], axis=-1)
    return np.concatenate([[np.nan], np.minimum(ahead, np.linalg.norm(after, axis=-1))])


def _above(subject: Subject) -> np.ndarray:
    """(T,) m: the lowest point of the feet over the floor."""
    return nan_min(np.stack([subject.at(name)[:, 1] for name in subject.feet]), axis=0) - subject.ground


def _body(subject: Subject) -> list[str]:
    return [name for name in subject.points if not is_finger(name) and subject.has(name)]


def _rotated(subject: Subject, *names: str) -> bool:
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


_TIMED = ("data.time_finite", "data.time_increases", "data.time_in_seconds", "data.gaps", "anatomy.height")

CHECKS = (
    Check("motion.teleport", teleport, "m", "The whole body jumps.", most=0.4, after=_TIMED),
    Check(
        "motion.body_speed",
        body_speed,
        "m/s",
        "Nobody runs faster than 11 m/s.",
        most=11,
        after=(*_TIMED, "motion.teleport"),
    ),
    Check(
        "motion.pop",
        pop,
        "m",
        "A joint leaps away for a frame and is back.",
        most=0.25,
        after=(*_TIMED, "motion.teleport"),
    ),
    Check(
        "motion.joint_speed",
        joint_speed,
        "m/s",
        "No joint of a body goes faster than 20 m/s.",
        most=20,
        after=(*_TIMED, "motion.teleport", "motion.pop"),
    ),
    Check("motion.body_flip", body_flip, "°", "The body turns about within a frame.", most=100, after=_TIMED),
    Check(
        "motion.rotation_flip",
        rotation_flip,
        "°",
        "A joint turns about within a frame.",
        most=130,
        after=(*_TIMED, "motion.body_flip", "anatomy.component_order"),
    ),
    Check("motion.shake", shake, "mm", "What stands trembles.", most=4, after=_TIMED),
    Check(
        "motion.rotation_shake",
        rotation_shake,
        "°",
        "What stands trembles in its rotations.",
        most=1.5,
        after=(*_TIMED, "anatomy.component_order"),
    ),
    Check("motion.drift", drift, "cm/s", "How calm the calmest second is.", after=_TIMED),
    Check("motion.jitter", jitter, "10² m/s³", "Third derivative, to compare with papers.", after=_TIMED),
    Check(
        "motion.skate",
        skate,
        "m per m",
        "Feet glide over the floor.",
        most=0.75,
        after=(*_TIMED, "motion.teleport", "anatomy.up_axis"),
    ),
    Check(
        "motion.under_floor",
        under_floor,
        "cm",
        "Feet are sunk into the floor.",
        most=8,
        after=("anatomy.height", "anatomy.up_axis"),
    ),
    Check("motion.deepest", deepest, "cm", "The deepest that a foot ever is.", after=("anatomy.height",)),
    Check(
        "motion.floor_level",
        floor_level,
        "cm",
        "The floor is elsewhere than said.",
        most=12,
        after=("anatomy.height", "anatomy.up_axis", "motion.under_floor"),
    ),
    Check(
        "motion.hover",
        hover,
        "s",
        "A body that hangs in the air.",
        most=1.2,
        after=(*_TIMED, "motion.floor_level", "motion.under_floor"),
    ),
    Check(
        "motion.idle_steps",
        idle_steps,
        "/min",
        "Feet that step while nobody does.",
        most=20,
        after=(*_TIMED, "motion.shake", "motion.pop"),
    ),
    Check("motion.dead", dead, "m/s", "A script was performed and nothing moved.", least=0.05, after=_TIMED),
)
