"""Recordings: an Observation and its wearer's skeleton in one file, `.npz` or `.jsonl` (docs/recording.md).

A `.jsonl` recording is a header, then one line a frame.
"""

from __future__ import annotations

import json
import operator
import sys
import zipfile
from dataclasses import dataclass
from pathlib import Path
from sys import maxunicode
from typing import TYPE_CHECKING, Any

import numpy as np

from bodysense.arrays import read_arrays
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_text, written_beside
from bodysense.observing.checks import check_observation, check_shapes
from bodysense.observing.observation import RAW_POINTS, Observation, usual_accuracy
from bodysense.observing.points import without_gloves

if TYPE_CHECKING:
    from bodysense.body.hands.glove_set import GloveSet

FORMAT = "bodysense recording 1"
SKELETON = ("joints", "end_sites", "parents", "rest_offset")


def lines_of(seen: Observation, skeleton: Skeleton | None) -> list[str]:
    """Return the lines of a recording; without a skeleton if the wearer's is unknown."""
    columns = zip(seen.points, seen.accuracy.T, seen.has_position.T, strict=True)
    usual = {name: _rounded(values[int(np.argmax(mask))]) for name, values, mask in columns if mask.any()}
    header: dict[str, Any] = {
        "format": FORMAT,
        "points": seen.points,
        "accuracy": usual,  # when a point is first tracked
    }
    if skeleton is not None:
        fields = {name: getattr(skeleton, name) for name in SKELETON}
        header["skeleton"] = fields | {"rest_offset": np.round(skeleton.rest_offset, 6).tolist()}
    lines = [json.dumps(header)]
    for t, time in enumerate(seen.time):
        frame: dict[str, Any] = {"time": round(float(time), 6), "position": {}, "rotation": {}}
        for kind, digits in (("position", 5), ("rotation", 6)):
            values, mask = getattr(seen, kind)[t], getattr(seen, f"has_{kind}")[t]
            frame[kind] = {seen.points[p]: np.round(values[p], digits).tolist() for p in np.flatnonzero(mask)}
        accuracy = {p: _rounded(seen.accuracy[t, p]) for p in np.flatnonzero(seen.has_position[t])}
        accuracy = {seen.points[p]: value for p, value in accuracy.items() if value != usual[seen.points[p]]}
        if accuracy:
            frame["accuracy"] = accuracy
        felt = {} if seen.acceleration is None else dict(zip(seen.points, seen.acceleration[t], strict=True))
        felt = {name: np.round(value, 3).tolist() for name, value in felt.items() if np.isfinite(value).all()}
        if felt:
            frame["acceleration"] = felt
        lines.append(json.dumps(frame))
    return lines


def _rounded(metres: float) -> float:
    return float(f"{metres:.4g}")


def read_lines(path: Path) -> tuple[Observation, dict[str, Any]]:
    """Read an observation, its values unchecked, and the fields of the wearer's skeleton. Raises BodysenseError."""
    lines = read_text(path).splitlines()
    rows = [_object(path, number, line) for number, line in enumerate(lines, start=1) if line.strip()]
    if not rows or rows[0].get("format") != FORMAT:
        found = rows[0].get("format") if rows else None
        raise BodysenseError(f"{path}: the first line must be a header with format {FORMAT!r}, but it has {found!r}")
    points = rows[0].get("points")
    if not isinstance(points, list) or not points or not all(isinstance(name, str) for name in points):
        raise BodysenseError(f"{path}: the header needs 'points', a list of names")
    frames = rows[1:]
    if not frames:
        raise BodysenseError(f"{path}: a header but no frames; each further line is one frame with its 'time'")
    count = len(points)
    values = {
        "position": np.full((len(frames), count, 3), np.nan),
        "rotation": np.full((len(frames), count, 4), np.nan),
        "acceleration": np.full((len(frames), count, 3), np.nan),
        "accuracy": np.tile(usual_accuracy(points)[:, None], (len(frames), 1, 1)),
    }
    place, known = {name: p for p, name in enumerate(points)}, {"time", *values}
    time = np.zeros(len(frames))
    for p, value in _entries(path, "the header", "accuracy", rows[0], place, 1).items():
        values["accuracy"][:, p] = value
    for t, frame in enumerate(frames):
        if not _numbers([frame.get("time")], 1):
            raise BodysenseError(f"{path}: frame {t} has no 'time'; give seconds")
        if unknown := sorted(set(frame) - known):
            valid = ", ".join(sorted(known))
            raise BodysenseError(f"{path}: frame {t} has {unknown[0]!r}, which no frame has; valid are {valid}")
        time[t] = frame["time"]
        for kind, target in values.items():
            for p, value in _entries(path, f"frame {t}", kind, frame, place, target.shape[-1]).items():
                target[t, p] = value
    observation = Observation(
        points=tuple(points),
        position=values["position"],
        rotation=values["rotation"],
        has_position=np.isfinite(values["position"][..., 0]),  # a point's numbers are all there or all missing
        has_rotation=np.isfinite(values["rotation"][..., 0]),
        accuracy=values["accuracy"][..., 0],
        time=time,
        acceleration=values["acceleration"] if any("acceleration" in frame for frame in frames) else None,
    )
    skeleton = rows[0].get("skeleton", {})
    if not isinstance(skeleton, dict):
        raise BodysenseError(f"{path}: the header's 'skeleton' must be an object with {', '.join(SKELETON)}")
    return observation, skeleton


