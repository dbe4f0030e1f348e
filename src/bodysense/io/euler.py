"""Euler angles of a motion, without jumps between frames."""

from __future__ import annotations

import numpy as np

from bodysense.body.rotation import quaternion_to_euler

_TURN = 2 * np.pi


def euler_near(rotation: np.ndarray, order: str, before: np.ndarray) -> np.ndarray:
    """Angles (T, n) of rotations (T, 4), each nearest to the frame before, the first to `before` (n,); radians.

    A rotation has two triples of angles, and each angle has its whole turns; those are chosen that move least. For
    fewer than three axes the angles about the others, which come last, are left out.
    """
    axes = order + "".join(axis for axis in "XYZ" if axis not in order)
    one = np.asarray(quaternion_to_euler(rotation, axes))
    other = np.stack([one[:, 0] + np.pi, np.pi - one[:, 1], one[:, 2] + np.pi], axis=1)
    start = np.zeros(3)
    start[: len(order)] = before
    last = np.concatenate([start[None], one[:-1]])
    changes = _apart(other, last) < _apart(one, last)  # from one triple to the other since the frame before
    is_other = np.cumsum(changes) % 2 == 1
    angles = np.where(is_other[:, None], other, one)
    return np.unwrap(np.concatenate([start[None], angles]), axis=0)[1:, : len(order)]


def _apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """How far angles (T, 3) are from others, whole turns aside."""
    return np.abs((a - b + np.pi) % _TURN - np.pi).sum(axis=1)
