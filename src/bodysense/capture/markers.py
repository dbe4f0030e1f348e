"""Marker files of gloves, `.csv` and `.c3d`, as an Observation of points '<hand>_glove_<marker>' (docs/gloves.md)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.glove import glove_marker
from bodysense.body.hand import FINGERS
from bodysense.body.skeleton import Skeleton
from bodysense.capture.marker_checks import check_gloves
from bodysense.capture.markers_c3d import read_c3d, write_c3d
from bodysense.capture.markers_csv import read_csv, write_csv
from bodysense.capture.raw_markers import MarkerFormat, RawMarkers, Unit, in_our_world, observed_markers, points_alone
from bodysense.errors import BodysenseError
from bodysense.observation import Observation, check_observation, chosen_points

ENDINGS = (".csv", ".c3d")


@dataclass(frozen=True, eq=False)
class MarkerRecording:
    """What the gloves of a file show."""

    observation: Observation  # (T, …) points '<hand>_glove_<marker>', positions only, world
    frame_rate: float  # Hz
    sizes: dict[str, float]  # of every hand that was seen well, as a factor of the default skeleton's
    remarks: tuple[str, ...]  # what is doubtful or was left out, a sentence each


def read_markers(path: str | Path, form: MarkerFormat = MarkerFormat()) -> MarkerRecording:
    """Read a marker file; names, unit and axes become ours, and it is checked that the gloves are hands.

    Raises BodysenseError naming the file, what is wrong, and the fix.
    """
    path = Path(path)
    raw = read_raw(path, form.rate)
    observation, remarks = observed_markers(raw, form, str(path))
    check_observation(observation, str(path), farthest=np.inf)  # a wrong unit has a better message below
    unit: Unit = form.unit or raw.unit
    check = check_gloves(observation, str(path), unit)
    check_observation(observation, str(path))
    return MarkerRecording(observation, raw.frame_rate, check.sizes, (*remarks, *check.remarks))


def read_raw(path: str | Path, rate: float | None = None) -> RawMarkers:
    """The points of a marker file under their own names, in its own unit and axes."""
    path = Path(path)
    _check_ending(path)
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file")
    return read_csv(path, rate) if path.suffix.lower() == ".csv" else read_c3d(path)


def read_unlabelled(path: str | Path, form: MarkerFormat = MarkerFormat()) -> tuple[Observation, float]:
    """All points of a marker file, whatever they are called, in our world, and the rate in Hz: passive markers."""
    raw = read_raw(path, form.rate)
    return points_alone(raw.names, in_our_world(raw.position, raw, form), raw.time), raw.frame_rate


def write_markers(path: str | Path, observation: Observation, rate: float) -> None:
    """Write the markers of gloves among the points of an observation, CSV or C3D by the ending; `rate` is for C3D."""
    path = Path(path)
    _check_ending(path)
    here = [k for k, name in enumerate(observation.points) if glove_marker(name)]
    if not here:
        raise BodysenseError(f"{path}: the observation has no markers of a glove; a recording (.npz) holds any points")
    gloves = chosen_points(observation, here)
    if path.suffix.lower() == ".csv":
        write_csv(path, gloves)
    else:
        write_c3d(path, gloves, rate)


def is_marker_file(path: str | Path) -> bool:
    """Whether a file is one of markers, by its ending."""
    return Path(path).suffix.lower() in ENDINGS


def with_hands_of(skeleton: Skeleton, sizes: dict[str, float]) -> Skeleton:
    """A body whose hands have the size that its gloves showed, the mean of those that were seen.

    `sizes` are factors of the default skeleton's hand.
    """
    if not sizes:
        return skeleton
    size = float(np.mean(list(sizes.values())))
    fingers = [name.partition("_")[2].startswith(FINGERS) for name in skeleton.points]
    return skeleton.with_offsets(np.where(np.array(fingers)[:, None], size, 1.0) * skeleton.rest_offset)


def _check_ending(path: Path) -> None:
    if path.suffix.lower() not in ENDINGS:
        raise BodysenseError(f"{path}: marker files end in .csv or .c3d, not in {path.suffix or 'nothing'!r}")