def _object(path: Path, number: int, line: str) -> dict[str, Any]:
    try:
        value = json.loads(line)
    except (ValueError, RecursionError):
        raise BodysenseError(f"{path}: line {number} is not JSON; was the file cut short? Remove the line") from None
    if not isinstance(value, dict):
        raise BodysenseError(f"{path}: line {number} is not a JSON object")
    return value


def _entries(
    path: Path, where: str, kind: str, row: dict[str, Any], place: dict[str, int], count: int
) -> dict[int, list[float]]:
    """Return the numbers of one kind in a header or a frame, `count` each, by the index of their points."""
    entries, unit = row.get(kind, {}), "metres" if kind == "accuracy" else "numbers"
    if not isinstance(entries, dict):
        raise BodysenseError(f"{path}: {where}: {kind} must be an object from point names to {unit}")
    found = {}
    for name, value in entries.items():
        if name not in place:
            raise BodysenseError(f"{path}: {where} has {kind} of {name!r}, which the header's points do not list")
        found[place[name]] = [value] if kind == "accuracy" else value
        if not _numbers(found[place[name]], count):
            wanted = unit if kind == "accuracy" else f"{count} {unit}"
            raise BodysenseError(f"{path}: {where}: {kind} of {name!r} is {str(value)[:60]}; give {wanted}")
    return found


def _numbers(value: Any, count: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in value)
        and all(abs(number) <= sys.float_info.max for number in value)  # refuse NaN, infinity and integers without end
    )


@dataclass(frozen=True)
class Recording:
    """A tracked motion and its wearer."""

    observation: Observation
    skeleton: Skeleton
    known: bool = True  # False: the wearer's proportions are unknown, and the skeleton is the default one
    glove_set: GloveSet | None = None  # the marker set of its gloves; None: a packaged one, found by the points' names
    measures_hands: bool = False  # True: the size of the hands is known only from their gloves


def write_recording(path: str | Path, recording: Recording) -> None:
    """Write `.npz` (compact) or `.jsonl` (one frame a line); the file appears whole or not at all."""
    path = Path(path)
    _check_ending(path)
    _check(path, recording)
    with written_beside(path) as beside:
        if path.suffix == ".npz":
            _write_npz(beside, recording)
        else:
            known_skeleton = recording.skeleton if recording.known else None
            lines = lines_of(recording.observation, known_skeleton)
            beside.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_recording(path: str | Path) -> Recording:
    """Read a recording. Raises BodysenseError naming the file, what is wrong, and the fix."""
    path = Path(path)
    _check_ending(path)
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file")
    if path.suffix == ".npz":
        recording = _read_npz(path)
    else:
        observation, skeleton = read_lines(path)
        recording = Recording(observation, _skeleton(path, skeleton), known=_has_skeleton(skeleton))
    _check(path, recording)
    return recording


