"""Gaps in a joint's rotation, filled from the known frames on both sides and an optional guess of the motion inside.

Interpolation is accurate near the sides of a gap, and its error grows with the distance from them. A guess is equally
accurate everywhere. So the guess is first bent to begin and end at the known rotations, and its weight grows with the
distance from the sides. Known frames never change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bodysense.geometry.rotation import (
    cross,
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    slerp,
)
from bodysense.geometry.series import continuous, smoothed

COASTING = 0.8  # s in which the speed at a gap's edge fades; shorter gaps are cubics. Chosen on validation people
BRIEF = 0.25  # s; gaps that are no longer, with two known sides, are interpolated without the guess
SMOOTH = 0.07  # s; standard deviation of the Gaussian that removes jitter from the guess


class Rotations(Protocol):
    """Rotations (T, ..., 4) of joints: an array, or an object that computes the frames which are taken."""

    def __len__(self) -> int: ...

    def __getitem__(self, frames: int | slice, /) -> np.ndarray: ...


@dataclass(frozen=True)
class Trust:
    """Weight of a guess against the interpolation, by the distance from known frames."""

    share: float = 1.0  # weight far from both sides of a gap
    seconds: float = 1.0  # s from known frames at which the weight is half of `share`
    one_sided: float = 1.0  # s from known frames at which the weight is one half, if only one side is known

    def weight(self, distance: np.ndarray, both_sides: bool) -> np.ndarray:
        """Return the weight (N,) of the guess in frames that are `distance` (N,) s from known ones."""
        if both_sides:
            return self.share * distance**2 / (distance**2 + self.seconds**2)
        return distance**2 / (distance**2 + self.one_sided**2)


def runs(present: np.ndarray) -> list[tuple[int, int]]:
    """Return the runs of true values in a mask (T,): first frame of each, and the frame after its last."""
    padded = np.zeros(len(present) + 2, dtype=bool)
    padded[1:-1] = present
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def fill(
    rotation: np.ndarray,
    missing: np.ndarray,
    seconds: float,
    guess: np.ndarray | None = None,
    trust: Trust = Trust(),
    coasting: float = COASTING,
    deviation: np.ndarray | None = None,
) -> np.ndarray:
    """Fill the `missing` frames of one joint's rotations (T, 4).

    Args:
        rotation: (T, 4), arbitrary if missing.
        missing: (T,) bool.
        seconds: time between frames.
        guess: (T, 4) of all frames; without it every gap is interpolated.
        trust: weight of the guess.
        coasting: s in which the speed at a gap's edge fades.
        deviation: (T, 3) rad, expected turn from the interpolation to the truth in the joint's axes; 0 if omitted.
    """
    result = np.array(rotation)
    for first, end in runs(missing):
        both = first > 0 and end < len(missing)
        sided = first > 0 or end < len(missing)
        inside = result[first:end]
        if sided:
            speeds = first > 1 and not missing[first - 2], end < len(missing) - 1 and not missing[end + 1]
            inside = interpolate(result, first, end, coasting / seconds, speeds)
            if deviation is not None:
                inside = np.asarray(quaternion_multiply(inside, quaternion_exp(deviation[first:end])))
        if guess is not None and not sided:
            inside = guess[first:end]
        elif guess is not None and end - first > 1 and not (both and (end - first) * seconds <= BRIEF):
            # The distance from known frames, in frames: harmonic between two sides.
            count = np.arange(1.0, end - first + 1)
            nearness = (first > 0) / count + (end < len(missing)) / count[::-1]
            share = trust.weight(seconds / nearness, both)
            inside = slerp(inside, _bend_guess(result, guess[first:end], first, end, seconds), share)
        result[first:end] = quaternion_canonical(inside)
    return result


def continue_into_gaps(
    rotation: np.ndarray,
    missing: np.ndarray,
    seconds: float,
    guess: np.ndarray | None = None,
    trust: Callable[[int], Trust] = lambda first: Trust(),
    coasting: float = COASTING,
) -> np.ndarray:
    """Fill rotations (T, 4) like `fill`, but each frame only from the frames before it and its own guess.

    `trust` maps the first frame of a gap to its `Trust`. Before the first known frame the result is the guess.
    """
    result = np.array(rotation)
    for first, end in runs(missing):
        inside, distance, fading = result[first:end], np.arange(1, end - first + 1), coasting / seconds
        if first > 0:
            before, still = result[first - 1], np.zeros(3)
            entry = _difference(result[first - 2], before) if first > 1 and not missing[first - 2] else None
            path = _displacement(still, (entry, None), max(end - first, int(np.ceil(fading))), fading, False)[
                : end - first
            ]
            inside = np.asarray(quaternion_multiply(np.broadcast_to(before, (len(path), 4)), quaternion_exp(path)))
        if guess is not None:
            share = trust(first).weight(distance * seconds, False) if first > 0 else np.ones(len(distance))
            inside = slerp(inside, guess[first:end], share)
        result[first:end] = quaternion_canonical(inside)
    return result


def interpolate(
    rotation: Rotations,
    first: int,
    end: int,
    fading: float,
    speeds: tuple[bool, bool] = (True, True),
    part: slice = slice(None),
) -> np.ndarray:
    """Interpolate rotations (N, ..., 4) of joints (T, ..., 4) from one side of a gap to the other.

    If only one side is known, the joint comes to rest. The speed at each side continues and fades within `fading`
    frames; in between, the speed is constant. A shorter gap is the cubic through the two known frames on each side.

    Args:
        rotation: (T, ..., 4), known on at least one side of the gap.
        first: first frame of the gap.
        end: frame after its last.
        fading: number of frames in which the speed at a side fades.
        speeds: whether two frames are known before and after the gap.
        part: frames of the gap that are returned, counted from its first.
    """
    frames = len(rotation)
    before, after = rotation[first - 1 if first else end], rotation[end if end < frames else first - 1]
    whole = _difference(before, after)
    entry = _difference(rotation[first - 2], before) if speeds[0] and first > 1 else None
    leaving = _rate_at(whole, _difference(after, rotation[end + 1])) if speeds[1] and end < frames - 1 else None
    path = _displacement(whole, (entry, leaving), end - first, fading, first > 0 and end < frames, part)
    return np.asarray(quaternion_multiply(np.broadcast_to(before, (*path.shape[:-1], 4)), quaternion_exp(path)))


def interpolate_positions(
    place: np.ndarray, first: int, end: int, fading: float, part: slice = slice(None)
) -> np.ndarray:
    """Interpolate positions (N, 3) of a point (T, 3) over a gap with known frames on both sides, like `interpolate`."""
    before, after = place[first - 1], place[end]
    entry = before - place[first - 2] if first > 1 else None
    leaving = place[end + 1] - after if end < len(place) - 1 else None
    return before + _displacement(after - before, (entry, leaving), end - first, fading, True, part)


def _displacement(
    whole: np.ndarray,
    speeds: tuple[np.ndarray | None, np.ndarray | None],
    count: int,
    fading: float,
    both: bool,
    part: slice = slice(None),
) -> np.ndarray:
    """Return displacements (N, ..., 3) from the frame before a gap to its `count` frames, or a part of them.

    `whole` (..., 3) is the displacement to the frame after the gap. `speeds` are displacements per frame before and
    after the gap; None if unknown.
    """
    span = count + 1
    step, coasting = whole / span, min(fading, span)
    entry, leaving = (np.zeros_like(whole) if speed is None else speed - step for speed in speeds)  # excess speeds
    # Convert speeds to the next frame outside (chords) to speeds at the sides (tangents).
    own, other = (1 + 1 / coasting) ** 2, (span + 1) / span**2 if coasting == span and both else 0
    entry, leaving = (
        (own * entry - other * leaving) / (own**2 - other**2),
        (own * leaving - other * entry) / (own**2 - other**2),
    )
    gone = np.arange(1.0, count + 1)[part].reshape(-1, *[1] * whole.ndim)
    path = gone * step + gone * coasting_weight(gone / coasting) * entry
    return path - (span - gone) * coasting_weight((span - gone) / coasting) * leaving


def _rate_at(turn: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the rate of a rotation vector (3,) for an angular velocity (3,) in the rotated axes."""
    across = cross(turn, speed)
    return speed + across / 2 + cross(turn, across) / 12


