"""Numbers, units and rates that text formats of markers share, and errors in them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import sound
from bodysense.io.markers.raw_markers import METRES, Cells, RawMarkers, Unit

MISSING = {"", "nan", "null", "none", "-", "n/a", "#n/a", "-nan(ind)", "1.#qnan", "1.#ind", "-1.#ind"}
OTHER_ENCODING = "latin-1"  # of files whose labels are not UTF-8; it has a letter for every byte
NEVER = 9_999_999  # in the file's unit: Cortex and Optotrak write it for hidden markers
UNITS: dict[str, Unit] = {
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("cm", "centimeter", "centimeters", "centimetres"), "cm"),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetres"), "mm"),
    **dict.fromkeys(("in", "inch", "inches"), "in"),
    **dict.fromkeys(("ft", "foot", "feet"), "ft"),
}

Rows = Sequence[tuple[int, list[str]]]  # the number of each line, from 1, and its cells


def numbered(text: str, delimiter: str) -> list[tuple[int, list[str]]]:
    """Return the non-blank lines of a text, as cells without surrounding blanks and quotes.

    A line of delimiters is a frame in which all markers are missing.
    """
    lines = enumerate(text.splitlines(), start=1)
    return [(number, cells_in(line, delimiter)) for number, line in lines if line.strip(" \r")]


def cells_in(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line without surrounding blanks and quotes."""
    return [cell.strip().strip('"') for cell in line.split(delimiter)]


def is_number(cell: str) -> bool:
    """Whether a cell is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def numbers(
    path: Path, rows: Rows, width: int, columns: Sequence[int] | None = None, header: Sequence[str] = ()
) -> np.ndarray:
    """Return the first values of each row (T, width), or only those of some columns; NaN where missing.

    Values beyond the end of a row are missing. A comma in a cell is a decimal one. `header` names columns in messages.
    """
    values = np.full((len(rows), width), np.nan)
    for t, (number, cells) in enumerate(rows):
        for k in range(min(width, len(cells))) if columns is None else columns:
            cell = cells[k].strip()
            if cell.lower() not in MISSING:
                try:
                    values[t, k] = float(cell if "," not in cell else cell.replace(",", ".", 1))
                except ValueError:
                    column = repr(header[k]) if header else k + 1
                    raise BodysenseError(
                        f"{path}: line {number}, column {column}: {cell[:20]!r} is not a number; "
                        "leave missing markers empty"
                    ) from None
    return values


def whole(path: Path, text: str, name: str) -> int:
    """Return a number of frames or markers from a header."""
    try:
        count = int(float(text.replace(",", ".")))
    except (ValueError, OverflowError):
        count = -1
    if not 0 <= count < 10**8:
        raise BodysenseError(f"{path}: {name} is {text[:20]!r}; it must be a whole number: export it again")
    return count


def unit_of(path: Path, text: str, given: Unit | None = None) -> Unit:
    """Return a unit named in a header; `given` takes precedence."""
    if given is not None:
        return given
    name = text.strip("()[] ").lower()
    if name not in UNITS:
        raise BodysenseError(
            f"{path}: its unit is {text[:20]!r}; {', '.join(METRES)} are read: give the unit of the numbers with --unit"
        )
    return UNITS[name]


def rate_of(path: Path, text: str, name: str, given: float | None = None) -> float:
    """Return a rate in Hz from a header; `given` takes precedence."""
    try:
        rate = float(text.lower().removesuffix("hz").replace(",", ".")) if given is None else given
    except ValueError:
        rate = 0.0
    if not 0 < rate < float("inf"):
        raise BodysenseError(f"{path}: {name} is {text[:20]!r}; it must be a positive rate in Hz: give it with --rate")
    return rate


def markers_of(
    path: Path,
    names: Sequence[str],
    values: np.ndarray,
    columns: np.ndarray,
    rate: float,
    unit: Unit,
    axes: np.ndarray | None = None,
    cells: Cells | None = None,
) -> RawMarkers:
    """Return markers at a constant rate, whose x, y and z are in some `columns` (M, 3) of values (T, C).

    Places that are zero, not finite or too far are missing.
    """
    if not len(values) or not len(names):
        raise BodysenseError(f"{path}: {len(values)} frames of {len(names)} markers; export the trajectories again")
    position = values[:, columns]
    missing = np.asarray(~sound(position).all(axis=-1) | ~position.any(axis=-1))
    missing |= (np.abs(position) >= NEVER).any(axis=-1)
    position = np.where(missing[..., None], np.nan, position)
    return RawMarkers(tuple(names), position, np.arange(len(position)) / rate, rate, unit, axes, cells=cells)
