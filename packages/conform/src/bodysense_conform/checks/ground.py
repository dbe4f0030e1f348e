"""Ground: does it stand and walk on a floor?"""

from __future__ import annotations

from functools import partial

import numpy as np

from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.checks.anatomy import unit
from bodysense_conform.checks.data import longest_run
from bodysense_conform.checks.motion import TIMED
from bodysense_conform.subject import Subject, nan_min

_TRAVELS, _RUNS = 0.4, 2.0  # m/s: a pelvis between these walks
_IDLE = 0.06  # m/s: a head this slow stands
_STEP = 0.35  # m/s: a foot this fast steps


def skate(subject: Subject) -> Value | Unanswered:
    """How far the slower foot goes along while the body goes one metre: 0 in a firm walk, 1 for who glides."""
    feet = [name for name in ("left_ankle", "right_ankle") if subject.has(name)]
    if len(feet) < 2 or not subject.has("pelvis"):
        return Unanswered("no feet")
    flat = np.array([1.0, 0.0, 1.0])
    way = np.diff(subject.at("pelvis"), axis=0) * flat
    moved, ahead = np.linalg.norm(way, axis=-1), unit(way)
    ways = np.stack([np.diff(subject.at(name), axis=0) * flat for name in feet])
    slower = np.nan_to_num(np.linalg.norm(ways, axis=-1), nan=np.inf).argmin(axis=0)
    along = (ways[slower, np.arange(len(way))] * ahead).sum(axis=-1)  # feet that move otherwise dance
    low = nan_min(np.stack([subject.at(name)[:, 1] for name in feet]), axis=0)[1:] - subject.ground
    counted = (
        (moved > _TRAVELS * subject.step)
        & (moved < _RUNS * subject.step)
        & np.isfinite(along)
        & (low < 0.25)
        & (subject.step > 0)
    )
    counted &= _goes_on(subject)
    if counted.sum() * subject.interval < 2.0 or not _alternates(subject, counted):
        return Unanswered("the body walks for less than two seconds")
    return Value(float(np.clip(along, 0, moved)[counted].sum() / moved[counted].sum()))


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
    for step in subject.labelled("march", "left_leg_raise", "right_leg_raise", "other"):
        idle &= ~subject.during(step)[1:]
    minutes = float(idle.sum()) * subject.interval / 60
    if minutes * 60 < 8:
        return Unanswered("it stands still for less than 8 s")
    steps = 0
    for name in feet:
        fast = np.nan_to_num(subject.speed[:, subject.points.index(name)]) > _STEP
        begins = fast[1:] & ~fast[:-1] & idle[1:]
        steps += int(begins.sum())
    return Value(steps / minutes, f"{steps} steps in {60 * minutes:.0f} s")


def _goes_on(subject: Subject) -> np.ndarray:
    """(T - 1,) bool: the pelvis is elsewhere half a second before than half a second after, by a walk's way."""
    half = max(round(0.5 / subject.interval), 1)
    place = subject.at("pelvis") * np.array([1.0, 0.0, 1.0])
    frames = np.arange(1, len(place))
    before, after = np.maximum(frames - half, 0), np.minimum(frames + half, len(place) - 1)
    return np.linalg.norm(place[after] - place[before], axis=-1) > _TRAVELS * (after - before) * subject.interval


def _alternates(subject: Subject, counted: np.ndarray) -> bool:
    """Whether the thighs swing against each other, as in walking."""
    if not subject.has("left_hip", "right_hip", "left_knee", "right_knee"):
        return False
    ahead = unit(np.diff(subject.at("pelvis"), axis=0)[counted] * np.array([1.0, 0.0, 1.0]))
    swings = [
        ((subject.at(f"{s}_knee") - subject.at(f"{s}_hip"))[1:][counted] * ahead).sum(axis=-1)
        for s in ("left", "right")
    ]
    good = np.isfinite(swings[0]) & np.isfinite(swings[1])
    return bool(good.sum() > 10 and np.corrcoef(swings[0][good], swings[1][good])[0, 1] < -0.3)


def _above(subject: Subject) -> np.ndarray:
    """(T,) m: the lowest point of the feet over the floor."""
    return nan_min(np.stack([subject.at(name)[:, 1] for name in subject.feet]), axis=0) - subject.ground


_check = partial(check_of, "motion")
_timed = partial(check_of, "motion", before=TIMED)

CHECKS = (
    _timed("skate", skate, "m per m", "Feet glide over the floor.", most=0.9, after=("teleport", "anatomy.up_axis")),
    _check(
        "under_floor",
        under_floor,
        "cm",
        "Feet are sunk into the floor.",
        most=8,
        after=("anatomy.height", "anatomy.up_axis"),
    ),
    _check("deepest", deepest, "cm", "The deepest that a foot ever is.", after=("anatomy.height",)),
    _check(
        "floor_level",
        floor_level,
        "cm",
        "The floor is elsewhere than said.",
        most=12,
        after=("anatomy.height", "anatomy.up_axis", "under_floor"),
    ),
    _timed("hover", hover, "s", "A body that hangs in the air.", most=1.2, after=("floor_level", "under_floor")),
    _timed("idle_steps", idle_steps, "/min", "Feet that step while nobody does.", most=40, after=("shake", "pop")),
)
