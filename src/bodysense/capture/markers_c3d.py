"""Markers as C3D, by ezc3d. A missing marker has NaN coordinates or a negative residual, as the format says."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.capture.raw_markers import RawMarkers, Unit
from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.observation import Observation

_BLOCK = 512  # bytes, of which a file consists; the first is the header
_KEY = 0x50  # second byte of every C3D file
_BIG_ENDIAN = bytes([86])  # of the processor (MIPS) that wrote it
_UNITS: dict[str, Unit] = {"": "mm", "mm": "mm", "cm": "cm", "m": "m", "millimeters": "mm", "meters": "m"}
_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def read_c3d(path: Path) -> RawMarkers:
    """Read the points of a C3D file: unit by POINT:UNITS, axes by X_SCREEN and Y_SCREEN, +Z up where those are missing.

    Raises BodysenseError for a file that is none, or without points, or whose unit is not a length.
    """
    ezc3d = _library()
    announced = _announced(path)
    try:
        file: Any = ezc3d.c3d(str(path))
        point = file["parameters"]["POINT"]
        position = np.array(file["data"]["points"][:3], dtype=float).transpose(2, 1, 0)
        residual = np.array(file["data"]["meta_points"]["residuals"][0], dtype=float).T
        rate = float(file["header"]["points"]["frame_rate"])
    except Exception as error:  # ezc3d raises what it likes for a damaged file
        reason = " ".join(str(error).split())[:80] or type(error).__name__
        raise BodysenseError(f"{path}: cannot be read as C3D ({reason}); export it again") from None
    names = [str(name).strip() for name in _strings(point, "LABELS")]
    for k in range(2, 100):  # more than 255 labels go on in LABELS2, LABELS3 …
        names += [str(name).strip() for name in _strings(point, f"LABELS{k}")]
    if not position.shape[0] or not position.shape[1]:
        raise BodysenseError(f"{path}: it holds no points; export the trajectories of the markers")
    if len(position) < announced:  # the library reads what is there and says nothing
        raise BodysenseError(
            f"{path}: {announced} frames are announced, but there are {len(position)}; was the file cut short?"
        )
    names = names[: position.shape[1]]
    names += [f"unlabelled {k + 1}" for k in range(len(names), position.shape[1])]
    if not 0 < rate < np.inf:
        raise BodysenseError(f"{path}: its frame rate is {rate:g} Hz; export it with the rate of the recording")
    written = (_strings(point, "UNITS") or [""])[0].strip().lower()
    if written not in _UNITS:
        raise BodysenseError(f"{path}: its unit is {written!r}; m, cm and mm are read")
    missing = (residual < 0) | ~np.isfinite(position).all(axis=-1)
    position[missing] = np.nan
    time = np.arange(len(position)) / rate
    return RawMarkers(tuple(names), position, time, rate, _UNITS[written], _axes(path, point))


def write_c3d(path: Path, observation: Observation, rate: float) -> None:
    """Write every point of an observation at `rate` Hz, millimetres and +Y up; missing ones have the residual −1.

    Frames are taken at a constant rate: C3D has no times.
    """
    ezc3d = _library()
    file: Any = ezc3d.c3d()
    points = np.ones((4, len(observation.points), len(observation)))
    points[:3] = np.where(observation.has_position[..., None], observation.position * 1000, np.nan).transpose(2, 1, 0)
    parameters = file["parameters"]["POINT"]
    parameters["RATE"]["value"] = [float(rate)]
    parameters["UNITS"]["value"] = ["mm"]
    parameters["LABELS"]["value"] = list(observation.points)
    file.add_parameter("POINT", "X_SCREEN", ["+X"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Y"])
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = np.where(observation.has_position, 0.0, -1.0).T[None]
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *points.shape[1:]), dtype=bool)
    with written_beside(path) as beside:
        file.write(str(beside))


def _announced(path: Path) -> int:
    """How many frames the header announces. Raises BodysenseError for a file that is no C3D."""
    try:
        with path.open("rb") as stream:
            header = stream.read(_BLOCK)
            stream.seek(_BLOCK * (max(header[0], 1) - 1) + 3 if header else 0)
            processor = stream.read(1)
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None
    if len(header) < _BLOCK or header[1] != _KEY:
        raise BodysenseError(f"{path}: not a C3D file; export it again")
    first, last = struct.unpack(">HH" if processor == _BIG_ENDIAN else "<HH", header[6:10])
    return last - first + 1


def _library() -> Any:
    try:
        import ezc3d
    except ImportError:
        raise BodysenseError(
            "C3D files need the library ezc3d; install it with `pip install 'bodysense[markers]'`"
        ) from None
    return ezc3d


def _strings(parameters: Any, name: str) -> list[str]:
    return list(parameters[name]["value"]) if name in parameters else []


def _axes(path: Path, point: Any) -> np.ndarray:
    """(3, 3) our axes, rows, in the file's: x along the screen, y up it; +Z up where the file does not say."""
    screens = [(_strings(point, name) or [""])[0].strip().upper() for name in ("X_SCREEN", "Y_SCREEN")]
    if not all(screens):
        return _Z_UP
    try:
        along, up = ((1.0 if text[0] == "+" else -1.0) * np.eye(3)["XYZ".index(text[1])] for text in screens)
    except (IndexError, ValueError):
        raise BodysenseError(f"{path}: X_SCREEN and Y_SCREEN are {screens}; say the axes with --up") from None
    if along @ up != 0:
        raise BodysenseError(f"{path}: X_SCREEN and Y_SCREEN are {screens}; say the axes with --up")
    return np.stack([along, up, np.cross(along, up)])
