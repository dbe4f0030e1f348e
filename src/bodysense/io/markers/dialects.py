"""Markers as TRC, OpenSim's layout: five lines of header, then tab-separated frames with their number and time.

Markers, rigid bodies and bones as CSV of OptiTrack Motive, whose first line begins with 'Format Version'.

Under it stand a line of kinds, one of names, of identifiers, in newer versions of parents, of what is measured, and
'Frame, Time (Seconds), X, Y, Z …'; then a line a frame.

Markers as CSV of Vicon Nexus: the section 'Trajectories': rate, names, 'Frame, Sub Frame, X, Y, Z …', units.

Markers as TSV of Qualisys Track Manager: a header of named lines, then tab-separated frames.

Trajectories (MARKER_NAMES) have three columns each; rigid bodies (BODY_NAMES) sixteen: place, three angles, residual
and nine of a matrix, of which the place is read. Frame number and time may stand in front. Of skeletons, a line names
each segment before its X, Y, Z and QX to QW. Millimetres; +Z is usually up, but no line says so.
"""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text, sound
from bodysense.io.markers.raw_markers import AXES, Cells, RawMarkers, Unit
from bodysense.io.markers.text import (
    OTHER_ENCODING,
    Rows,
    cells_in,
    markers_of,
    numbered,
    numbers,
    rate_of,
    unit_of,
    whole,
)

_TRC_NEEDED, _TRC_HEADER = ("datarate", "units"), 5  # values; lines of the header


def read_trc(path: Path, rate: float | None = None, unit: Unit | None = None) -> RawMarkers:
    """Read a TRC file; its unit and rate are in its header, its up axis is not. `rate` Hz and
    `unit` go before the header's.

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
    while rows and not _is_number(rows[0][1][0]):
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
    """Refuse names that are not those of the columns. The columns decide if NumMarkers says otherwise."""
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


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


_KINDS = ("bone", "marker", "bone marker", "rigid body", "rigid body marker")
_AXES = ("x", "y", "z", "w")


def is_motive(head: str) -> bool:
    """Whether a text begins as Motive's files do."""
    return head.lstrip("\ufeff").startswith("Format Version")


def read_motive(path: Path, rate: float | None = None, unit: Unit | None = None) -> RawMarkers:
    """Read a CSV file of Motive: markers, and where there are any, bones with their rotations.

    Markers of a rigid body or of a bone that stand beside labelled markers of the same name are left out.
    """
    text = read_text(path, OTHER_ENCODING)
    try:
        lines = [(k, cells) for k, cells in enumerate(csv.reader(text.splitlines()), start=1) if any(cells)]
    except csv.Error as error:
        raise BodysenseError(f"{path}: not readable as CSV ({error}); export it from Motive again") from None
    first = lines[0][1]
    header = dict(zip(first[0::2], first[1::2], strict=False))
    start = next((k for k, (_, cells) in enumerate(lines) if cells[0].strip().lower() == "frame"), None)
    if start is None or start < 4:
        raise BodysenseError(f"{path}: no line 'Frame, Time (Seconds), X, Y, Z'; export it from Motive with its header")
    kinds = next((row for _, row in lines[1:start] if any(cell.strip().lower() in _KINDS for cell in row)), None)
    names = next((row for _, row in lines[1:start] if "name" in (cell.strip().lower() for cell in row[:2])), None)
    if kinds is None or names is None:
        raise BodysenseError(
            f"{path}: no lines 'Type' and 'Name' over the columns; export it from Motive with its header"
        )
    columns = _columns(kinds, names, lines[start - 1][1], lines[start][1])
    if not columns:
        raise BodysenseError(f"{path}: no column is a position; export markers, rigid bodies or bones from Motive")
    values = numbers(path, lines[start + 1 :], len(lines[start][1]))
    hertz = rate_of(path, header.get("Export Frame Rate") or header.get("Capture Frame Rate", ""), "its rate", rate)
    unit = unit_of(path, header.get("Length Units", "Meters"), unit)
    position = np.array([places["position"] for places in columns.values()])
    labelled = np.where([["is_marker" in places] for places in columns.values()], position, -1)
    cells = Cells(",", tuple(number for number, _ in lines[start + 1 :]), labelled)
    raw = markers_of(path, list(columns), values, position, hertz, unit, np.eye(3), cells)
    if header.get("Rotation Type", "").lower() != "quaternion":
        return raw
    rotation = np.full((*raw.position.shape[:2], 4), np.nan)
    for k, places in enumerate(columns.values()):
        if len(places.get("rotation", ())) == 4:
            rotation[:, k] = values[:, [places["rotation"][axis] for axis in (3, 0, 1, 2)]]
    return replace(raw, rotation=rotation)


