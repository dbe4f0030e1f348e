"""Markers as C3D (c3d.org), read and written; a file's announcements are checked against its content.

A missing marker has a negative residual (the format), or coordinates that are NaN or all zero (some programs).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_bytes, sound, written_beside
from bodysense.io.markers.formats.c3d_parameters import (
    BLOCK,
    BYTE_ORDERS,
    DEC,
    Parameters,
    from_dec,
    parameter_blocks,
    read_parameters,
)
from bodysense.io.markers.formats.text import unit_of
from bodysense.io.markers.raw_markers import RawMarkers, Unit
from bodysense.observing.observation import Observation

_KEY = 0x50  # second byte of every C3D file
_LARGEST = 4 << 30  # bytes
_SPARE = 2 * BLOCK  # bytes after the frames; fewer may be padding
_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
_OUTPUTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "REACTIONS")  # points that are not positions


def read_c3d(path: Path, unit: Unit | None = None) -> RawMarkers:
    """Read the points of a C3D file: unit from POINT:UNITS, axes from X_SCREEN and Y_SCREEN, +Z up if missing.

    Outputs of a model (angles, moments …) are skipped. Raises BodysenseError for a file that is not C3D, has no points,
    is cut short, or whose unit is not a length.
    """
    data, parameters, order = _opened(path)
    block = _point_block(path, data, order, parameters)
    position, residual = block.read(data)
    unit = unit_of(path, parameters.text("POINT", "UNITS") or "mm", unit)
    missing = (residual < 0) | ~sound(position).all(axis=-1) | ~position.any(axis=-1)
    position[missing] = np.nan
    names, kept = _places(parameters, block.count)
    time = np.arange(len(position)) / block.rate
    more = (block.there - block.frames) * block.row
    unread: tuple[str, ...] = ()
    if more >= _SPARE:
        announced = f"{block.frames} frames are announced and read, but the file has data of {block.there}"
        unread = (f"{announced}; to read all, export it with POINT:LONG_FRAMES, or as .trc",)
    chosen = tuple(names[k] for k in kept)
    axes = _axes(path, parameters)
    return RawMarkers(chosen, position[:, kept], time, block.rate, unit, axes, warnings=unread)


def filled_c3d(path: Path, position: np.ndarray, filled: np.ndarray) -> bytes:
    """Return the bytes of a C3D file with new positions of some points.

    Args:
        path: a file that `read_c3d` reads.
        position: (T, M, 3) of these points in the file's unit and axes.
        filled: (T, M) bool: points to write, with the residual 0, which marks interpolated points.

    Every other byte is unchanged. Raises BodysenseError for positions that the file's whole numbers cannot hold.
    """
    data, parameters, order = _opened(path)
    block = _point_block(path, data, order, parameters)
    kept = _places(parameters, block.count)[1]
    written, frames = bytearray(data), np.argwhere(filled)
    for t, m in frames.tolist():
        at = block.start + t * block.row + 4 * kept[m] * block.width
        written[at : at + 4 * block.width] = block.packed(path, position[t, m])
    return bytes(written)


@dataclass(frozen=True)
class PointBlock:
    """How the points of a C3D file are stored."""

    start: int  # byte
    row: int  # bytes of a frame
    width: int  # bytes of a number: 4 for reals, 2 for whole numbers
    frames: int
    count: int  # of points
    scale: float  # of whole numbers
    rate: float  # Hz
    order: int  # the processor
    there: int  # frames that the file has room for

    def read(self, data: bytes) -> tuple[np.ndarray, np.ndarray]:
        """Return positions (T, M, 3) in the file's unit, and residuals (T, M)."""
        raw = np.frombuffer(data, dtype="u1", count=self.frames * self.row, offset=self.start)
        raw = np.ascontiguousarray(raw.reshape(self.frames, self.row)[:, : 4 * self.count * self.width])
        mark = BYTE_ORDERS[self.order]
        with np.errstate(invalid="ignore"):  # damaged numbers become NaN
            if self.width == 4:
                values = from_dec(raw) if self.order == DEC else raw.view(f"{mark}f4").astype(np.float64)
            else:
                values = raw.view(f"{mark}i2").astype(np.float64)
        values = values.reshape(self.frames, self.count, 4)
        scale = 1.0 if self.width == 4 else self.scale
        return values[..., :3] * scale, np.nan_to_num(values[..., 3], nan=-1.0)

    def packed(self, path: Path, position: np.ndarray) -> bytes:
        """Return the bytes of a point (3,) with the residual 0."""
        mark = BYTE_ORDERS[self.order]
        if self.width == 4:
            values = np.append(position, 0.0)
            return _to_dec(values) if self.order == DEC else values.astype(f"{mark}f4").tobytes()
        steps = np.append(np.round(position / self.scale), 0)
        if np.abs(steps).max() > 32767:
            raise BodysenseError(f"{path}: a filled marker is beyond its whole numbers; export it with reals")
        return steps.astype(f"{mark}i2").tobytes()


def _opened(path: Path) -> tuple[bytes, Parameters, int]:
    """Return a file's bytes, its parameters and the processor that wrote it."""
    data = read_bytes(path, _LARGEST, "export the trajectories alone")
    if len(data) < BLOCK or data[1] != _KEY:
        raise BodysenseError(f"{path}: not a C3D file; export it again")
    parameters, order = read_parameters(path, data)
    return data, parameters, order