def is_recording(path: str | Path) -> bool:
    """Whether a file declares itself a recording (an `.npz` may be a motion instead)."""
    path = Path(path)
    if path.suffix == ".jsonl":
        return True
    try:
        with zipfile.ZipFile(path) as archive:
            return "has_position.npy" in archive.namelist()
    except Exception:  # any error of a damaged file; reading it reports the reason
        return False


def _check_ending(path: Path) -> None:
    if path.suffix not in (".npz", ".jsonl"):
        raise BodysenseError(f"{path}: a recording ends in .npz or .jsonl, not in {path.suffix or 'nothing'!r}")


def _check(path: Path, recording: Recording) -> None:
    """Raise BodysenseError, naming the file, unless the recording is one motion of points of the skeleton."""
    seen = recording.observation
    if not len(seen.time) or not seen.points:
        raise BodysenseError(f"{path}: time and points must be lists of at least one value")
    for name in seen.points:
        if not name or any(ord(letter) < 32 or 0xD7FF < ord(letter) < 0xE000 for letter in name):  # or half a letter
            raise BodysenseError(f"{path}: the name of a point is not text; give names such as left_wrist")
    check_shapes(seen, str(path))
    wanted = (len(seen.time), len(seen.points), 3)
    if seen.position.shape != wanted:
        raise BodysenseError(
            f"{path}: position has shape {seen.position.shape}; a recording is of one motion, {wanted}"
        )
    check_observation(seen, str(path))
    joints = [name for name in without_gloves(seen).points if name not in RAW_POINTS]
    try:
        recording.skeleton.indices(joints)
    except BodysenseError as error:
        raise BodysenseError(f"{path}: {error}") from None


def _write_npz(path: Path, recording: Recording) -> None:
    seen = recording.observation
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
    if seen.acceleration is not None:
        arrays["acceleration"] = seen.acceleration.astype(np.float32)
    if recording.known:
        arrays |= {name: np.array(getattr(recording.skeleton, name)) for name in SKELETON}
    with path.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _read_npz(path: Path) -> Recording:
    wanted = ("format", "points", "position", "rotation", "has_position", "has_rotation", "time")
    arrays = read_arrays(path, (*wanted, "accuracy", "acceleration", *SKELETON))
    missing = [name for name in wanted if name not in arrays]
    if missing:
        raise BodysenseError(f"{path}: not a recording, it has no {missing[0]!r}; see docs/recording.md for the layout")
    if str(arrays["format"]) != FORMAT:
        raise BodysenseError(f"{path}: format {str(arrays['format'])!r}, but this version reads {FORMAT!r}")
    for name in set(arrays) & {*wanted[2:], "accuracy", "acceleration"}:
        if arrays[name].dtype.kind != ("b" if name.startswith("has_") else "f"):
            raise BodysenseError(
                f"{path}: {name} is of type {arrays[name].dtype}; positions, rotations, accuracies, "
                "accelerations and times are floats, masks bool"
            )
    if arrays["time"].ndim != 1 or arrays["points"].ndim != 1:
        raise BodysenseError(f"{path}: time and points must be lists of at least one value")
    if arrays["points"].dtype.kind == "U" and np.ascontiguousarray(arrays["points"]).view(np.uint32).max() > maxunicode:
        raise BodysenseError(f"{path}: the name of a point is not text; give names such as left_wrist")
    points = tuple(str(name) for name in arrays["points"])
    if "accuracy" not in arrays:
        arrays["accuracy"] = np.broadcast_to(usual_accuracy(points), (len(arrays["time"]), len(points)))
    numbers = ("position", "rotation", "accuracy", "time", "acceleration")
    floats = {name: arrays[name].astype(np.float64) for name in numbers if name in arrays}
    observation = Observation(
        points, has_position=arrays["has_position"], has_rotation=arrays["has_rotation"], **floats
    )
    return Recording(observation, _skeleton(path, arrays), known=_has_skeleton(arrays))


def _has_skeleton(fields: dict[str, Any]) -> bool:
    return any(name in fields for name in SKELETON)


def _skeleton(path: Path, fields: dict[str, Any]) -> Skeleton:
    """Return the wearer's skeleton: given in full, or the default one."""
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
