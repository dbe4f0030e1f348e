"""Text formats of markers: helpers that all share, and CSV.

CSV is in the layout of the paper's release (github.com/dariopavllo/robust-finger-tracking).

The first line names the columns: `time`, then for every marker `NAME.pos.x`, `NAME.pos.y`, `NAME.pos.z` and
`NAME.isValid`. A frame is a line; a missing marker has empty values, NaN, or 0 in `isValid`; without
`isValid` also 0, 0, 0. Also read: `NAME.x`,
`NAME_x`, `NAME:X` …, semicolons or tabs between values, lines that begin with '#', no `isValid`, no `time`.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text, sound, written_beside
from bodysense.io.markers.raw_markers import METRES, Cells, RawMarkers, Unit
from bodysense.observation import Observation

MISSING = {"", "nan", "null", "none", "-", "n/a", "#n/a", "-nan(ind)", "1.#qnan", "1.#ind", "-1.#ind"}
OTHER_ENCODING = "latin-1"  # of files whose labels are not UTF-8; it has a letter for every byte
NEVER = 9_999_999  # in the file's unit: Cortex and Optotrak write this place of a marker that they do not see
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
        raise BodysenseError(f"{path}: {name} is {text[:20]!r}; it must be a positive rate in Hz: say it with --rate")
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


_COORDINATE = re.compile(r"(?P<name>.*\S)(?:[ ._:/(-]+pos(?:ition)?)?[ ._:/(-]+(?P<axis>[xyz])\)?", re.IGNORECASE)
_POSITION = re.compile(r"[ ._:/(-]+pos(?:ition)?$", re.IGNORECASE)
_VALID = re.compile(r"(?P<name>.*\S)[ ._:/(-]+(?:isvalid|valid|visible|known)\)?", re.IGNORECASE)
_TIME = re.compile(r"(?:time|timestamp|t|seconds)(?: ?\(s\)|_s| ?\[s\])?", re.IGNORECASE)


def read_csv(path: Path, rate: float | None = None) -> RawMarkers:
    """Read markers; `rate` Hz is for a file without times. Raises BodysenseError naming line, column and the fix."""
    text = read_text(path, OTHER_ENCODING)
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise BodysenseError(f"{path}: the file is empty; its first line names the columns")
    delimiter = max(",;\t", key=lines[0][1].count)
    header, *frames = csv.reader((line for _, line in lines), delimiter=delimiter)
    header = [cell.strip() for cell in header]
    if not frames:
        raise BodysenseError(f"{path}: columns but no frames; every further line is one")
    rows = [(number, row) for (number, _), row in zip(lines[1:], frames, strict=True)]
    for number, row in rows:
        if len(row) != len(header):
            raise BodysenseError(
                f"{path}: line {number} has {len(row)} values, the first line names {len(header)} columns; "
                "was the file cut short?"
            )
    names, coordinates, valid, time = _columns(path, header)
    values = numbers(path, rows, len(header), [*coordinates.ravel(), *valid.values()], header)
    position = values[:, coordinates]  # (T, M, 3)
    unflagged = [k for k in range(len(names)) if k not in valid]
    position[:, unflagged] = np.where(
        position[:, unflagged].any(axis=-1, keepdims=True), position[:, unflagged], np.nan
    )
    for marker, column in valid.items():
        position[~(values[:, column] > 0), marker] = np.nan
    position[~np.isfinite(position).all(axis=-1)] = np.nan
    if time is not None:
        moments = numbers(path, rows, len(header), [time], header)[:, time]
        if not np.isfinite(moments).all():
            number, _ = rows[int(np.argmin(np.isfinite(moments)))]
            raise BodysenseError(f"{path}: line {number} has no time; give seconds in every line")
    elif rate is None:
        raise BodysenseError(f"{path}: no column of times; say how many frames a second there are with --rate")
    else:
        moments = np.arange(len(rows)) / rate
    steps = np.diff(moments)
    frame_rate = 1 / float(np.median(steps)) if len(steps) and np.median(steps) > 0 else rate or 60.0
    cells = Cells(delimiter, tuple(number for number, _ in rows), coordinates, valid)
    return RawMarkers(tuple(names), position, moments, frame_rate, cells=cells)


def write_csv(path: Path, observation: Observation) -> None:
    """Write every point of an observation, metres and +Y up, in the layout of the release."""
    columns = [f"{name}.{part}" for name in observation.points for part in ("pos.x", "pos.y", "pos.z", "isValid")]
    with written_beside(path) as beside, beside.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(["time", *columns])
        for place, seen, moment in zip(observation.position, observation.has_position, observation.time, strict=True):
            row = [f"{moment:.6f}"]
            for point, known in zip(place, seen, strict=True):
                row += [*(f"{value:.6f}" for value in point), "1"] if known else ["", "", "", "0"]
            writer.writerow(row)


def _columns(path: Path, header: list[str]) -> tuple[list[str], np.ndarray, dict[int, int], int | None]:
    """Return markers' names, their columns (M, 3), the columns of their validity, and the column of times."""
    twice = [name for name in header if name and header.count(name) > 1]
    if twice:
        raise BodysenseError(f"{path}: the column {twice[0]!r} stands twice; every marker has one name")
    found: dict[str, dict[str, int]] = {}
    flags: dict[str, int] = {}
    times = [k for k, cell in enumerate(header) if _TIME.fullmatch(cell)]
    for k, cell in enumerate(header):
        if k in times:
            continue
        if match := _VALID.fullmatch(cell):
            flags[match["name"]] = k
        elif match := _COORDINATE.fullmatch(cell):
            axes = found.setdefault(_POSITION.sub("", match["name"]), {})
            if axes.setdefault(match["axis"].lower(), k) != k:
                raise BodysenseError(f"{path}: {cell!r} is given by two columns; every marker has one name")
    if not found:
        raise BodysenseError(
            f"{path}: no marker in the first line; columns are named 'NAME.pos.x', 'NAME.pos.y', 'NAME.pos.z'"
        )
    for name, axes in found.items():
        lacking = [axis for axis in "xyz" if axis not in axes]
        if lacking:
            raise BodysenseError(f"{path}: the marker {name!r} has no column {lacking[0]!r}; give x, y and z")
    names = list(found)
    coordinates = np.array([[found[name][axis] for axis in "xyz"] for name in names])
    valid = {k: flags[name] for k, name in enumerate(names) if name in flags}
    return names, coordinates, valid, times[0] if times else None