def _columns(
    kinds: list[str], names: list[str], measured: list[str], axes: list[str]
) -> dict[str, dict[str, list[int]]]:
    """Columns of the position (x, y, z), and the rotation (x, y, z, w) if there is one, of everything by its name.

    Markers have an entry 'is_marker' as well.
    """
    found: dict[tuple[str, str], dict[str, dict[str, int]]] = {}
    for k, axis in enumerate(axes):
        kind, name, what = (row[k].strip() if k < len(row) else "" for row in (kinds, names, measured))
        if kind.lower() in _KINDS and what.lower() in ("position", "rotation") and axis.strip().lower() in _AXES:
            found.setdefault((name, kind.lower()), {}).setdefault(what.lower(), {})[axis.strip().lower()] = k
    order = {kind: k for k, kind in enumerate(("bone", "marker", "rigid body", "bone marker", "rigid body marker"))}
    columns: dict[str, dict[str, list[int]]] = {}
    for (name, kind), parts in sorted(found.items(), key=lambda item: order[item[0][1]]):
        if all(axis in parts.get("position", {}) for axis in "xyz"):
            axes_of = {"position": "xyz", "rotation": _AXES}
            at = {part: [at[axis] for axis in axes_of[part] if axis in at] for part, at in parts.items()}
            columns.setdefault(name, at | ({"is_marker": []} if "marker" in kind else {}))
    return columns


_SECTIONS = ("trajectories", "devices", "joints", "model outputs", "segments", "gaze vector", "events")


def is_nexus(head: str) -> bool:
    """Whether a text begins with a section of Nexus's."""
    return head.lstrip("\ufeff").split("\n", 1)[0].strip(' ,;\t\r"').lower() in _SECTIONS


def read_nexus(path: Path, rate: float | None = None, unit: Unit | None = None) -> RawMarkers:
    """Read the trajectories of a CSV file of Nexus; other sections are left out. `rate` Hz goes before the file's."""
    text = read_text(path, OTHER_ENCODING)
    delimiter = max(",;\t", key=text[:4096].count)
    try:
        lines = list(enumerate(csv.reader(text.splitlines(), delimiter=delimiter), start=1))
    except csv.Error as error:
        raise BodysenseError(f"{path}: not readable as CSV ({error}); export it from Nexus again") from None
    at = next((k for k, (_, row) in enumerate(lines) if row and row[0].strip().lower() == "trajectories"), None)
    if at is None:
        raise BodysenseError(f"{path}: no section 'Trajectories' in it; export the trajectories from Nexus")
    section = []
    for number, row in lines[at + 1 :]:
        if not any(cell.strip() for cell in row):  # a blank line ends the section
            break
        section.append((number, [cell.strip() for cell in row]))
    if len(section) < 4:
        raise BodysenseError(f"{path}: its section 'Trajectories' has no frames; export it from Nexus again")
    named, axes = section[1][1], [cell.lower() for cell in section[2][1]]
    places = [k for k in range(len(axes) - 2) if axes[k : k + 3] == ["x", "y", "z"]]
    names = [named[k] if k < len(named) and named[k] else f"unlabelled {n + 1}" for n, k in enumerate(places)]
    if not places:
        raise BodysenseError(f"{path}: line {section[2][0]} has no X, Y, Z; export the trajectories from Nexus again")
    has_units = not _is_number(section[3][1][0])  # Workstation writes none
    units, frames = section[3][1] if has_units else [], section[4:] if has_units else section[3:]
    unit = unit_of(path, units[places[0]] if places[0] < len(units) else "mm", unit)
    values = numbers(path, frames, places[-1] + 3)
    columns = np.array([[k, k + 1, k + 2] for k in places])
    cells = Cells(delimiter, tuple(number for number, _ in frames), columns)
    hertz = rate_of(path, section[0][1][0], "its rate", rate)
    return markers_of(path, names, values, columns, hertz, unit, AXES["z"], cells)


_LAYOUTS = {"MARKER_NAMES": ("NO_OF_MARKERS", 3), "BODY_NAMES": ("NO_OF_BODIES", 16)}
_SEGMENT = ("X", "Y", "Z", "QX", "QY", "QZ", "QW")
_UNIT = 0.01  # how far from 1 the length of a rotation may be
_NAMED = re.compile(r"[A-Z]+(_[A-Z]+)+|FREQUENCY|REFERENCE|SCALE|SOLVER|DESCRIPTION.*|EVENT.*")
Header = dict[str, list[str]]


def read_tsv(path: Path, rate: float | None = None) -> RawMarkers:
    """Read a TSV file of trajectories or rigid bodies. `rate` Hz goes before the header's."""
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
    """A skeleton: every segment's place and rotation in the world."""
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
    """How many columns, frame and time, stand in front of the places."""
    named = [cell.lower() for cell in columns[:2]]
    if named:
        return sum(name in ("frame", "time") for name in named)
    more = max((len(row) for _, row in rows), default=width) - width
    is_tab = more == 1 and all(row[-1] == "" for _, row in rows)  # at the end of each line
    return 0 if is_tab else max(0, min(2, more))
