"""Floor: soles, gliding feet, steps of a body that stands."""

from __future__ import annotations

import numpy as np

from bodysense_conform.series import NotEnough, Series, series, stacked
from bodysense_conform.subject import Subject, nan_min

_SIDES = ("left", "right")
_FLAT = np.array([1.0, 0.0, 1.0])
_GLIDE, _SPARE = 1.0, 0.25  # s of a glide, and before and after it in which the foot stays down, too
_LIFTED, _STANDS = 0.015, 0.03  # m that a gliding sole rises, and that the body moves meanwhile

_WALKS, _RUNS = 0.4, 2.0  # m/s; a pelvis between these walks
_IDLE, _STEP = 0.06, 0.35  # m/s; a slower head stands still; a faster foot steps


def glide(subject: Subject) -> Series:
    """Way of a foot along the floor within a second, cm, if it is not lifted and the body stands."""
    if not subject.has("pelvis", "head") or not subject.feet:
        raise NotEnough("no feet, no pelvis or no head")
    frames, spare = subject.frames(_GLIDE), subject.frames(_SPARE)
    if len(subject) <= frames + 2 * spare:
        raise NotEnough("shorter than two seconds")

    def ranges(values: np.ndarray) -> np.ndarray:
        """Range (T - frames - 2 spare, …) of values (T, …) over a glide and a little before and after."""
        return np.ptp(np.lib.stride_tricks.sliding_window_view(values, frames + 2 * spare + 1, axis=0), axis=-1)

    still = np.all([ranges(subject.at(name)).max(axis=-1) < _STANDS for name in ("pelvis", "head")], axis=0)
    columns = {}
    for k, side in enumerate(_SIDES):
        if subject.has(f"{side}_ankle"):
            ankle, sole = subject.at(f"{side}_ankle"), subject.soles[:, k]
            low = (ranges(sole) < _LIFTED) & (ranges(ankle[:, 1]) < _LIFTED)
            low &= np.abs(sole[spare : spare + len(low)] - subject.ground) < 2 * _LIFTED
            moved = 100 * np.linalg.norm((ankle[frames:] - ankle[:-frames]) * _FLAT, axis=-1)[spare:-spare]
            columns[f"{side}_ankle"] = np.full(len(subject), np.nan)
            columns[f"{side}_ankle"][frames + spare : -spare] = np.where(still & low, moved, np.nan)
    return stacked(columns, "no ankle")


def lower_sole(subject: Subject) -> Series:
    """Height of the lower sole over a known floor, cm."""
    if subject.floor is None:
        raise NotEnough("the height of the floor is unknown (--floor 0)")
    return series(100 * (nan_min(subject.soles, axis=1) - subject.floor))


def soles(subject: Subject) -> Series:
    """Height of each sole over the floor, cm."""
    if not np.isfinite(subject.ground):
        raise NotEnough("no feet")
    return Series(100 * (subject.soles - subject.ground), ("left_foot", "right_foot"))


def hovers(subject: Subject) -> Series:
    """Whether all points are 25 cm and more over the floor, in a script; without one, a body may stand on anything."""
    if not subject.steps:
        raise NotEnough("no script")
    return series(nan_min(subject.places[..., 1], axis=1) - subject.ground > 0.25)


def skate(subject: Subject) -> Series:
    """Way of the slower foot along the body's, as a share of it, where the body walks: 0 firm, 1 gliding."""
    if not subject.has("pelvis", "left_ankle", "right_ankle", "left_knee", "right_knee", "left_hip", "right_hip"):
        raise NotEnough("no pelvis or no legs")
    half = subject.frames(0.5)
    way = np.diff(subject.at("pelvis"), axis=0, prepend=np.nan) * _FLAT
    moved = np.linalg.norm(way, axis=-1)
    ahead = way / np.maximum(moved, 1e-9)[:, None]
    feet = np.stack([np.diff(subject.at(f"{side}_ankle"), axis=0, prepend=np.nan) * _FLAT for side in _SIDES])
    slower = np.nan_to_num(np.linalg.norm(feet, axis=-1), nan=np.inf).argmin(axis=0)
    along = (feet[slower, np.arange(len(way))] * ahead).sum(axis=-1)
    speed = moved / subject.interval
    goes = np.zeros(len(way), dtype=bool)  # over a whole second, too
    far = (subject.at("pelvis")[2 * half :] - subject.at("pelvis")[: -2 * half]) * _FLAT
    goes[half:-half] = np.linalg.norm(far, axis=-1) > _WALKS * 2 * half * subject.interval
    counted = goes & (speed > _WALKS) & (speed < _RUNS) & (nan_min(subject.soles, axis=1) - subject.ground < 0.2)
    left, right = (((subject.at(f"{s}_knee") - subject.at(f"{s}_hip")) * ahead).sum(-1)[counted] for s in _SIDES)
    if counted.sum() * subject.interval < 2 or not np.corrcoef(left, right)[0, 1] < -0.3:
        raise NotEnough("the body walks for less than two seconds")
    return series(np.clip(along, 0, moved)[counted].sum() / moved[counted].sum())


def idle_steps(subject: Subject) -> Series:
    """Whether a foot begins to step while the head stands still and no step of the script moves the feet."""
    if not subject.has("head") or not subject.feet:
        raise NotEnough("no feet or no head")
    window = np.ones(2 * subject.frames(0.5) + 1)
    head = np.nan_to_num(subject.speed[:, subject.columns(["head"])[0]], nan=9.0)
    idle = np.convolve(head, window / len(window), "same")[: len(head)] < _IDLE
    for step in subject.labelled("march", "left_leg_raise", "right_leg_raise", "other"):
        idle &= ~subject.during(step)
    begins = np.zeros(len(subject))
    for name in (name for name in ("left_ankle", "right_ankle") if subject.has(name)):
        fast = np.nan_to_num(subject.speed[:, subject.columns([name])[0]]) > _STEP
        begins[1:] += fast[1:] & ~fast[:-1]
    if idle.sum() * subject.interval < 8:
        raise NotEnough("the body stands still for less than 8 s")
    return series(np.where(idle, begins, np.nan))
