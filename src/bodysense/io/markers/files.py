"""Readers and writers of marker files, chosen by ending and content; readers give `RawMarkers`."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

from bodysense.body.hands.hand import glove_marker
from bodysense.errors import BodysenseError
from bodysense.files import check_plain
from bodysense.io.markers.formats.c3d import read_c3d, write_c3d
from bodysense.io.markers.formats.csv_table import read_csv, write_csv
from bodysense.io.markers.formats.motive import is_motive, read_motive
from bodysense.io.markers.formats.nexus import is_nexus, read_nexus
from bodysense.io.markers.formats.qualisys import read_tsv
from bodysense.io.markers.formats.trc import read_trc
from bodysense.io.markers.options import ENDINGS, is_marker_file
from bodysense.io.markers.raw_markers import MarkerFormat, RawMarkers, Unit, convert_world, points_alone
from bodysense.observing.observation import Observation
from bodysense.observing.points import chosen_points

WRITTEN = (".csv", ".c3d")
FASTEST = 100_000.0  # Hz; the fastest cameras of motion capture take 10,000 frames a second
MOST_COLUMNS = 20_000  # of a table; no system tracks a third of as many markers
_HEADER_LINES = 16  # lines of a table, of which one names its columns


def read_raw(path: str | Path, rate: float | None = None, unit: Unit | None = None) -> RawMarkers:
    """Return the points of a marker file under their own names, in its own unit and axes.

    `rate` (Hz) and `unit` are used in place of those of the file's header. Raises BodysenseError for other files, and
    for more than `MOST_COLUMNS` columns or `FASTEST` frames per second.
    """
    path = Path(path)
    raw = _read_raw(path, rate, unit)
    if not 0 < raw.frame_rate <= FASTEST:
        raise BodysenseError(
            f"{path}: {raw.frame_rate:g} Hz; no camera is faster than {FASTEST:g} Hz: correct the rate, or give --rate"
        )
    return raw


def _read_raw(path: Path, rate: float | None, unit: Unit | None) -> RawMarkers:
    if not is_marker_file(path):
        raise BodysenseError(f"{path}: marker files end in {', '.join(ENDINGS)}, not in {path.suffix or 'nothing'!r}")
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file")
    ending = path.suffix.lower()
    if ending == ".c3d":
        return read_c3d(path, unit)
    _check_columns(path)
    if ending == ".trc":
        return read_trc(path, rate, unit)
    if ending == ".tsv":
        return read_tsv(path, rate)
    head = _head(path)
    if is_motive(head):
        return read_motive(path, rate, unit)
    return read_nexus(path, rate, unit) if is_nexus(head) else read_csv(path, rate)


def _check_columns(path: Path) -> None:
    """Raise BodysenseError for a table with too many columns, before it is read."""
    with path.open("rb") as file:
        for line in islice(file, _HEADER_LINES):
            columns = max(line.count(delimiter) for delimiter in (b",", b";", b"\t")) + 1
            if columns > MOST_COLUMNS:
                raise BodysenseError(
                    f"{path}: {columns} columns; at most {MOST_COLUMNS} are read: export fewer markers"
                )


def read_unlabelled(path: str | Path, form: MarkerFormat = MarkerFormat()) -> tuple[Observation, float]:
    """Return all points of a marker file in our world, ignoring labels, and the rate in Hz."""
    raw = read_raw(path, form.rate, form.unit)
    return points_alone(raw.names, convert_world(raw.position, raw, form), raw.time), raw.frame_rate


def write_markers(path: str | Path, observation: Observation, rate: float) -> None:
    """Write the markers of gloves among the points of an observation, CSV or C3D by the ending; `rate` is for C3D."""
    path = Path(path)
    if path.suffix.lower() not in WRITTEN:
        raise BodysenseError(f"{path}: markers are written as .csv or .c3d, not as {path.suffix or 'nothing'!r}")
    here = [k for k, name in enumerate(observation.points) if glove_marker(name)]
    if not here:
        raise BodysenseError(f"{path}: the observation has no markers of a glove; a recording (.npz) holds any points")
    gloves = chosen_points(observation, here)
    if path.suffix.lower() == ".csv":
        write_csv(path, gloves)
    else:
        write_c3d(path, gloves, rate)


def _head(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None
    check_plain(head, path)
    return head.decode("utf-8-sig", "replace")
