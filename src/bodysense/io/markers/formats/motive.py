"""Markers, rigid bodies and bones as CSV of OptiTrack Motive, whose first line begins with 'Format Version'.

Below it are lines of kinds, names, identifiers, in newer versions parents, measured quantities, and
'Frame, Time (Seconds), X, Y, Z …'; then one line per frame.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.io.markers.formats.text import (
    OTHER_ENCODING,
    markers_of,
    numbers,
    rate_of,
    unit_of,
)
from bodysense.io.markers.raw_markers import Cells, RawMarkers, Unit

_KINDS = ("bone", "marker", "bone marker", "rigid body", "rigid body marker")
_AXES = ("x", "y", "z", "w")


def is_motive(head: str) -> bool:
    """Whether a text begins as Motive's files do."""
    return head.lstrip("\ufeff").startswith("Format Version")


def read_motive(path: Path, rate: float | None = None, unit: Unit | None = None) -> RawMarkers:
    """Read a CSV file of Motive: markers, and where there are any, bones with their rotations.

    Markers of a rigid body or a bone are skipped if a labelled marker has the same name.
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
    """Return {name: columns} of the position (x, y, z), and the rotation (x, y, z, w) if there is one.

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
