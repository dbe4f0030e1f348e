"""Gaps in the turn of a joint, filled between what is known on both sides; a guess may say what happens inside.

Near the sides of a gap the turn from one to the other is right, and it errs the more the farther they are; a guess is
as good everywhere. So a guess is first bent so that it begins and ends where the joint does, and then counts the more
the farther the sides are. What is known is never changed.
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

COASTING = 0.8  # s in which the speed beside a gap fades; gaps shorter than that are cubics. Validation people
BRIEF = 0.25  # s: in a gap no longer than this, known on both sides, a guess tells nothing more
SMOOTH = 0.07  # s, deviation of the bell that takes the tremble from the tracker's guess


def runs(present: np.ndarray) -> list[tuple[int, int]]:
    """Where (T,) bool is true: the first frame of each run, and the one after its last."""
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
    """Rotations (T, 4) of one joint, filled where `missing` (T,).

    Args:
        rotation: (T, 4), anything where it is missing.
        missing: (T,) bool.
        seconds: between frames.
        guess: (T, 4) of all frames; None turns the joint from one side of every gap to the other.
        trusted: s away from known frames where the guess counts half.
        coasting: s in which the speed beside a gap fades.
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
    """Rotations (N, 4) from one side of a gap to the other; held where there is one side.

    The speed on either side goes on and fades within `fading` frames; between, the turn is at constant speed. A gap
    shorter than that is the cubic through the two known frames on either side.
    """
    frames, count = len(rotation), end - first
    before, after = rotation[first - 1 if first else end], rotation[end if end < frames else first - 1]
    whole = _difference(before, after)
    span = count + 1
    step, coasting = whole / span, min(fading, span)
    led, left = np.zeros(3), np.zeros(3)  # how much faster than `step` the known frames on either side turn
    if first > 1 and not missing[first - 2]:
        led = _difference(rotation[first - 2], before) - step
    if end < frames - 1 and not missing[end + 1]:
        left = _rate_at(whole, _difference(after, rotation[end + 1])) - step
    # Speeds at the sides of which those to the frame beyond are chords.
    own, other = (1 + 1 / coasting) ** 2, (span + 1) / span**2 if coasting == span and first > 0 and end < frames else 0
    led, left = (own * led - other * left) / (own**2 - other**2), (own * left - other * led) / (own**2 - other**2)
    gone = np.arange(1.0, count + 1)[:, None]
    way = gone * step + gone * _fading(gone / coasting) * led
    way = way - (span - gone) * _fading((span - gone) / coasting) * left
    return np.asarray(quaternion_multiply(np.broadcast_to(before, (count, 4)), quaternion_exp(way)))


def _rate_at(turn: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """How fast a rotation vector (3,) changes if what it turns has an angular velocity (3,) in its own axes."""
    across = np.cross(turn, speed)
    return speed + across / 2 + np.cross(turn, across) / 12


def _fading(share: np.ndarray) -> np.ndarray:
    """From 1 at 0 to 0 at 1."""
    return np.maximum(0.0, 1 - share) ** 2


def _away(first: int, end: int, frames: int) -> np.ndarray:
    """(N,) how many frames each of a gap is away from what is known: as a bridge between two sides, or from one."""
    count = np.arange(1.0, end - first + 1)
    before = count if first > 0 else np.full(len(count), np.inf)
    after = count[::-1] if end < frames else np.full(len(count), np.inf)
    return 1 / (1 / before + 1 / after)


def _bent(kept: np.ndarray, guess: np.ndarray, first: int, end: int, seconds: float) -> np.ndarray:
    """The guess (N, 4), N ≥ 2, in a gap, turned so that it goes on from the frame before and leads to the frame after.

    What it lacks on either side is added in full there and fades to the other side.
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
    """Rotations (N, 4), each the mean of those around it by a bell of so many frames' deviation."""
    reach = int(np.ceil(3 * frames))
    flips = np.where((rotation[1:] * rotation[:-1]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    whole = np.concatenate([rotation[:1], rotation[1:] * np.cumprod(flips, axis=0)])
    around = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (around / frames) ** 2)
    places = np.clip(np.arange(len(whole))[:, None] + around, 0, len(whole) - 1)
    return np.asarray(normalize(np.einsum("nk,nkc->nc", np.broadcast_to(weights, places.shape), whole[places])))


def _beyond(pair: np.ndarray) -> np.ndarray:
    """The rotation (4,) that follows two (2, 4) at the same speed."""
    return np.asarray(quaternion_multiply(pair[1], quaternion_multiply(quaternion_conjugate(pair[0]), pair[1])))


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotation vector (3,) from a to b."""
    return np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(a), b)))
