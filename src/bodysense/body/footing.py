"""Footing: the height of soles above the floor, and shifts that stop standing feet from sliding."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import as_like
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import Array, array_namespace
from bodysense.geometry.series import fade_out

SOLE_POINTS = tuple(f"{side}_{name}" for side in ("left", "right") for name in ("ankle", "foot", "toe"))
HOLD, RELEASE = 0.6, 0.4  # probabilities of contact: a foot stands from the first on, until it falls below the second
FADE = 0.2  # s in which a lifted foot returns to its own path
FARTHEST = 0.12  # m; largest shift of a foot. If more were needed, the contact is probably wrong


def sole_clearance(position: Array, skeleton: Skeleton) -> Array:
    """Return the height (...) m of the lowest sole above the floor y = 0, from points (..., P, 3) m; negative below it.

    The height of a sole is the lowest of ankle, ball and toe tip, each relative to its height in the rest pose, which
    has the soles on the floor.
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
    """Return shifts (T, 3) m along the floor that stop a standing foot from sliding; 0 in frames that are not `free`.

    A foot that stands next to a frame that is not free stands where it is in that frame. Between two such frames it
    moves evenly.

    Args:
        place: (T, K, 3) m, y up: points of the foot that may rest on the floor.
        contact: (T, K) probability of contact of these points.
        free: (T,) bool: frames in which the foot may be moved.
        seconds: time between frames.
        farthest: largest shift, m.
        fade: s in which a lifted foot returns to its own path.
        hold: probabilities of contact from which a foot stands, and below which it is released.
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
                shift[frames] += fade_out(fading)[:, None] * shift[start if side < 0 else stop - 1]
    size = np.linalg.norm(shift, axis=-1, keepdims=True)
    return shift * np.minimum(1, farthest / np.maximum(size, 1e-9))


def _resting(contact: np.ndarray, hold: float, release: float) -> np.ndarray:
    """Return the index (N,) of the point on which a foot rests, -1 for none; it changes only if released."""
    result, now = np.full(len(contact), -1), -1
    for frame, chances in enumerate(contact):
        if now >= 0 and chances[now] < release:
            now = -1
        if now < 0 and chances.max() >= hold:
            now = int(chances.argmax())
        result[frame] = now
    return result


def _stop_shift(place: np.ndarray, resting: np.ndarray, start: int, stop: int, span: tuple[int, int]) -> np.ndarray:
    """Return shifts (N, 3) of frames `start` to `stop` that keep the points `resting` (N,) of the foot in place."""
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