def _places(parameters: Parameters, count: int) -> tuple[list[str], list[int]]:
    """Return the labels of all points, and the indices of those that are positions, not outputs of a model."""
    names = parameters.texts("POINT", "LABELS")
    for k in range(2, 100):  # labels beyond 255 continue in LABELS2, LABELS3 …
        names += parameters.texts("POINT", f"LABELS{k}")
    names = names[:count]
    names += [f"unlabelled {k + 1}" for k in range(len(names), count)]
    outputs = {name for kind in _OUTPUTS for name in parameters.texts("POINT", kind)}
    return names, [k for k, name in enumerate(names) if name not in outputs]


def write_c3d(path: Path, observation: Observation, rate: float) -> None:
    """Write every point of an observation at `rate` Hz, millimetres and +Y up; missing ones have the residual −1.

    Frames are taken at a constant rate: C3D has no times.
    """
    frames, count = len(observation), len(observation.points)
    if count > 255 or frames > 65535:
        raise BodysenseError(
            f"{path}: {count} points in {frames} frames; a C3D file of ours holds 255 points in 65535 frames, "
            "write .csv"
        )
    values = np.zeros((frames, count, 4), dtype="<f4")
    values[..., :3] = np.where(observation.has_position[..., None], observation.position * 1000, np.nan)
    values[..., 3] = np.where(observation.has_position, 0.0, -1.0)
    point: Mapping[str, object] = {
        "USED": count,
        "SCALE": -1.0,
        "RATE": float(rate),
        "DATA_START": 0,
        "FRAMES": frames,
        "UNITS": ["mm"],
        "LABELS": list(observation.points),
        "X_SCREEN": ["+X"],
        "Y_SCREEN": ["+Y"],
    }
    analog: Mapping[str, object] = {"USED": 0, "RATE": float(rate), "GEN_SCALE": 1.0}
    start = 2 + len(parameter_blocks({"POINT": point, "ANALOG": analog})) // BLOCK
    blocks = parameter_blocks({"POINT": {**point, "DATA_START": start}, "ANALOG": analog})
    header = struct.pack("<BBHHHHHfHHf", 2, _KEY, count, 0, 1, frames, 0, -1.0, start, 0, rate)
    body = values.tobytes()
    with written_beside(path) as beside:
        beside.write_bytes(header.ljust(BLOCK, b"\0") + blocks + body + bytes(-len(body) % BLOCK))


def _point_block(path: Path, data: bytes, order: int, parameters: Parameters) -> PointBlock:
    """Return the storage layout of the points. Raises BodysenseError for a file without points, or cut short."""
    mark = BYTE_ORDERS[order]
    count, analog, first, last = struct.unpack(f"{mark}4H", data[2:10])
    block, _ = struct.unpack(f"{mark}2H", data[16:20])
    scale, rate = (_real(data[at : at + 4], order) for at in (12, 20))
    if not 0 < rate < np.inf:
        rate = parameters.number("POINT", "RATE")
    frames = max(last - first + 1, parameters.frames())
    if not count or frames <= 0:
        raise BodysenseError(f"{path}: it holds no points; export the trajectories of the markers")
    if not np.isfinite(scale) or not scale:
        raise BodysenseError(f"{path}: cannot be read as C3D (its scale is {scale:g}); export it again")
    if not 0 < rate < np.inf:
        raise BodysenseError(f"{path}: its frame rate is {rate:g} Hz; export it with the rate of the recording")
    width = 4 if scale < 0 else 2
    row = (4 * count + analog) * width
    start = BLOCK * (max(block, 1) - 1)
    there = max(len(data) - start, 0) // row
    if there < frames:
        raise BodysenseError(f"{path}: {frames} frames are announced, but there are {there}; was the file cut short?")
    return PointBlock(start, row, width, frames, count, scale, rate, order, there)


def _to_dec(values: np.ndarray) -> bytes:
    """Convert numbers (N,) to reals of DEC's processors, the inverse of `from_dec`."""
    words = (values * 4).astype("<f4").view("<u2").reshape(-1, 2)
    return np.ascontiguousarray(words[:, ::-1]).tobytes()


def _real(data: bytes, order: int) -> float:
    if order == DEC:
        return float(from_dec(np.frombuffer(data, dtype="u1")[None])[0, 0])
    return float(struct.unpack(f"{BYTE_ORDERS[order]}f", data)[0])


def _axes(path: Path, parameters: Parameters) -> np.ndarray:
    """Return our axes (3, 3), rows, in the file's: x along the screen, y up it; +Z up if the file does not say."""
    screens = [parameters.text("POINT", name).upper() for name in ("X_SCREEN", "Y_SCREEN")]
    if not all(screens):
        return _Z_UP
    try:
        along, up = ((1.0 if text[0] == "+" else -1.0) * np.eye(3)["XYZ".index(text[1])] for text in screens)
    except (IndexError, ValueError):
        raise BodysenseError(f"{path}: X_SCREEN and Y_SCREEN are {screens}; say the axes with --up") from None
    if along @ up != 0:
        raise BodysenseError(f"{path}: X_SCREEN and Y_SCREEN are {screens}; say the axes with --up")
    return np.stack([along, up, np.cross(along, up)])
