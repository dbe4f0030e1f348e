"""Vicon's DataStream by TCP: the client's side.

A packet is a block of objects. A block is its type and length (32 bits each, little-endian), then its content; objects
are blocks, too. The server first lists the objects that it has, the client replies with those that it wants, and asks
for frames. Unchanged objects are not sent again. Source: Vicon's DataStream SDK 1.11 (MIT), `ViconCGStream`. Positions
are in millimetres; +Z is up unless the server says otherwise.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.io.markers.raw_markers import Up
from bodysense_live.protocols.markers.stream_frame import (
    LARGEST,
    PACKET_HEAD,
    MarkerServerError,
    PacketReader,
    Received,
    StreamFrame,
    rotations_of,
    split_packets,
)

PORT = 801  # TCP
HEAD = PACKET_HEAD  # type, length of the content
OBJECTS = 0x1A2B0001  # the type of a packet
# Types of objects.
OBJECT_ENUMS, REQUEST_FRAME, CONTENTS = 100001, 100002, 100004
STREAM_INFO, SUBJECT_INFO, FRAME_INFO, LABELED, UNLABELED, SEGMENTS, APPLICATION_INFO = 1, 2, 5, 6, 7, 9, 37
WANTED = (STREAM_INFO, SUBJECT_INFO, FRAME_INFO, LABELED, UNLABELED, SEGMENTS, APPLICATION_INFO, CONTENTS)
CLOCK = 135e6  # Hz, of a stream's frame period
Y_UP = 1  # orientation of the application's axes
_RECON = [("radius", "<f8"), ("position", "<f8", 3), ("covariance", "<f8", 9), ("trajectory", "<u4")]
UNLABELED_RECON = np.dtype(_RECON)
LABELED_RECON = np.dtype([("subject", "<u4"), ("marker", "<u4"), *_RECON])
SEGMENT = np.dtype([("segment", "<u4"), ("position", "<f8", 3), ("matrix", "<f8", (3, 3))])


@dataclass(frozen=True)
class _Subject:
    """A subject. Identifiers → names."""

    name: str
    segments: dict[int, str]
    markers: dict[int, str]

    @property
    def rows(self) -> list[tuple[bool, int, str]]:
        """Markers and rigid bodies: whether it is a segment, identifier, name.

        A subject's only segment is a rigid body. Segments of a skeleton are used if it has no markers.
        """
        markers = [(False, key, f"{self.name}:{name}") for key, name in self.markers.items()]
        if len(self.segments) == 1:
            return [*markers, *((True, key, self.name) for key in self.segments)]
        segments = [(True, key, f"{self.name}:{name}") for key, name in self.segments.items()]
        return markers or segments


def _packet_size(kind: int, length: int) -> int:
    """Return the size of a packet. Raises MarkerServerError for other protocols."""
    if kind != OBJECTS or length > LARGEST:
        raise MarkerServerError(f"not Vicon's DataStream; port {PORT} is that of Nexus, Tracker and Shogun")
    return HEAD.size + length


class ViconConversation:
    """A conversation with a Vicon DataStream server (`Conversation`)."""

    def __init__(self) -> None:
        self._unread = b""
        self._subjects: dict[int, _Subject] = {}
        self._rows: dict[tuple[bool, int, int], int] = {}  # (is a segment, subject, identifier) → row of a frame
        self._names: tuple[str, ...] = ()
        self._period: float | None = None  # s
        self._up: Up = "z"

    def begin(self) -> Sequence[bytes]:
        """Return nothing: the server speaks first."""
        return ()

    def receive(self, data: bytes) -> Received:
        """Take received bytes. Raises MarkerServerError for other servers."""
        packets, self._unread = split_packets(self._unread + data, _packet_size)
        frames: list[StreamFrame] = []
        replies: list[bytes] = []
        for packet in packets:
            self._read(PacketReader(packet, HEAD.size, len(packet)), frames, replies)
        return Received(frames, replies)

    def _read(self, packet: PacketReader, frames: list[StreamFrame], replies: list[bytes]) -> None:
        number: int | None = None
        labeled, unlabeled = np.zeros(0, LABELED_RECON), np.zeros(0, UNLABELED_RECON)
        segments: list[tuple[int, np.ndarray]] = []
        subjects: dict[int, _Subject] = {}
        while packet.has_more:
            kind, size = packet.values("II")
            part = packet.block(size)
            if kind == OBJECT_ENUMS:
                have = set(part.array("<u4", part.count()).astype(int).tolist())
                replies += [objects(OBJECT_ENUMS, enums([one for one in WANTED if one in have or one == CONTENTS]))]
                replies += [objects(REQUEST_FRAME, b"\1")]
            elif kind == STREAM_INFO:
                period = part.value("q") / CLOCK
                self._period = period if 0 < period < 10 else None
            elif kind == APPLICATION_INFO:
                self._up = "y" if part.value("b") == Y_UP else "z"
            elif kind == SUBJECT_INFO:
                key, subject = _read_subject(part)
                subjects[key] = subject
            elif kind == FRAME_INFO:
                number = part.value("I")
            elif kind == LABELED:
                labeled = part.records(LABELED_RECON, part.count())
            elif kind == UNLABELED:
                unlabeled = part.records(UNLABELED_RECON, part.count())
            elif kind == SEGMENTS:
                segments.append((part.value("I"), part.records(SEGMENT, part.count())))
        if subjects:  # all are sent if one has changed
            self._set_subjects(subjects)
        if number is not None:
            frames.append(self._frame(number, labeled, unlabeled, segments))

    def _set_subjects(self, subjects: dict[int, _Subject]) -> None:
        self._subjects, rows, names = subjects, dict[tuple[bool, int, int], int](), list[str]()
        for key, subject in subjects.items():
            for is_segment, identifier, name in subject.rows:
                rows[is_segment, key, identifier] = len(names)
                names.append(name)
        self._rows, self._names = rows, tuple(names)

    def _frame(
        self,
        number: int,
        labeled: np.ndarray,
        unlabeled: np.ndarray,
        segments: list[tuple[int, np.ndarray]],
    ) -> StreamFrame:
        position = np.full((len(self._names), 3), np.nan)
        has_segments = any(is_segment for is_segment, _, _ in self._rows)
        rotation = np.full((len(self._names), 4), np.nan) if has_segments else None
        for subject, marker, place in zip(
            labeled["subject"].tolist(), labeled["marker"].tolist(), labeled["position"], strict=True
        ):
            row = self._rows.get((False, subject, marker))
            if row is not None:
                position[row] = place
        for subject, parts in segments:
            turned = rotations_of(parts["matrix"].astype(float))
            for key, place, turn in zip(parts["segment"].tolist(), parts["position"], turned, strict=True):
                row = self._rows.get((True, subject, key))
                if row is not None and rotation is not None and np.isfinite(turn).all():
                    position[row], rotation[row] = place, turn
        time = number * (0.01 if self._period is None else self._period)
        unnamed = unlabeled["position"].astype(float)
        return StreamFrame(time, self._names, position, "mm", self._up, rotation, unnamed)


def objects(kind: int, content: bytes) -> bytes:
    """Return a packet with one object."""
    block = HEAD.pack(kind, len(content)) + content
    return HEAD.pack(OBJECTS, len(block)) + block


def enums(kinds: Sequence[int]) -> bytes:
    """Return the content of a list of types."""
    return struct.pack(f"<I{len(kinds)}I", len(kinds), *sorted(kinds))


def _read_subject(part: PacketReader) -> tuple[int, _Subject]:
    key, name = part.value("I"), part.counted()
    segments, markers = dict[int, str](), dict[int, str]()
    for _ in range(part.count()):
        _, segment, *_ = part.values("II6f")  # parent, identifier, bounds
        segments[segment] = part.counted()
    for _ in range(part.count()):
        marker = part.value("I")
        markers[marker] = part.counted()
    return key, _Subject(name, segments, markers)
