"""Footing: the height of soles over the floor, and how far to move a foot so that it does not slide while it stands."""

from __future__ import annotations

import numpy as np
from array_api_compat import array_namespace

from bodysense.body.gaps import runs
from bodysense.body.pose import as_like
from bodysense.body.rotation import Array, smooth_step
from bodysense.body.skeleton import Skeleton

SOLE_POINTS = tuple(f"{side}_{name}" for side in ("left", "right") for name in ("ankle", "foot", "toe"))
HOLD, RELEASE = 0.6, 0.4  # probability of contact from which a foot stands, and below which it no longer does
FADE = 0.2  # s in which a foot that is lifted comes back to where it would have been
FARTHEST = 0.12  # m that a foot is moved at most: farther off it is the contact that is wrong


def sole_clearance(position: Array, skeleton: Skeleton) -> Array:
    """Return the height (...) m of the lowest sole above the floor y = 0, from points (..., P, 3) m; negative below it.

    A sole is the lowest of ankle, ball and toe tip, each measured from its height in the rest pose with the soles on
    the floor.
    """
    xp = array_namespace(position)
    return xp.minimum(side_clearance(position, skeleton, "left"), side_clearance(position, skeleton, "right"))


def side_clearance(position: Array, skeleton: Skeleton, side: str) -> Array:
    """Return `sole_clearance` (...) of one foot, 'left' or 'right'."""
    xp = array_namespace(position)
    soles = skeleton.indices([name for name in SOLE_POINTS if name.startswith(side)])
    resting = skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[soles, 1]
    height = position[..., 1][..., list(soles)] - as_like(resting, position)
    return xp.min(height, axis=-1)


def stop_sliding(
    place: np.ndarray,
    contact: np.ndarray,
    free: np.ndarray,
    seconds: float,
    farthest: float = FARTHEST,
    fade: float = FADE,
    hold: tuple[float, float] = (HOLD, RELEASE),
) -> np.ndarray:
    """How far (T, 3) m to move a foot along the floor in `free` frames; 0 in all others.

    Where the foot stands up to a frame that is not free, it stands where it is in that frame; between two of them that
    differ it moves evenly.

    Args:
        place: (T, K, 3) m, y up: points of the foot that may rest on the floor.
        contact: (T, K) probability that they do.
        free: (T,) bool: frames in which the foot may be moved.
        seconds: between frames.
        farthest: m that the foot is moved at most.
        fade: s in which a foot that is lifted comes back to where it would have been.
        hold: probabilities of contact from which a foot stands, and below which it no longer does.
    """
    shift = np.zeros((len(place), 3))
    for first, end in runs(free):
        resting = _resting(contact[first:end], *hold)
        stands = [(first + a, first + b) for a, b in runs(resting >= 0)]
        for number, (start, stop) in enumerate(stands):
            shift[start:stop] = _stop_shift(place, resting[start - first : stop - first], start, stop, (first, end))
            before = stands[number - 1][1] if number else first
            after = stands[number + 1][0] if number + 1 < len(stands) else end
            for side, count in ((-1, start - before), (1, after - stop)):
                fading = min(count, round(fade / seconds))
                frames = start - 1 - np.arange(fading) if side < 0 else stop + np.arange(fading)
                gone = (np.arange(fading) + 1) / (fading + 1)
                shift[frames] += (1 - smooth_step(gone))[:, None] * shift[start if side < 0 else stop - 1]
    size = np.linalg.norm(shift, axis=-1, keepdims=True)
    return shift * np.minimum(1, farthest / np.maximum(size, 1e-9))


def _resting(contact: np.ndarray, hold: float, release: float) -> np.ndarray:
    """Return (N,) the resting point of a foot; -1 if no point rests. A resting point keeps resting."""
    result, now = np.full(len(contact), -1), -1
    for frame, chances in enumerate(contact):
        if now >= 0 and chances[now] < release:
            now = -1
        if now < 0 and chances.max() >= hold:
            now = int(chances.argmax())
        result[frame] = now
    return result


def _stop_shift(place: np.ndarray, resting: np.ndarray, start: int, stop: int, span: tuple[int, int]) -> np.ndarray:
    """Shift (N, 3) of frames `start` to `stop`, in which point `resting` (N,) of the foot stays where it is."""
    first, end = span
    is_fixed_before, is_fixed_after = start == first > 0, stop == end < len(place)
    frames = np.arange(start, stop + is_fixed_after)
    point = np.append(resting, resting[-1:])[: len(frames)]
    steps = place[frames, point] - place[np.maximum(frames - 1, 0), point]
    steps[:, 1] = 0
    if not is_fixed_before:
        steps[0] = 0
    slid = np.cumsum(steps, axis=0)
    if is_fixed_before and is_fixed_after:
        back = slid - slid[-1] * (np.arange(len(frames)) + 1)[:, None] / len(frames)
    elif is_fixed_after:
        back = slid - slid[-1]
    else:
        back = slid if is_fixed_before else slid - slid.mean(axis=0)
    return -back[: stop - start]