def coasting_weight(share: np.ndarray) -> np.ndarray:
    """Return the weight of a speed at a gap's edge, which falls from 1 there to 0 at share 1 of its coasting."""
    return np.maximum(0.0, 1 - share) ** 2


def _bend_guess(kept: np.ndarray, guess: np.ndarray, first: int, end: int, seconds: float) -> np.ndarray:
    """Bend the guess (N, 4), N ≥ 2, so that it continues the frame before the gap and leads to the frame after it.

    The correction at each side fades toward the other side.
    """
    inside = np.asarray(normalize(smoothed(continuous(guess), SMOOTH / seconds)))
    lacking = np.zeros((2, 3))
    if first > 0:
        lacking[0] = _difference(_extrapolate(inside[1::-1]), kept[first - 1])
    if end < len(kept):
        lacking[1] = _difference(_extrapolate(inside[-2:]), kept[end])
    steps = (np.arange(1.0, end - first + 1) / (end - first + 1))[:, None]
    return np.asarray(quaternion_multiply(inside, quaternion_exp((1 - steps) * lacking[0] + steps * lacking[1])))


def _extrapolate(pair: np.ndarray) -> np.ndarray:
    """Extrapolate two rotations (2, 4) by one frame at constant speed."""
    return np.asarray(quaternion_multiply(pair[1], quaternion_multiply(quaternion_conjugate(pair[0]), pair[1])))


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation vector (3,) from a to b."""
    return np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(a), b)))
