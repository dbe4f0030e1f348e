"""A frame of a marker stream, and the interface of conversations with servers of markers."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import matrix_to_quaternion
from bodysense.io.markers.raw_markers import AXES, RawMarkers, Unit, Up

LARGEST = 1 << 24  # bytes of a packet
PACKET_HEAD = struct.Struct("<II")  # of packets by TCP
_ORTHOGONAL = 0.01  # largest deviation of a rotation's columns from orthogonal unit vectors
MOST_ITEMS = 10_000  # markers or bodies in a packet; no system tracks as many


@dataclass(frozen=True, eq=False)
class StreamFrame:
    """One frame: named markers and rigid bodies, and points without a name, in the server's unit and axes."""

    time: float  # s, of the server's clock
    names: tuple[str, ...]  # M
    position: np.ndarray  # (M, 3); NaN where hidden
    unit: Unit
    up: Up
    rotation: np.ndarray | None = None  # (M, 4) wxyz, of rigid bodies and bones; NaN for markers
    unnamed: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))  # (N, 3)


def raw_of(frames: Sequence[StreamFrame]) -> RawMarkers:
    """Join frames with equal names to the content of a marker file."""
    last = frames[-1]
    time = np.array([frame.time for frame in frames])
    rate = 1 / float(np.median(np.diff(time))) if len(frames) > 1 else 100.0
    rotations = [frame.rotation for frame in frames if frame.rotation is not None]
    return RawMarkers(
        last.names,
        np.stack([frame.position for frame in frames]),
        time,
        rate,
        last.unit,
        AXES[last.up],
        np.stack(rotations) if len(rotations) == len(frames) else None,
    )


def rotations_of(matrix: np.ndarray) -> np.ndarray:
    """Convert matrices (N, 3, 3) to rotations (N, 4) wxyz; NaN for those that are no rotation."""
    rotation = np.full((len(matrix), 4), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        square = np.abs(matrix @ matrix.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2))
        known = np.flatnonzero((square < _ORTHOGONAL) & (np.abs(np.linalg.det(matrix) - 1) < _ORTHOGONAL))
    rotation[known] = matrix_to_quaternion(matrix[known])
    return rotation


def quaternions_of(values: np.ndarray) -> np.ndarray:
    """Return quaternions (N, 4) xyzw as rotations (N, 4) wxyz; NaN for those that are no rotation."""
    with np.errstate(over="ignore", invalid="ignore"):
        known = np.abs(np.linalg.norm(values, axis=1) - 1) < _ORTHOGONAL
    return np.where(known[:, None], np.roll(values, 1, axis=1), np.nan)


class Received(NamedTuple):
    """Frames in received bytes, and packets to reply."""

    frames: Sequence[StreamFrame] = ()
    replies: Sequence[bytes] = ()


class MarkerServerError(BodysenseError):
    """A server that speaks another protocol or version, or sends malformed packets."""


class Conversation(Protocol):
    """The client's side of a protocol, without I/O: one for each connection."""

    def begin(self) -> Sequence[bytes]:
        """Return the packets to send first."""
        ...

    def receive(self, data: bytes) -> Received:
        """Take received bytes. Raises MarkerServerError, with the fix."""
        ...


def split_packets(unread: bytes, size_of: Callable[[int, int], int]) -> tuple[list[bytes], bytes]:
    """Return the whole packets at the beginning of bytes, with their heads, and the bytes of an incomplete one.

    A packet begins with two numbers (32 bits each, little-endian), of which `size_of` finds its size in bytes.
    """
    packets: list[bytes] = []
    start = 0
    while len(unread) >= start + PACKET_HEAD.size:
        size = size_of(*PACKET_HEAD.unpack_from(unread, start))
        if len(unread) < start + size:
            break
        packets.append(unread[start : start + size])
        start += size
    return packets, unread[start:]


class PacketReader:
    """A position in a packet of little-endian values. Raises MarkerServerError beyond the packet's end."""

    def __init__(self, data: bytes, at: int = 0, end: int | None = None) -> None:
        self.data, self.at, self.end = data, at, len(data) if end is None else end

    def values(self, form: str) -> tuple[Any, ...]:
        """Return the next values, by their form in `struct` ("i", "fff" …)."""
        size = struct.calcsize("<" + form)
        return struct.unpack_from("<" + form, self.data, self._advance(size))

    def value(self, form: str) -> Any:
        """Return the next value."""
        return self.values(form)[0]

    def count(self) -> int:
        """Return the next value, a 32-bit count of items."""
        count = self.value("i")
        if not 0 <= count <= MOST_ITEMS:
            raise MarkerServerError(f"a packet with {count} items")
        return count

    def array(self, kind: str, *shape: int) -> np.ndarray:
        """Return an array of a kind in NumPy's notation ("<f4" …), as float64."""
        dtype = np.dtype(kind)
        size = int(np.prod(shape)) * dtype.itemsize
        return np.frombuffer(self.data, dtype, int(np.prod(shape)), self._advance(size)).reshape(shape).astype(float)

    def records(self, dtype: np.dtype[Any], count: int) -> np.ndarray:
        """Return the next records (count,)."""
        return np.frombuffer(self.data, dtype, count, self._advance(count * dtype.itemsize))

    def terminated(self) -> str:
        """Return the next text, which ends with a zero byte."""
        end = self.data.find(b"\0", self.at, self.end)
        if end < 0:
            raise MarkerServerError("a packet that ends within a name")
        text = self.data[self.at : end].decode("utf-8", "replace")
        self.at = end + 1
        return text

    def counted(self) -> str:
        """Return the next text, which begins with its 32-bit length."""
        size = self.count()
        at = self._advance(size)
        return self.data[at : at + size].decode("utf-8", "replace")

    def skip(self, size: int) -> None:
        """Skip bytes."""
        self._advance(size)

    def block(self, size: int) -> PacketReader:
        """Return the reader of the next `size` bytes, and skip them."""
        at = self._advance(size)
        return PacketReader(self.data, at, at + size)

    @property
    def has_more(self) -> bool:
        """Whether bytes remain."""
        return self.at < self.end

    def _advance(self, size: int) -> int:
        at, self.at = self.at, self.at + size
        if size < 0 or self.at > self.end:
            raise MarkerServerError("a packet that is shorter than its content")
        return at
