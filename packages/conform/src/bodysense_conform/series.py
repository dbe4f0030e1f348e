"""Series: values over the frames of a subject, and the reason why a subject has too few of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias, TypeVar

import numpy as np

from bodysense.geometry.rotation import angle_between

T = TypeVar("T")
# (T,) a value for each frame, NaN if it has none; (T, P) of each point; a number of the whole subject; or columns of
# these, by joint, bone or side.
Series: TypeAlias = np.ndarray | float | Mapping[str, np.ndarray | float]


class NotEnough(Exception):
    """A subject lacks what a quantity needs; the message is the reason for the reader."""


class Absent(NotEnough):
    """A subject lacks a point, a rotation or a fact; the column of the table that needs it is left out."""


def need(found: T | None, reason: str) -> T:
    """Return what a quantity needs, or raise NotEnough with the reason if it is None, False or empty.

    An array is accepted whatever it contains.
    """
    if found is None or not (isinstance(found, np.ndarray) or found):
        raise NotEnough(reason)
    return found


def later(values: np.ndarray, frames: int) -> np.ndarray:
    """Return the values (T, …) of some frames later, or before if negative; NaN beyond the ends."""
    found = np.full(values.shape, np.nan)
    if frames < 0:
        found[-frames:] = values[:frames]
    else:
        found[: max(len(values) - frames, 0)] = values[frames:]
    return found


def change(values: np.ndarray, frames: int = 1) -> np.ndarray:
    """Return how values (T, …) differ from those of some frames before; NaN in the first frames."""
    return values - later(values, -frames)


def norm(vectors: np.ndarray) -> np.ndarray:
    """Return the lengths (...) of vectors (..., n)."""
    return np.linalg.norm(vectors, axis=-1)


def dot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the scalar products (...) of vectors (..., n)."""
    return (u * v).sum(axis=-1)


def angle(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return degrees (...) between vectors (..., 3)."""
    return np.degrees(angle_between(u, v))
