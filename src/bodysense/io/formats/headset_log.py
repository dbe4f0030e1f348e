"""Logs of headsets and controllers as CSV: a place and a quaternion of each device in every row, as applications write.

Columns are found by their names: `head.pos.x`, `HMD_rotation_w`, `leftHand_qx`, `RightControllerPosY` … Axes are those
of OpenXR and WebXR (right-handed, +Y up, -Z forward) unless the log is left-handed, as Unity's (+Z forward).
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.files import read_text
from bodysense.io.formats.recording import Recording
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation, accuracy_like, usual_accuracy

_HEAD = ("head", "hmd", "headset", "centereye", "centereyeanchor", "camera", "maincamera")
_SIDE = ("left", "right")
_HAND = ("hand", "controller", "handanchor", "controlleranchor", "wrist", "grip", "")
DEVICES = {
    **dict.fromkeys(_HEAD, "headset"),
    **{f"{side}{word}": f"{side}_controller" for side in _SIDE for word in _HAND},
    **{f"{word}{side}": f"{side}_controller" for side in _SIDE for word in _HAND if word},
    **{f"{side[0]}{word}": f"{side}_controller" for side in _SIDE for word in _HAND[:4]},
}
_COLUMN = re.compile(
    r"(?P<name>.*?)[ ._:/-]*(?P<kind>position|pos|p|rotation|rot|quaternion|quat|orientation|q|r)?"
    r"[ ._:/(-]*(?P<axis>[xyzw])\)?",
    re.IGNORECASE,
)
_TURNS = ("rotation", "rot", "quaternion", "quat", "orientation", "q", "r")
_TIME = re.compile(
    r"(?:time|timestamp|t|seconds|ms|milliseconds)(?:[ _]?\(?\[?(?P<unit>s|ms|us|ns)\]?\)?)?", re.IGNORECASE
)
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def is_headset_log(path: str | Path) -> bool:
    """Whether a CSV file's first line names the place and the quaternion of a headset or a controller."""
    path = Path(path)
    if path.suffix.lower() != ".csv":
        return False
    try:
        with path.open("rb") as stream:
            head = stream.read(1 << 16).decode("utf-8-sig", "replace").split("\n", 1)[0]
    except OSError:
        return False
    return bool(_devices(_cells(head)))


def read_headset_log(path: str | Path, rate: float | None = None, left_handed: bool = False) -> Recording:
    """Read a log as a recording of 'headset', 'left_controller' and 'right_controller'; empty values are not tracked.

    `rate` Hz is for a log without times. Raises BodysenseError, naming line and fix, for values that are no numbers.
    """
    path = Path(path)
    lines = [line for line in read_text(path).lstrip("\ufeff").splitlines() if line.strip()]
    header = _cells(lines[0])
    devices = _devices(header)
    rows = list(csv.reader(lines[1:], delimiter=_delimiter(lines[0])))
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            raise BodysenseError(
                f"{path}: line {number} has {len(row)} values, the first line names {len(header)} columns; was the "
                "file cut short?"
            )
    if not rows:
        raise BodysenseError(f"{path}: columns but no frames; every further line is one")
    points = tuple(devices)
    position = np.stack([_values(path, rows, devices[name][0]) for name in points], axis=1)
    rotation = np.stack([_values(path, rows, devices[name][1]) for name in points], axis=1)
    if left_handed:
        position, rotation = position * [1.0, 1.0, -1.0], rotation * [1.0, -1.0, -1.0, 1.0]
    length = np.linalg.norm(rotation, axis=-1, keepdims=True)
    rotation = np.where(length > 0.5, rotation / np.where(length > 0.5, length, 1.0), np.nan)
    has_position, has_rotation = (np.asarray(np.isfinite(part).all(axis=-1)) for part in (position, rotation))
    time = _times(path, header, rows, rate)
    observation = Observation(
        points=points,
        position=np.where(has_position[..., None], position, np.nan),
        rotation=np.where(has_rotation[..., None], rotation, np.nan),
        has_position=has_position,
        has_rotation=has_rotation,
        accuracy=accuracy_like(has_position, usual_accuracy(points)),
        time=time,
    )
    return Recording(check_observation(observation, str(path)), default_skeleton(), known=False)


def _cells(line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=_delimiter(line)), [])]
    except csv.Error:  # a return inside a line, or a cell of over 128 kB
        return []


def _delimiter(line: str) -> str:
    return max(",;\t", key=line.count)


def _devices(header: list[str]) -> dict[str, tuple[list[int], list[int]]]:
    """Return the columns of x, y, z and of w, x, y, z of each device."""
    found: dict[str, dict[str, int]] = {}
    for k, cell in enumerate(header):
        match = _COLUMN.fullmatch(cell)
        if match is None:
            continue
        device = DEVICES.get(re.sub(r"[^a-z]", "", match["name"].lower()))
        if device is not None:
            kind = "r" if (match["kind"] or "").lower() in _TURNS or match["axis"].lower() == "w" else "p"
            found.setdefault(device, {}).setdefault(kind + match["axis"].lower(), k)
    order = ("headset", "left_controller", "right_controller")
    whole = [device for device in order if {"px", "py", "pz", "rx", "ry", "rz", "rw"} <= found.get(device, {}).keys()]
    return {
        device: ([found[device][f"p{axis}"] for axis in "xyz"], [found[device][f"r{axis}"] for axis in "wxyz"])
        for device in whole
    }


def _values(path: Path, rows: list[list[str]], columns: list[int]) -> np.ndarray:
    values = np.full((len(rows), len(columns)), np.nan)
    for number, row in enumerate(rows):
        for k, column in enumerate(columns):
            text = row[column].strip()
            try:
                values[number, k] = float(text) if text else np.nan
            except ValueError:
                raise BodysenseError(f"{path}: line {number + 2}: {text[:40]!r} is no number; mend that line") from None
    return values


def _times(path: Path, header: list[str], rows: list[list[str]], rate: float | None) -> np.ndarray:
    column = next(((k, match) for k, cell in enumerate(header) if (match := _TIME.fullmatch(cell))), None)
    if column is None:
        if rate is None:
            raise BodysenseError(f"{path}: no column of times; give the frames per second with --rate")
        return np.arange(len(rows)) / rate
    time = _values(path, rows, [column[0]])[:, 0]
    named = "ms" if header[column[0]].lower() in ("ms", "milliseconds") else (column[1]["unit"] or "").lower()
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    unit = _SECONDS[named] if named else 1e-9 if step > 1e5 else 1e-6 if step > 1e3 else 1e-3 if step > 1.0 else 1.0
    return (time - time[0]) * unit
