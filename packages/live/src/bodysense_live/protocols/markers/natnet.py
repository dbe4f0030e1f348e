"""NatNet (OptiTrack's Motive), bitstream 3.0 to 4.2, by UDP: the client's side.

A packet is its message and the size of its content (16 bits each), then the content. The client connects, asks for the
definitions of tracked objects, and gets a packet for each frame. Source: OptiTrack's NatNet SDK 4.1, direct
depacketization and bitstream syntax. Positions are in metres; +Y is up unless Motive is set otherwise.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bodysense_live.protocols.markers.stream_frame import (
    MarkerServerError,
    PacketReader,
    Received,
    StreamFrame,
    quaternions_of,
)

PORT = 1510  # UDP, of commands
HEAD = struct.Struct("<HH")  # message, size of its content
# Messages.
CONNECT, SERVER_INFO, REQUEST_DEFINITIONS, DEFINITIONS, FRAME, DISCONNECT, KEEP_ALIVE = 0, 1, 4, 5, 7, 9, 10
OLDEST, NEWEST = (3, 0), (4, 2)  # versions of the bitstream
_REQUESTED = (4, 1)
SERVER_NAME = 256  # bytes
_PING = 265  # bytes of a connection request before the version
MARKER_SET, RIGID_BODY, SKELETON, FORCE_PLATE, DEVICE, CAMERA, ASSET = range(7)  # types of descriptions
OCCLUDED, UNLABELED = 1, 16  # flags of a labeled marker
VALID = 1  # flag of a rigid body
MODELS_CHANGED = 2  # flag of a frame
BODY = np.dtype([("id", "<i4"), ("position", "<f4", 3), ("rotation", "<f4", 4), ("error", "<f4"), ("flags", "<u2")])
MARKER = np.dtype([("id", "<u4"), ("position", "<f4", 3), ("size", "<f4"), ("flags", "<u2"), ("residual", "<f4")])


@dataclass(frozen=True)
class Definitions:
    """Objects that a server tracks."""

    sets: tuple[tuple[str, tuple[str, ...]], ...]  # marker sets: name, names of markers
    bodies: tuple[tuple[int, str], ...]  # rigid bodies: identifier, name
    skeletons: tuple[tuple[int, tuple[tuple[int, str], ...]], ...]  # identifier, bones with their names
    models: dict[int, str]  # identifier of a rigid body, a skeleton or another asset → name of its marker set


@dataclass(frozen=True)
class Multicast:
    """The group at which a server sends its frames."""

    group: str
    port: int


class NatnetConversation:
    """A conversation with a NatNet server (`Conversation`). `receive` takes one datagram."""

    def __init__(self) -> None:
        self.version: tuple[int, int] | None = None  # of the bitstream, once the server has answered
        self.multicast: Multicast | None = None
        self._known: Definitions | None = None

    def begin(self) -> Sequence[bytes]:
        """Return the request for a connection; send it again until frames arrive."""
        return [packet(CONNECT, b"Ping".ljust(_PING, b"\0") + bytes((*_REQUESTED, 0, 0, 0)))]

    def keep_alive(self) -> Sequence[bytes]:
        """Return packets to send while frames arrive: without them the server stops. Ask again for lost answers."""
        return [packet(KEEP_ALIVE)] if self._known is not None else self._ask()

    def receive(self, data: bytes) -> Received:
        """Take a datagram. Raises MarkerServerError for other versions of the bitstream."""
        if len(data) < HEAD.size:
            raise MarkerServerError("not NatNet: a packet of less than four bytes")
        message, _ = HEAD.unpack_from(data)
        content = PacketReader(data, HEAD.size)
        if message == SERVER_INFO:
            return Received((), self._meet(content))
        if message == DEFINITIONS and self.version is not None:
            self._known = read_definitions(content, self.version)
        elif message == FRAME and self.version is not None and self._known is not None:
            frame, has_changed = read_frame(content, self.version, self._known)
            if has_changed:
                self._known = None
            return Received(() if frame is None else (frame,), self._ask() if has_changed else ())
        return Received()

    def _meet(self, content: PacketReader) -> Sequence[bytes]:
        content.skip(SERVER_NAME + 4)  # name and version of the application
        major, minor, *_ = content.values("4B")
        if not OLDEST <= (major, minor) <= NEWEST:
            raise MarkerServerError(
                f"this server speaks NatNet {major}.{minor}; versions {OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}."
                f"{NEWEST[1]} (Motive 2.0 and later) are read: "
                + ("update Motive" if (major, minor) < OLDEST else "update bodysense, or choose an older bitstream")
            )
        self.version, self._known = (major, minor), None
        if content.end - content.at >= 15:
            _, port, is_multicast, *group = content.values("QH?4B")
            self.multicast = Multicast(".".join(map(str, group)), port) if is_multicast else None
        return self._ask()

    def _ask(self) -> Sequence[bytes]:
        return [packet(REQUEST_DEFINITIONS)]


def packet(message: int, content: bytes = b"") -> bytes:
    """Return the packet of a message."""
    return HEAD.pack(message, len(content)) + content


def read_definitions(content: PacketReader, version: tuple[int, int]) -> Definitions:
    """Return the descriptions in a packet; force plates, devices and cameras are skipped."""
    sets: list[tuple[str, tuple[str, ...]]] = []
    bodies: list[tuple[int, str]] = []
    skeletons: list[tuple[int, tuple[tuple[int, str], ...]]] = []
    models: dict[int, str] = {}
    for _ in range(content.count()):
        kind = content.value("i")
        part = content.block(content.value("i")) if version >= (4, 1) else content
        if kind == MARKER_SET:
            name = part.terminated()
            sets.append((name, tuple(part.terminated() for _ in range(part.count()))))
        elif kind == RIGID_BODY:
            bodies.append(_body_of(part, version))
            models[bodies[-1][0]] = bodies[-1][1]
        elif kind == SKELETON:
            name, key = part.terminated(), part.value("i")
            bones = tuple(_body_of(part, version) for _ in range(part.count()))
            skeletons.append((key, tuple((bone, f"{name}:{label}") for bone, label in bones)))
            models[key] = name
        elif kind == ASSET:
            name, _, key = part.terminated(), part.value("i"), part.value("i")
            models[key] = name
        elif version < (4, 1):
            _skip_description(part, kind)
    return Definitions(tuple(sets), tuple(bodies), tuple(skeletons), models)


def read_frame(content: PacketReader, version: tuple[int, int], known: Definitions) -> tuple[StreamFrame | None, bool]:
    """Return the frame in a packet (None if it differs from the definitions), and whether these have changed."""
    content.skip(4)  # its number
    sets: list[tuple[str, np.ndarray]] = []
    count, part = _section(content, version)
    for _ in range(count):
        name = part.terminated()
        sets.append((name, part.array("<f4", part.count(), 3)))
    count, part = _section(content, version)
    part.array("<f4", count, 3)  # markers without a label, also in the list of labeled ones
    count, part = _section(content, version)
    bodies = part.records(BODY, count)
    count, part = _section(content, version)
    skeletons = [(part.value("i"), part.records(BODY, part.count())) for _ in range(count)]
    if version >= (4, 1):
        _section(content, version)  # assets
    count, part = _section(content, version)
    markers = part.records(MARKER, count)
    for _ in range(2):  # force plates, devices
        count, part = _section(content, version)
        for _ in range(count if version < (4, 1) else 0):
            part.skip(4)
            for _ in range(part.count()):
                part.skip(4 * part.count())
    _, _, time = content.values("IId")  # time code, its subframe, seconds
    content.skip(24)  # ticks of the camera's exposure, of reception and of sending
    if version >= (4, 1):
        content.skip(8)  # seconds and fractions of the precision time protocol
    has_changed = bool(content.value("H") & MODELS_CHANGED)
    frame = _frame_of(time, known, sets, bodies, skeletons, markers)
    return frame, has_changed or frame is None


def _frame_of(
    time: float,
    known: Definitions,
    sets: list[tuple[str, np.ndarray]],
    bodies: np.ndarray,
    skeletons: list[tuple[int, np.ndarray]],
    markers: np.ndarray,
) -> StreamFrame | None:
    described = [(name, len(labels)) for name, labels in known.sets]
    if [(name, len(place)) for name, place in sets] != described:
        return None
    hidden = _hidden(markers, known)
    names: list[str] = []
    places: list[np.ndarray] = [np.zeros((0, 3))]
    for (name, labels), (_, place) in zip(known.sets, sets, strict=True):
        if name == "all":  # every marker once more
            continue
        names += [f"{name}:{label}" for label in labels]
        place[~place.any(axis=1)] = np.nan  # a marker that was never seen is in the origin
        place[[k for k in hidden.get(name, ()) if k < len(place)]] = np.nan
        places.append(place)
    count = len(names)
    rigid = dict(known.bodies)
    rows = [(rigid[int(one["id"])], one) for one in bodies if int(one["id"]) in rigid]
    for key, parts in skeletons:
        described_bones = next((bones for one, bones in known.skeletons if one == key), ())
        labels = {bone & 0xFFFF: label for bone, label in described_bones}
        # Identifiers of bones have that of their skeleton in the upper half.
        rows += [(labels[int(one["id"]) & 0xFFFF], one) for one in parts if int(one["id"]) & 0xFFFF in labels]
    rotation = None if not rows else np.full((count + len(rows), 4), np.nan)
    if rotation is not None:
        names += [name for name, _ in rows]
        is_valid = np.array([bool(one["flags"] & VALID) for _, one in rows])[:, None]
        places.append(np.where(is_valid, [one["position"] for _, one in rows], np.nan).astype(float))
        turned = quaternions_of(np.array([one["rotation"] for _, one in rows], dtype=float))
        rotation[count:] = np.where(is_valid, turned, np.nan)
    unnamed = markers["position"][(markers["flags"] & UNLABELED) != 0].astype(float)
    return StreamFrame(time, tuple(names), np.concatenate(places), "m", "y", rotation, unnamed)


def _hidden(markers: np.ndarray, known: Definitions) -> dict[str, list[int]]:
    """Return the indices of occluded markers in each marker set; their positions are only estimated."""
    hidden: dict[str, list[int]] = {}
    for key in markers["id"][(markers["flags"] & OCCLUDED) != 0].tolist():
        name = known.models.get(key >> 16)
        if name is not None and key & 0xFFFF:
            hidden.setdefault(name, []).append((key & 0xFFFF) - 1)
    return hidden


def _section(content: PacketReader, version: tuple[int, int]) -> tuple[int, PacketReader]:
    """Return the number of items in a section, and the reader of its content."""
    count = content.count()
    return count, content.block(content.value("i")) if version >= (4, 1) else content


def _body_of(part: PacketReader, version: tuple[int, int]) -> tuple[int, str]:
    """Return identifier and name of a described rigid body or bone."""
    name, key = part.terminated(), part.value("i")
    part.skip(16 if version < (4, 2) else 32)  # parent, offset and rotation from it
    count = part.count()
    part.skip(16 * count)  # positions and labels of markers
    for _ in range(count if version >= (4, 0) else 0):
        part.terminated()
    return key, name


def _skip_description(part: PacketReader, kind: int) -> None:
    """Skip a description without a size. Raises MarkerServerError for an unknown kind."""
    if kind == FORCE_PLATE:
        part.skip(4)
        part.terminated()
        part.skip(4 * (2 + 3 + 144 + 12 + 2))  # size, origin, calibration, corners, types
    elif kind == DEVICE:
        part.skip(4)
        part.terminated()
        part.terminated()
        part.skip(8)
    elif kind == CAMERA:
        part.terminated()
        part.skip(28)
        return
    else:
        raise MarkerServerError(f"a description of the unknown kind {kind}; update bodysense")
    for _ in range(part.count()):
        part.terminated()
