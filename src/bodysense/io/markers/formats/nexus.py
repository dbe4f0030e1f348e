"""Markers as CSV of Vicon Nexus: the section 'Trajectories': rate, names, 'Frame, Sub Frame, X, Y, Z …', units."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.io.markers.formats.text import (
    OTHER_ENCODING,
    is_number,
    markers_of,
    numbers,
    rate_of,
    unit_of,
)
from bodysense.io.markers.raw_markers import AXES, Cells, RawMarkers, Unit

_SECTIONS = ("trajectories", "devices", "joints", "model outputs", "segments", "gaze vector", "events")


def is_nexus(head: str) -> bool:
    """Whether a text has a section of Nexus's or Workstation's, whose title lines may precede it."""
    return any(line.strip(' ,;\t\r"').lower() in _SECTIONS for line in head.lstrip("\ufeff").split("\n"))


def read_nexus(path: Path, rate: float | None = None, unit: Unit | None = None) -> RawMarkers:
    """Read the trajectories of a CSV file of Nexus; other sections are left out. `rate` Hz overrides the file's."""
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
    has_units = not is_number(section[3][1][0])  # Workstation writes none
    units, frames = section[3][1] if has_units else [], section[4:] if has_units else section[3:]
    unit = unit_of(path, units[places[0]] if places[0] < len(units) else "mm", unit)
    values = numbers(path, frames, places[-1] + 3)
    columns = np.array([[k, k + 1, k + 2] for k in places])
    cells = Cells(delimiter, tuple(number for number, _ in frames), columns)
    hertz = rate_of(path, section[0][1][0], "its rate", rate)
    return markers_of(path, names, values, columns, hertz, unit, AXES["z"], cells)
