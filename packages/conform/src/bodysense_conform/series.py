"""Series: values of a quantity over the frames of a subject, in named columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


class NotEnough(Exception):
    """A subject lacks what a quantity needs; the message is the reason for the reader."""


@dataclass(frozen=True, eq=False)
class Series:
    """Values (T, K), or (1, K) of the whole subject; NaN if a frame has no value."""

    values: np.ndarray
    names: tuple[str, ...]  # (K,) of the columns: joints, bones, sides


def series(values: ArrayLike, names: Sequence[str] = ("",)) -> Series:
    """Return values (T,) or (T, K), or a number, as a series."""
    values = np.asarray(values, dtype=float)
    return Series(values.reshape(-1 if values.ndim else 1, len(names)), tuple(names))


def stacked(columns: dict[str, np.ndarray], otherwise: str) -> Series:
    """Return columns (T,) by name as a series. Raises NotEnough with the reason `otherwise` if there is no column."""
    if not columns:
        raise NotEnough(otherwise)
    return Series(np.stack(list(columns.values()), axis=-1).astype(float), tuple(columns))
