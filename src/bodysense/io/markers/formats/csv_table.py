"""Markers as CSV, in the layout of the paper's release (github.com/dariopavllo/robust-finger-tracking).

The first line names the columns: `time`, then for every marker `NAME.pos.x`, `NAME.pos.y`, `NAME.pos.z` and
`NAME.isValid`. A frame is a line; a missing marker has empty values, NaN, or 0 in `isValid`; without
`isValid` also 0, 0, 0. Also read: `NAME.x`,
`NAME_x`, `NAME:X` …, semicolons or tabs between values, lines that begin with '#', no `isValid`, no `time`.
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text, written_beside
from bodysense.io.markers.formats.text import OTHER_ENCODING, numbers
from bodysense.io.markers.raw_markers import Cells, RawMarkers
from bodysense.observing.observation import Observation

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
        raise BodysenseError(f"{path}: no column of times; give the frames per second with --rate")
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
