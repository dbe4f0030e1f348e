"""Recordings as lines of JSON: a header, then one line a frame (docs/recording.md)."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.observation import Observation, usual_accuracy

SKELETON = ("joints", "end_sites", "parents", "rest_offset")


def lines_of(version: str, seen: Observation, skeleton: Skeleton | None) -> list[str]:
    """The lines of a recording; without a skeleton where nobody told the wearer's."""
    usual = [_first(values, mask) for values, mask in zip(seen.accuracy.T, seen.has_position.T, strict=True)]
    header: dict[str, Any] = {
        "format": version,
        "points": seen.points,
        "accuracy": {name: value for name, value in zip(seen.points, usual, strict=True) if value is not None},
    }
    if skeleton is not None:
        header["skeleton"] = {
            "joints": skeleton.joints,
            "end_sites": skeleton.end_sites,
            "parents": skeleton.parents,
            "rest_offset": np.round(skeleton.rest_offset, 6).tolist(),
        }
    lines = [json.dumps(header)]
    for t, time in enumerate(seen.time):
        frame: dict[str, Any] = {"time": round(float(time), 6), "position": {}, "rotation": {}}
        for kind, digits in (("position", 5), ("rotation", 6)):
            values, mask = getattr(seen, kind)[t], getattr(seen, f"has_{kind}")[t]
            frame[kind] = {seen.points[p]: np.round(values[p], digits).tolist() for p in np.flatnonzero(mask)}
        accuracy = {p: _rounded(seen.accuracy[t, p]) for p in np.flatnonzero(seen.has_position[t])}
        accuracy = {seen.points[p]: value for p, value in accuracy.items() if value != usual[p]}
        if accuracy:
            frame["accuracy"] = accuracy
        lines.append(json.dumps(frame))
    return lines


def _first(accuracy: np.ndarray, mask: np.ndarray) -> float | None:
    """The accuracy (T,) of a point when it is first tracked; None if it never is."""
    return _rounded(accuracy[int(np.argmax(mask))]) if mask.any() else None


def _rounded(metres: float) -> float:
    return float(f"{metres:.4g}")


def read_lines(path: Path, version: str) -> tuple[Observation, dict[str, Any]]:
    """What a file tracked, its values unchecked, and the fields of the wearer's skeleton. Raises BodysenseError."""
    lines = read_text(path).splitlines()
    rows = [_object(path, number, line) for number, line in enumerate(lines, start=1) if line.strip()]
    if not rows or rows[0].get("format") != version:
        found = rows[0].get("format") if rows else None
        raise BodysenseError(f"{path}: the first line must be a header with format {version!r}, but it has {found!r}")
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
    }
    place = {name: p for p, name in enumerate(points)}
    time = np.zeros(len(frames))
    accuracy = np.tile(usual_accuracy(points), (len(frames), 1))
    for p, value in _accuracies(path, "the header", rows[0], place).items():
        accuracy[:, p] = value
    for t, frame in enumerate(frames):
        if not _numbers([frame.get("time")], 1):
            raise BodysenseError(f"{path}: frame {t} has no 'time'; give seconds")
        time[t] = frame["time"]
        for kind, target in values.items():
            for name, value in _entries(path, t, kind, frame):
                if name not in place:
                    raise BodysenseError(
                        f"{path}: frame {t} has {kind} of {name!r}, which the header's points do not list"
                    )
                if not _numbers(value, target.shape[-1]):
                    raise BodysenseError(
                        f"{path}: frame {t}: {kind} of {name!r} is {str(value)[:60]}; give {target.shape[-1]} numbers"
                    )
                target[t, place[name]] = value
        for p, value in _accuracies(path, f"frame {t}", frame, place).items():
            accuracy[t, p] = value
    observation = Observation(
        points=tuple(points),
        position=values["position"],
        rotation=values["rotation"],
        has_position=np.isfinite(values["position"][..., 0]),  # a point has all its numbers or none
        has_rotation=np.isfinite(values["rotation"][..., 0]),
        accuracy=accuracy,
        time=time,
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


def _accuracies(path: Path, where: str, row: dict[str, Any], place: dict[str, int]) -> dict[int, float]:
    """Accuracies (m) in a header or a frame, by the place of their points."""
    entries = row.get("accuracy", {})
    if not isinstance(entries, dict):
        raise BodysenseError(f"{path}: {where}: accuracy must be an object from point names to metres")
    for name, value in entries.items():
        if name not in place:
            raise BodysenseError(f"{path}: {where} has accuracy of {name!r}, which the header's points do not list")
        if not _numbers([value], 1):
            raise BodysenseError(f"{path}: {where}: accuracy of {name!r} is {str(value)[:60]}; give metres")
    return {place[name]: float(value) for name, value in entries.items()}


def _entries(path: Path, t: int, kind: str, frame: dict[str, Any]) -> list[tuple[str, Any]]:
    entries = frame.get(kind, {})
    if not isinstance(entries, dict):
        raise BodysenseError(f"{path}: frame {t}: {kind} must be an object from point names to numbers")
    return list(entries.items())


def _numbers(value: Any, count: int) -> bool:
    return (
        isinstance(value, list)
        and len(value) == count
        and all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in value)
        and all(abs(number) <= sys.float_info.max for number in value)  # NaN, infinity and endless integers are none
    )
