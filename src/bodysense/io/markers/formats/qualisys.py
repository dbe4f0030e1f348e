"""Markers as TSV of Qualisys Track Manager: a header of named lines, then tab-separated frames.

Trajectories (MARKER_NAMES) have three columns each; rigid bodies (BODY_NAMES) sixteen: place, three angles, residual
and nine of a matrix, of which the place is read. Frame number and time may come first. Of skeletons, a line names
each segment before its X, Y, Z and QX to QW. Millimetres; +Z is usually up, but the format does not declare it.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text, sound
from bodysense.io.markers.formats.text import (
    OTHER_ENCODING,
    Rows,
    markers_of,
    numbered,
    numbers,
    rate_of,
    whole,
)
from bodysense.io.markers.raw_markers import AXES, Cells, RawMarkers

_LAYOUTS = {"MARKER_NAMES": ("NO_OF_MARKERS", 3), "BODY_NAMES": ("NO_OF_BODIES", 16)}
_SEGMENT = ("X", "Y", "Z", "QX", "QY", "QZ", "QW")
_UNIT = 0.01  # largest deviation of a rotation's length from 1
_NAMED = re.compile(r"[A-Z]+(_[A-Z]+)+|FREQUENCY|REFERENCE|SCALE|SOLVER|DESCRIPTION.*|EVENT.*")
Header = dict[str, list[str]]


def read_tsv(path: Path, rate: float | None = None) -> RawMarkers:
    """Read a TSV file of trajectories or rigid bodies. `rate` Hz overrides the header's."""
    lines = numbered(read_text(path, OTHER_ENCODING), "\t")
    header: Header = {}
    at = 0
    while at < len(lines) and _NAMED.fullmatch(lines[at][1][0]):
        header[lines[at][1][0]] = [cell for cell in lines[at][1][1:] if cell]
        at += 1
    if "NO_OF_FRAMES" in header and at < len(lines) and "QW" in lines[at][1]:
        return _segments(path, header, lines[at][1], lines[at + 1 :], rate)
    layout = next((name for name in _LAYOUTS if header.get(name)), None)
    if "NO_OF_FRAMES" not in header or layout is None:
        raise BodysenseError(
            f"{path}: not a TSV file of Qualisys, whose header has NO_OF_FRAMES and MARKER_NAMES, BODY_NAMES or "
            "a skeleton's segments; export it from QTM with its header"
        )
    names = header[layout]
    counted, width = _LAYOUTS[layout]
    count = whole(path, (header.get(counted) or [str(len(names))])[0], counted)
    if count != len(names):
        raise BodysenseError(f"{path}: {counted} is {count}, but {layout} names {len(names)}; export it again")
    rows = lines[at:]
    columns: list[str] = []
    if rows and any(cell[:1].isalpha() and cell.lower() not in ("nan", "null") for cell in rows[0][1]):
        columns, rows = rows[0][1], rows[1:]
    frames = _frames(path, header, len(rows))
    while len(rows) > frames and not any(rows[-1][1]):  # a spreadsheet adds lines
        rows = rows[:-1]
    before = _before(columns, rows, count * width)
    values = numbers(path, rows, before + count * width)
    places = before + np.arange(count * width).reshape(count, width)[:, :3]
    cells = Cells("\t", tuple(number for number, _ in rows), places) if width == 3 else None
    return markers_of(path, names, values, places, _rate(path, header, rate), "mm", AXES["z"], cells)


def _segments(path: Path, header: Header, columns: list[str], rows: Rows, rate: float | None) -> RawMarkers:
    """Return a skeleton's segments: positions and rotations in the world."""
    if (header.get("REFERENCE") or ["GLOBAL"])[0].upper() != "GLOBAL":
        raise BodysenseError(f"{path}: its segments are given in their parents; export the skeleton with global values")
    _frames(path, header, len(rows))
    starts = [k for k in range(len(columns) - 7) if tuple(columns[k + 1 : k + 8]) == _SEGMENT]
    if not starts or not all(columns[k] for k in starts):
        raise BodysenseError(f"{path}: no segment is named before its X, Y, Z and QX to QW; export the skeleton again")
    values = numbers(path, rows, len(columns))
    position, rotation = (np.add.outer(starts, places) for places in ((1, 2, 3), (7, 4, 5, 6)))
    raw = markers_of(path, [columns[k] for k in starts], values, position, _rate(path, header, rate), "mm", AXES["z"])
    rotation = np.where(sound(values[:, rotation]), values[:, rotation], np.nan)
    length = np.linalg.norm(rotation, axis=-1, keepdims=True)
    known = np.isfinite(raw.position).all(axis=-1, keepdims=True) & (np.abs(length - 1) < _UNIT)
    return replace(raw, rotation=np.where(known, rotation / np.where(known, length, 1), np.nan))


def _frames(path: Path, header: Header, rows: int) -> int:
    """Return the number of frames that the header names. Raises BodysenseError if there are fewer rows."""
    frames = whole(path, (header["NO_OF_FRAMES"] or [""])[0], "NO_OF_FRAMES")
    if rows < frames:
        raise BodysenseError(f"{path}: NO_OF_FRAMES is {frames}, but there are {rows}; was the file cut short?")
    return frames


def _rate(path: Path, header: Header, given: float | None) -> float:
    return rate_of(path, (header.get("FREQUENCY") or [""])[0], "FREQUENCY", given)


def _before(columns: list[str], rows: list[tuple[int, list[str]]], width: int) -> int:
    """Return the number of columns (frame and time) before the positions."""
    named = [cell.lower() for cell in columns[:2]]
    if named:
        return sum(name in ("frame", "time") for name in named)
    more = max((len(row) for _, row in rows), default=width) - width
    is_tab = more == 1 and all(row[-1] == "" for _, row in rows)  # at the end of each line
    return 0 if is_tab else max(0, min(2, more))
