"""Markers as TRC, OpenSim's layout: five lines of header, then tab-separated frames with their number and time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.io.markers.formats.text import (
    OTHER_ENCODING,
    Rows,
    cells_in,
    is_number,
    markers_of,
    numbers,
    rate_of,
    unit_of,
    whole,
)
from bodysense.io.markers.raw_markers import Cells, RawMarkers, Unit

_TRC_NEEDED, _TRC_HEADER = ("datarate", "units"), 5  # values; lines of the header


def read_trc(path: Path, rate: float | None = None, unit: Unit | None = None) -> RawMarkers:
    """Read a TRC file. `rate` Hz and `unit` override the header's; the format has no up axis.

    Cells are separated by tabs, semicolons or commas; the header may have another separator than the frames. Raises
    BodysenseError naming the line and the fix.
    """
    texts = [
        line for line in enumerate(read_text(path, OTHER_ENCODING).splitlines(), start=1) if line[1].strip(",; \t\r")
    ]
    delimiter = _separator(texts[-1][1] if texts else "")
    lines = [
        (number, cells_in(line, _separator(line) if k <= _TRC_HEADER else delimiter))
        for k, (number, line) in enumerate(texts, start=1)
    ]
    titles = [[cell.lower() for cell in cells] for _, cells in lines[:4]]
    at = next((k for k, cells in enumerate(titles) if set(_TRC_NEEDED) & set(cells)), None)
    if len(lines) < 5 or (at is None and not titles[0][0].startswith("pathfiletype")):
        raise BodysenseError(f"{path}: not a TRC file, whose first line begins with PathFileType; export it again")
    at = 1 if at is None else at
    header = dict(zip(titles[at], lines[at + 1][1], strict=False))
    lacking = [name for name in _TRC_NEEDED if name not in header]
    if lacking:
        if " ".join(titles[at]).split() != titles[at]:
            raise BodysenseError(
                f"{path}: the cells of line {lines[at][0]} are separated by blanks; export it with tabs, which tell a "
                "missing marker from the next one"
            )
        raise BodysenseError(
            f"{path}: line {lines[at][0]} has no {lacking[0]!r}; a TRC file names DataRate, Units there"
        )
    number, labels = lines[at + 2]
    names, rows = [name for name in labels[2:] if name], lines[at + 3 :]
    while rows and not is_number(rows[0][1][0]):
        rows = rows[1:]  # X1 Y1 Z1 …
    _check_named(path, number, names, rows, header.get("nummarkers", ""))
    frames = whole(path, header.get("numframes") or str(len(rows)), "NumFrames")
    if len(rows) < frames:
        raise BodysenseError(f"{path}: NumFrames is {frames}, but there are {len(rows)}; was the file cut short?")
    values = numbers(path, rows, 2 + 3 * len(names))
    columns = 2 + np.arange(3 * len(names)).reshape(-1, 3)
    hertz = rate_of(path, header["datarate"], "DataRate", rate)
    cells = Cells(delimiter, tuple(number for number, _ in rows), columns)
    raw = markers_of(path, names, values, columns, hertz, unit_of(path, header["units"], unit), cells=cells)
    return replace(raw, remarks=_jumps(values[:, 1], rows, hertz))


def _jumps(time: np.ndarray, rows: Rows, rate: float) -> tuple[str, ...]:
    """Return a remark on frames that a column of times (T,) s lacks, at `rate` Hz."""
    steps = np.diff(time)
    usual = max(float(np.median(steps)), 1 / rate) if len(steps) and np.isfinite(steps).all() else np.inf
    jumps = np.flatnonzero(steps > 2.5 * usual)  # times are rounded, so that one lost frame is not sure
    if not len(jumps):
        return ()
    more = f" and at {len(jumps) - 1} more" if len(jumps) > 1 else ""
    return (
        f"the times jump by {steps[jumps[0]]:.3g} s at line {rows[jumps[0] + 1][0]}{more}, but frames are taken as "
        f"{rate:g} a second: cut the file there",
    )


def _separator(line: str) -> str:
    """Return the separator of a line's cells: a comma may be a decimal one if there is another."""
    return next((sign for sign in "\t;" if sign in line), ",")


def _check_named(path: Path, number: int, names: list[str], rows: Rows, announced: str) -> None:
    """Refuse names that are not those of the columns. If NumMarkers differs, the columns decide."""
    widths = {len(row) - 2 - (3 * len(names) < len(row) - 2 and row[-1] == "") for _, row in rows}
    if announced and whole(path, announced, "NumMarkers") != len(names) and widths != {3 * len(names)}:
        raise BodysenseError(
            f"{path}: NumMarkers is {announced}, but line {number} names {len(names)}, and a frame has "
            f"{max(widths, default=0) / 3:g}; export it again"
        )
    if widths and max(widths) > 3 * len(names):
        raise BodysenseError(
            f"{path}: line {number} names {len(names)} markers, but a frame has {max(widths) / 3:g}; export it again"
        )
