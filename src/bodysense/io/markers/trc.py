"""Markers as TRC, OpenSim's layout: five lines of header, then tab-separated frames with their number and time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.io.markers.raw_markers import RawMarkers
from bodysense.io.markers.text import markers_of, numbered, numbers, rate_of, unit_of, whole


def read_trc(path: Path, rate: float | None = None) -> RawMarkers:
    """Read a TRC file; its unit and rate are in its header, its up axis is not. `rate` Hz goes before the header's.

    Raises BodysenseError naming the line and the fix.
    """
    lines = numbered(read_text(path), "\t")
    if len(lines) < 5 or not lines[0][1][0].lower().startswith("pathfiletype"):
        raise BodysenseError(f"{path}: not a TRC file, whose first line begins with PathFileType; export it again")
    header = dict(zip((name.lower() for name in lines[1][1]), lines[2][1], strict=False))
    lacking = [name for name in ("datarate", "numframes", "nummarkers", "units") if name not in header]
    if lacking:
        raise BodysenseError(f"{path}: line 2 has no {lacking[0]!r}; a TRC file names DataRate, NumFrames, Units there")
    names = [name for name in lines[3][1][2:] if name]
    count = whole(path, header["nummarkers"], "NumMarkers")
    if len(names) != count:
        raise BodysenseError(f"{path}: NumMarkers is {count}, but line 4 names {len(names)}; export it again")
    rows = lines[4:]
    if rows and not _is_number(rows[0][1][0]):
        rows = rows[1:]  # X1 Y1 Z1 …
    frames = whole(path, header["numframes"], "NumFrames")
    if len(rows) < frames:
        raise BodysenseError(f"{path}: NumFrames is {frames}, but there are {len(rows)}; was the file cut short?")
    values = numbers(path, rows, 2 + 3 * count)
    position = values[:, 2:].reshape(len(rows), count, 3)
    hertz = rate_of(path, header["datarate"], "DataRate", rate)
    return markers_of(path, names, np.asarray(position), hertz, unit_of(path, header["units"]))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
