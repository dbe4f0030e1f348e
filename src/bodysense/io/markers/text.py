"""What the text layouts share: numbers in columns, and frames as markers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bodysense.arrays import sound
from bodysense.errors import BodysenseError
from bodysense.io.markers.raw_markers import RawMarkers, Unit

MISSING = {"", "nan", "null", "none", "-", "-nan(ind)", "1.#qnan"}
UNITS: dict[str, Unit] = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetres"), "cm"),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetres"), "mm"),
}

Rows = Sequence[tuple[int, list[str]]]  # the number of each line, from 1, and its cells


def numbered(text: str, delimiter: str) -> list[tuple[int, list[str]]]:
    """The lines of a text that are not blank, their cells without blanks and quotes around them."""
    return [
        (number, [cell.strip().strip('"') for cell in line.split(delimiter)])
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip(f"{delimiter} \t\r")
    ]


def numbers(path: Path, rows: Rows, width: int) -> np.ndarray:
    """(T, width) the first values of each row; NaN for what is missing, also beyond the end of a row."""
    values = np.full((len(rows), width), np.nan)
    for t, (number, cells) in enumerate(rows):
        for k, cell in enumerate(cells[:width]):
            if cell.lower() not in MISSING:
                try:
                    values[t, k] = float(cell)
                except ValueError:
                    raise BodysenseError(
                        f"{path}: line {number}, column {k + 1}: {cell[:20]!r} is not a number; "
                        "leave missing markers empty"
                    ) from None
    return values


def whole(path: Path, text: str, name: str) -> int:
    """A number of frames or markers that a header gives."""
    try:
        count = int(float(text))
    except (ValueError, OverflowError):
        count = -1
    if not 0 <= count < 10**8:
        raise BodysenseError(f"{path}: {name} is {text[:20]!r}; it must be a whole number: export it again")
    return count


def unit_of(path: Path, text: str) -> Unit:
    """A unit that a header names."""
    if text.lower() not in UNITS:
        raise BodysenseError(f"{path}: its unit is {text[:20]!r}; m, cm and mm are read: say it with --unit")
    return UNITS[text.lower()]


def rate_of(path: Path, text: str, name: str, told: float | None = None) -> float:
    """A rate in Hz that a header gives; `told` goes before it."""
    try:
        rate = float(text) if told is None else told
    except ValueError:
        rate = 0.0
    if not 0 < rate < float("inf"):
        raise BodysenseError(f"{path}: {name} is {text[:20]!r}; it must be a positive rate in Hz: say it with --rate")
    return rate


def markers_of(
    path: Path, names: Sequence[str], position: np.ndarray, rate: float, unit: Unit, axes: np.ndarray | None = None
) -> RawMarkers:
    """Markers (T, M, 3) at a constant rate; what is no sound number, or all zero, is missing."""
    if not len(position) or not len(names):
        raise BodysenseError(f"{path}: {len(position)} frames of {len(names)} markers; export the trajectories again")
    missing = np.asarray(~sound(position).all(axis=-1) | ~position.any(axis=-1))
    position = np.where(missing[..., None], np.nan, position)
    return RawMarkers(tuple(names), position, np.arange(len(position)) / rate, rate, unit, axes)
