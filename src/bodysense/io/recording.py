"""Recordings: an Observation and its wearer's skeleton in one file, `.npz` or `.jsonl` (docs/recording.md)."""

from __future__ import annotations

import operator
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.arrays import read_arrays
from bodysense.body.glove_set import GloveSet
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.io.recording_lines import SKELETON, lines_of, read_lines
from bodysense.observation import Observation, check_observation, check_shapes, usual_accuracy, without_gloves

FORMAT = "bodysense recording 1"


@dataclass(frozen=True)
class Recording:
    """What a device tracked, and on whom."""

    observation: Observation
    skeleton: Skeleton
    told: bool = True  # False: nobody said what the wearer's proportions are, and the skeleton is the default one
    worn: GloveSet | None = None  # the marker set of its gloves; None: a packaged one, by the names of the points
    hands_shown: bool = False  # True: of the hands nothing is known but what their gloves show


def write_recording(path: str | Path, recording: Recording) -> None:
    """Write `.npz` (compact) or `.jsonl` (one frame a line); the file appears whole or not at all."""
    path = Path(path)
    _check_ending(path)
    _check(path, recording)
    with written_beside(path) as beside:
        if path.suffix == ".npz":
            _write_npz(beside, recording)
        else:
            worn_by = recording.skeleton if recording.told else None
            lines = lines_of(FORMAT, recording.observation, worn_by)
            beside.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_recording(path: str | Path) -> Recording:
    """Read a recording. Raises BodysenseError naming the file, what is wrong, and the fix."""
    recording = parse_recording(path)
    _check(Path(path), recording)
    return recording


def parse_recording(path: str | Path) -> Recording:
    """Read a recording whose values nobody checked: they may be NaN, and times in any order. Raises BodysenseError."""
    path = Path(path)
    _check_ending(path)
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file")
    recording = _read_npz(path) if path.suffix == ".npz" else _read_jsonl(path)
    _check_shapes(path, recording.observation)
    return recording


def is_recording(path: str | Path) -> bool:
    """Whether a file says of itself that it is a recording (an `.npz` may be a motion instead)."""
    path = Path(path)
    if path.suffix == ".jsonl":
        return True
    try:
        with zipfile.ZipFile(path) as archive:
            return "has_position.npy" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _check_ending(path: Path) -> None:
    if path.suffix not in (".npz", ".jsonl"):
        raise BodysenseError(f"{path}: a recording ends in .npz or .jsonl, not in {path.suffix or 'nothing'!r}")


def _check(path: Path, recording: Recording) -> None:
    """Raise BodysenseError, naming the file, for what is not one motion of points of the skeleton."""
    seen = recording.observation
    _check_shapes(path, seen)
    check_observation(seen, str(path))
    try:
        recording.skeleton.indices(without_gloves(seen).points)
    except BodysenseError as error:
        raise BodysenseError(f"{path}: {error}") from None


def _check_shapes(path: Path, seen: Observation) -> None:
    """Raise BodysenseError, naming the file, for arrays that are not those of one motion."""
    if not len(seen.time) or not seen.points:
        raise BodysenseError(f"{path}: time and points must be lists of at least one value")
    check_shapes(seen, str(path))
    wanted = (len(seen.time), len(seen.points), 3)
    if seen.position.shape != wanted:
        raise BodysenseError(
            f"{path}: position has shape {seen.position.shape}; a recording is of one motion, {wanted}"
        )


def _write_npz(path: Path, recording: Recording) -> None:
    seen, skeleton = recording.observation, recording.skeleton
    arrays: dict[str, Any] = {
        "format": np.array(FORMAT),
        "points": np.array(seen.points),
        "position": seen.position.astype(np.float32),
        "rotation": seen.rotation.astype(np.float32),
        "has_position": seen.has_position,
        "has_rotation": seen.has_rotation,
        "accuracy": seen.accuracy.astype(np.float32),
        "time": seen.time,
    }
    if recording.told:
        arrays |= {
            "joints": np.array(skeleton.joints),
            "end_sites": np.array(skeleton.end_sites),
            "parents": np.array(skeleton.parents),
            "rest_offset": skeleton.rest_offset,
        }
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _read_npz(path: Path) -> Recording:
    wanted = ("format", "points", "position", "rotation", "has_position", "has_rotation", "time")
    arrays = read_arrays(path, (*wanted, "accuracy", *SKELETON))
    missing = [name for name in wanted if name not in arrays]
    if missing:
        raise BodysenseError(f"{path}: not a recording, it has no {missing[0]!r}; see docs/recording.md for the layout")
    if str(arrays["format"]) != FORMAT:
        raise BodysenseError(f"{path}: format {str(arrays['format'])!r}, but this version reads {FORMAT!r}")
    for name in set(arrays) & {*wanted[2:], "accuracy"}:
        if arrays[name].dtype.kind != ("b" if name.startswith("has_") else "f"):
            raise BodysenseError(
                f"{path}: {name} is of type {arrays[name].dtype}; positions, rotations, accuracies and times are "
                "floats, masks bool"
            )
    if arrays["time"].ndim != 1 or arrays["points"].ndim != 1:
        raise BodysenseError(f"{path}: time and points must be lists of at least one value")
    points = tuple(str(name) for name in arrays["points"])
    if "accuracy" not in arrays:
        arrays["accuracy"] = np.broadcast_to(usual_accuracy(points), (len(arrays["time"]), len(points)))
    observation = Observation(
        points=points,
        position=arrays["position"].astype(np.float64),
        rotation=arrays["rotation"].astype(np.float64),
        has_position=arrays["has_position"],
        has_rotation=arrays["has_rotation"],
        accuracy=arrays["accuracy"].astype(np.float64),
        time=arrays["time"].astype(np.float64),
    )
    return Recording(observation, _skeleton(path, arrays), told=_has_skeleton(arrays))


def _has_skeleton(fields: dict[str, Any]) -> bool:
    return any(name in fields for name in SKELETON)


def _skeleton(path: Path, fields: dict[str, Any]) -> Skeleton:
    """The wearer's skeleton: given in full, or the default one."""
    if not _has_skeleton(fields):
        return default_skeleton()
    missing = [name for name in SKELETON if name not in fields]
    if missing:
        raise BodysenseError(f"{path}: its skeleton has no {missing[0]!r}; give {', '.join(SKELETON)}, or none of them")
    try:
        offset = np.asarray(fields["rest_offset"])
        if offset.dtype.kind not in "fiu":
            raise TypeError("its rest_offset are not numbers")
        return Skeleton(
            joints=tuple(str(name) for name in fields["joints"]),
            end_sites=tuple(str(name) for name in fields["end_sites"]),
            parents=tuple(operator.index(parent) for parent in fields["parents"]),
            rest_offset=offset,
        )
    except (TypeError, ValueError) as error:
        raise BodysenseError(f"{path}: its skeleton cannot be read ({error}); see docs/recording.md") from None
    except BodysenseError as error:
        raise BodysenseError(f"{path}: {error}") from None


def _read_jsonl(path: Path) -> Recording:
    observation, skeleton = read_lines(path, FORMAT)
    return Recording(observation, _skeleton(path, skeleton), told=_has_skeleton(skeleton))
