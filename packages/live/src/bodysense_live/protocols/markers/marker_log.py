"""A recording of a marker stream: a CSV file that `bodysense track` reads, written row by row."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.io.markers.raw_markers import AXES, METRES
from bodysense_live.protocols.markers.stream_frame import StreamFrame

UNNAMED = 64  # columns for points without a name; further points are left out
_LONGEST_GAP = 1.0  # s; after a longer step of the server's clock, or one back, a new file begins
_BUFFER = 1 << 16  # bytes


def check_log(path: Path) -> Path:
    """Return the path of a recording. Raises BodysenseError for other kinds of files and for one that exists."""
    if path.suffix.lower() != ".csv":
        raise BodysenseError(f"--record {path}: markers are recorded as .csv; give a name that ends in it")
    if path.exists():
        raise BodysenseError(f"--record {path}: the file exists; choose another name")
    if not path.absolute().parent.is_dir():
        raise BodysenseError(f"--record {path}: no such folder; create it or choose another")
    return path


class MarkerLog:
    """A recording of markers in metres, +Y up. Other markers, or a jump of the clock, begin a further file."""

    def __init__(self, path: Path, unnamed: bool) -> None:
        self._paths, self._unnamed = _numbered(path), unnamed
        self._names: tuple[str, ...] = ()
        self._last = -np.inf  # s
        self._file: IO[str] | None = None
        self._table: Any = None

    def write(self, frame: StreamFrame) -> str | None:
        """Write a frame; return the name of a file that begins with it. Raises OSError if that fails."""
        begun = None
        step = frame.time - self._last
        if frame.names != self._names or abs(step) > _LONGEST_GAP or self._file is None:
            begun = self._begin(frame.names)
        elif step <= 0:
            return None  # out of order
        self._last = frame.time
        place = frame.position
        if self._unnamed:
            extra = np.full((UNNAMED, 3), np.nan)
            extra[: len(frame.unnamed)] = frame.unnamed[:UNNAMED]
            place = np.concatenate([place, extra])
        place = METRES[frame.unit] * place @ AXES[frame.up].T
        row = [f"{value:.5f}" if math.isfinite(value) else "" for value in place.ravel().tolist()]
        self._table.writerow([f"{frame.time:.6f}", *row])
        return begun

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _begin(self, names: tuple[str, ...]) -> str:
        self.close()
        path = next(self._paths)
        self._file = path.open("x", newline="", encoding="utf-8", buffering=_BUFFER)
        self._names, self._table = names, csv.writer(self._file)
        columns = [*names, *(f"point {k + 1}" for k in range(UNNAMED if self._unnamed else 0))]
        self._table.writerow(["time", *(f"{name}.pos.{axis}" for name in columns for axis in "xyz")])
        return str(path)


def _numbered(path: Path) -> Iterator[Path]:
    """Return the path, then 'take-2.csv', 'take-3.csv' …, without files that exist."""
    yield path
    number = 2
    while True:
        following = path.with_name(f"{path.stem}-{number}{path.suffix}")
        if not following.exists():
            yield following
        number += 1
