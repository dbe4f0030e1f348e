"""Floor: gliding feet, and steps of a body that stands."""

from __future__ import annotations

import numpy as np

from bodysense_conform.series import Series, change, later, need, norm
from bodysense_conform.subject import SIDES, Subject

_FLAT = np.array([1.0, 0.0, 1.0])
_GLIDE, _SPARE = 1.0, 0.25  # s of a glide, and before and after it in which the foot stays down, too
_LIFTED, _STANDS = 0.015, 0.03  # m; largest rise of a gliding sole, and motion of the body meanwhile

_WALKS, _RUNS = 0.4, 2.0  # m/s; a pelvis between these walks
_IDLE, _STEP = 0.06, 0.35  # m/s; a slower head stands still; a faster foot steps
_LEGS = tuple(f"{side}_{part}" for side in SIDES for part in ("ankle", "knee", "hip"))


def glide(subject: Subject, side: str) -> Series:
    """Distance that a foot slides on the floor within a second, cm, if it is not lifted and the body stands."""
    need(subject.has("pelvis", "head") and subject.feet, "no feet, no pelvis or no head")
    frames, spare = subject.frames(_GLIDE), subject.frames(_SPARE)
    need(len(subject) > frames + 2 * spare, "shorter than two seconds")
    ankle, sole = subject.at(f"{side}_ankle"), subject.soles[side]

    def ranges(values: np.ndarray) -> np.ndarray:
        """Range of values (T, …) over the glide up to each frame, a little before and after; NaN if cut off."""
        found = np.full(values.shape, np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(values, frames + 2 * spare + 1, axis=0)
        found[frames + spare : -spare] = np.ptp(windows, axis=-1)
        return found

    still = np.all([ranges(subject.at(name)).max(axis=-1) < _STANDS for name in ("pelvis", "head")], axis=0)
    low = (ranges(sole) < _LIFTED) & (ranges(ankle[:, 1]) < _LIFTED)
    low &= np.abs(later(sole, -frames) - subject.ground) < 2 * _LIFTED
    return np.where(still & low, 100 * norm(change(ankle, frames) * _FLAT), np.nan)


def hovers(subject: Subject) -> Series:
    """Whether all points are 25 cm and more over the floor, in a script; without one, a body may stand on anything."""
    need(subject.steps, "no script")
    return np.fmin.reduce(subject.places[..., 1], axis=1) - subject.ground > 0.25


def skate(subject: Subject) -> Series:
    """Speed of the slower foot along the body's path, as a share of the walking body's: 0 firm, 1 gliding."""
    need(subject.has("pelvis", *_LEGS), "no pelvis or no legs")
    half = subject.frames(0.5)
    pelvis = subject.at("pelvis")
    way = change(pelvis) * _FLAT
    distance = norm(way)
    ahead = way / np.maximum(distance, 1e-9)[:, None]
    feet = np.stack([change(subject.at(f"{side}_ankle")) * _FLAT for side in SIDES])
    slower = np.nan_to_num(norm(feet), nan=np.inf).argmin(axis=0)
    along = (feet[slower, np.arange(len(way))] * ahead).sum(axis=-1)
    speed = distance / subject.interval
    far = (later(pelvis, half) - later(pelvis, -half)) * _FLAT  # over a whole second, too
    goes = norm(far) > _WALKS * 2 * half * subject.interval
    counted = goes & (speed > _WALKS) & (speed < _RUNS) & (subject.lower_sole - subject.ground < 0.2)
    need(counted.sum() * subject.interval >= 2, "the body walks for less than two seconds")
    left, right = ((subject.line(f"{side}_hip", f"{side}_knee") * ahead).sum(-1)[counted] for side in SIDES)
    need(np.corrcoef(left, right)[0, 1] < -0.3, "the body moves, but its thighs do not swing in turns")
    return np.clip(along, 0, distance)[counted].sum() / distance[counted].sum()


def idle_steps(subject: Subject) -> Series:
    """Whether a foot begins to step while the head stands still and no step of the script moves the feet."""
    need(subject.has("head") and subject.feet, "no feet or no head")
    window = np.ones(2 * subject.frames(0.5) + 1)
    head = np.nan_to_num(subject.speed(["head"])[:, 0], nan=9.0)
    idle = np.convolve(head, window / len(window), "same")[: len(head)] < _IDLE
    idle &= ~subject.within("march", "left_leg_raise", "right_leg_raise", "other")
    ankles = [name for name in ("left_ankle", "right_ankle") if subject.has(name)]
    fast = np.nan_to_num(subject.speed(ankles)) > _STEP
    begins = (np.diff(fast.astype(int), axis=0, prepend=1) > 0).sum(axis=1)
    need(not idle.sum() * subject.interval < 8, "the body stands still for less than 8 s")
    return np.where(idle, begins, np.nan)
