"""Markers as TSV of Qualisys Track Manager: a header of named lines, then tab-separated frames.

Trajectories (MARKER_NAMES) have three columns each; rigid bodies (BODY_NAMES) sixteen: place, three angles, residual
and nine of a matrix, of which the place is read. Frame number and time may stand in front. Millimetres; +Z is usually
up, but no line says so.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from bodysense.capture.raw_markers import RawMarkers
from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.io.markers.text import markers_of, numbered, numbers, rate_of, whole

_LAYOUTS = {"MARKER_NAMES": ("NO_OF_MARKERS", 3), "BODY_NAMES": ("NO_OF_BODIES", 16)}
_NAMED = re.compile(r"[A-Z]+(_[A-Z]+)+|FREQUENCY|DESCRIPTION.*|EVENT.*")
_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def read_tsv(path: Path, rate: float | None = None) -> RawMarkers:
    """Read a TSV file of trajectories or rigid bodies. `rate` Hz goes before the header's."""
    lines = numbered(read_text(path), "\t")
    header: dict[str, list[str]] = {}
    at = 0
    while at < len(lines) and _NAMED.fullmatch(lines[at][1][0]):
        header[lines[at][1][0]] = [cell for cell in lines[at][1][1:] if cell]
        at += 1
    layout = next((name for name in _LAYOUTS if header.get(name)), None)
    if "NO_OF_FRAMES" not in header or layout is None:
        raise BodysenseError(
            f"{path}: not a TSV file of Qualisys, whose header has NO_OF_FRAMES and MARKER_NAMES or BODY_NAMES; "
            "export it from QTM with its header"
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
    frames = whole(path, (header["NO_OF_FRAMES"] or [""])[0], "NO_OF_FRAMES")
    if len(rows) < frames:
        raise BodysenseError(f"{path}: NO_OF_FRAMES is {frames}, but there are {len(rows)}; was the file cut short?")
    before = _before(columns, rows, count * width)
    values = numbers(path, rows, before + count * width)[:, before:]
    position = values.reshape(len(rows), count, width)[..., :3]
    hertz = rate_of(path, (header.get("FREQUENCY") or [""])[0], "FREQUENCY", rate)
    return markers_of(path, names, position, hertz, "mm", _Z_UP)


def _before(columns: list[str], rows: list[tuple[int, list[str]]], width: int) -> int:
    """How many columns, frame and time, stand in front of the places."""
    named = [cell.lower() for cell in columns[:2]]
    if named:
        return sum(name in ("frame", "time") for name in named)
    cells = [len(row) - (1 if row[-1] == "" else 0) for _, row in rows[:1]]
    return max(0, min(2, cells[0] - width)) if cells else 0
