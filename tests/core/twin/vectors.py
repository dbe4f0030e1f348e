"""Vectors (3,) and rotations (3, 3) as matrices a ← b, whose columns are the axes of b in a."""

from math import sqrt

import numpy as np

UP = np.array([0.0, 1.0, 0.0])
HALF_TURN = -0.95  # cosine of a turn whose axis is hardly known


class Tie(Exception):
    """Where a difference in the last bits of the core and of its twin decides what follows."""


def length(v: np.ndarray) -> float:
    """|v|"""
    return sqrt(v @ v)


def unit(v: np.ndarray) -> np.ndarray:
    """v / |v|; zero stays zero."""
    size = length(v)
    return v / size if size > 1e-12 else np.zeros(3)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a × b"""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def across(v: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The part of v across a unit normal."""
    return v - (v @ normal) * normal


def mix(a: np.ndarray, b: np.ndarray, share: float) -> np.ndarray:
    """From a (share 0) to b (share 1)."""
    return (1 - share) * a + share * b


def frame_of(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The rotation with x along `first` and y toward `second` (Gram-Schmidt)."""
    x = unit(first)
    y = unit(across(second, x))
    return np.stack([x, y, cross(x, y)], axis=1)


def skew(k: np.ndarray) -> np.ndarray:
    """The matrix of v → k × v."""
    return np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])


def turned_onto(rotation: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """The turn that takes direction `before` onto `after` by the shortest way, applied to a rotation."""
    u, w = unit(before), unit(after)
    if not u.any() or not w.any():
        return rotation
    if u @ w < HALF_TURN:
        raise Tie(f"a turn by nearly half a turn, of cosine {u @ w:.4f}")
    k = skew(cross(u, w))
    return (np.eye(3) + k + k @ k / (1 + u @ w)) @ rotation
