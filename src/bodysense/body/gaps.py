"""Gaps in a joint's rotation, filled from the known frames on both sides; a guess may describe the motion inside.

Near the sides of a gap interpolation is accurate, and its error grows with the distance from them; a guess is equally
accurate everywhere. So a guess is first bent to begin and end at the known rotations, and its weight grows with the
distance from the sides. Known frames are never changed.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.rotation import (
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    slerp,
)

COASTING = 0.8  # s in which the speed at a gap's edge fades; shorter gaps are cubics. Chosen on validation people
BRIEF = 0.25  # s: in a gap no longer than this, known on both sides, a guess adds nothing
SMOOTH = 0.07  # s, deviation of the Gaussian that removes jitter from the tracker's guess


def runs(present: np.ndarray) -> list[tuple[int, int]]:
    """Return the runs where (T,) bool is true: the first frame of each, and the one after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], present, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def filled(
    rotation: np.ndarray,
    missing: np.ndarray,
    seconds: float,
    guess: np.ndarray | None = None,
    trusted: float = 1.0,
    coasting: float = COASTING,
) -> np.ndarray:
    """Return rotations (T, 4) of one joint, filled where `missing` (T,).

    Args:
        rotation: (T, 4), arbitrary where missing.
        missing: (T,) bool.
        seconds: between frames.
        guess: (T, 4) of all frames; None interpolates from one side of every gap to the other.
        trusted: s from known frames at which the guess has weight one half.
        coasting: s in which the speed at a gap's edge fades.
    """
    result = np.array(rotation)
    for first, end in runs(missing):
        sided = first > 0 or end < len(missing)
        brief = first > 0 and end < len(missing) and (end - first) * seconds <= BRIEF
        if guess is not None and not brief and (not sided or end - first > 1):
            inside = guess[first:end]
            if sided:
                away = _away(first, end, len(missing)) * seconds
                share = away**2 / (away**2 + trusted**2)
                bent = _bent(result, inside, first, end, seconds)
                inside = slerp(_turn(result, missing, first, end, coasting / seconds), bent, share)
        else:
            inside = _turn(result, missing, first, end, coasting / seconds) if sided else result[first:end]
        result[first:end] = quaternion_canonical(inside)
    return result


def _turn(rotation: np.ndarray, missing: np.ndarray, first: int, end: int, fading: float) -> np.ndarray:
    """Interpolate rotations (N, 4) from one side of a gap to the other; constant if only one side is known.

    The speed on either side continues and fades within `fading` frames; in between, the speed is constant. A gap
    shorter than that is the cubic through the two known frames on either side.
    """
    frames, count = len(rotation), end - first
    before, after = rotation[first - 1 if first else end], rotation[end if end < frames else first - 1]
    whole = _difference(before, after)
    span = count + 1
    step, coasting = whole / span, min(fading, span)
    led, left = np.zeros(3), np.zeros(3)  # excess speed over `step` of the known frames on either side
    if first > 1 and not missing[first - 2]:
        led = _difference(rotation[first - 2], before) - step
    if end < frames - 1 and not missing[end + 1]:
        left = _rate_at(whole, _difference(after, rotation[end + 1])) - step
    # Speeds at the sides, whose chords are the speeds to the next frame outside.
    own, other = (1 + 1 / coasting) ** 2, (span + 1) / span**2 if coasting == span and first > 0 and end < frames else 0
    led, left = (own * led - other * left) / (own**2 - other**2), (own * left - other * led) / (own**2 - other**2)
    gone = np.arange(1.0, count + 1)[:, None]
    way = gone * step + gone * _fading(gone / coasting) * led
    way = way - (span - gone) * _fading((span - gone) / coasting) * left
    return np.asarray(quaternion_multiply(np.broadcast_to(before, (count, 4)), quaternion_exp(way)))


def _rate_at(turn: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """Return the rate of a rotation vector (3,) for an angular velocity (3,) in the rotated axes."""
    across = np.cross(turn, speed)
    return speed + across / 2 + np.cross(turn, across) / 12


def _fading(share: np.ndarray) -> np.ndarray:
    """Return a weight that falls from 1 at 0 to 0 at 1."""
    return np.maximum(0.0, 1 - share) ** 2


def _away(first: int, end: int, frames: int) -> np.ndarray:
    """Return the distance (N,) of a gap's frames from known ones, in frames: harmonic between two sides."""
    count = np.arange(1.0, end - first + 1)
    before = count if first > 0 else np.full(len(count), np.inf)
    after = count[::-1] if end < frames else np.full(len(count), np.inf)
    return 1 / (1 / before + 1 / after)


def _bent(kept: np.ndarray, guess: np.ndarray, first: int, end: int, seconds: float) -> np.ndarray:
    """Bend the guess (N, 4), N ≥ 2, in a gap so that it continues the frame before and leads to the frame after.

    The difference at either side is added in full there and fades toward the other side.
    """
    inside = _smooth(guess, SMOOTH / seconds)
    lacking = np.zeros((2, 3))
    if first > 0:
        lacking[0] = _difference(_beyond(inside[1::-1]), kept[first - 1])
    if end < len(kept):
        lacking[1] = _difference(_beyond(inside[-2:]), kept[end])
    steps = (np.arange(1.0, end - first + 1) / (end - first + 1))[:, None]
    return np.asarray(quaternion_multiply(inside, quaternion_exp((1 - steps) * lacking[0] + steps * lacking[1])))


def _smooth(rotation: np.ndarray, frames: float) -> np.ndarray:
    """Average rotations (N, 4) over their neighbours by a Gaussian; `frames` is its standard deviation."""
    reach = int(np.ceil(3 * frames))
    flips = np.where((rotation[1:] * rotation[:-1]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    whole = np.concatenate([rotation[:1], rotation[1:] * np.cumprod(flips, axis=0)])
    around = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (around / frames) ** 2)
    places = np.clip(np.arange(len(whole))[:, None] + around, 0, len(whole) - 1)
    return np.asarray(normalize(np.einsum("nk,nkc->nc", np.broadcast_to(weights, places.shape), whole[places])))


def _beyond(pair: np.ndarray) -> np.ndarray:
    """Return the rotation (4,) that follows two (2, 4) at constant speed."""
    return np.asarray(quaternion_multiply(pair[1], quaternion_multiply(quaternion_conjugate(pair[0]), pair[1])))


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the rotation vector (3,) from a to b."""
    return np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(a), b)))
