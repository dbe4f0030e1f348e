"""QTM's real-time protocol (Qualisys), version 1.19 and later, by TCP: the client's side.

A packet is its size and type (32 bits each, little-endian on port 22223), then its content. Source: QTM RT Server
Protocol documentation, Qualisys AB. Positions are in millimetres; the upward axis is a parameter of the server.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from xml.etree import ElementTree

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

PORT = 22223  # TCP, little-endian
VERSION = "1.19"
HEAD = PACKET_HEAD  # size with these bytes, type
ERROR, COMMAND, XML, DATA, NO_MORE_DATA, EVENT = 0, 1, 2, 3, 4, 6  # types of packets
POSITIONS, UNNAMED, BODIES = 1, 2, 5  # types of components: 3D, 3DNoLabels, 6D
SETTINGS_CHANGED = 11  # an event
_WELCOME = "QTM RT Interface connected"
_PARAMETERS = "GetParameters 3D 6D"
_STREAM = "StreamFrames AllFrames 3D 3DNoLabels 6D"
_UNNAMED = np.dtype([("position", "<f4", (3,)), ("id", "<i4")])
_BODY = np.dtype([("position", "<f4", (3,)), ("matrix", "<f4", (9,))])


def _packet_size(size: int, _: int) -> int:
    """Return the size of a packet. Raises MarkerServerError for other protocols."""
    if not HEAD.size <= size <= LARGEST:
        raise MarkerServerError(
            f"not QTM's protocol: a packet of {size} bytes; port {PORT} is that of little-endian clients"
        )
    return size


class QtmConversation:
    """A conversation with QTM (`Conversation`)."""

    def __init__(self) -> None:
        self._unread = b""
        self._labels: tuple[str, ...] | None = None  # None: not known, and frames are dropped
        self._bodies: tuple[str, ...] = ()
        self._up: Up = "z"
        self._streams = False
        self._asks = False  # parameters are requested

    def begin(self) -> Sequence[bytes]:
        """Return nothing: the server speaks first."""
        return ()

    def receive(self, data: bytes) -> Received:
        """Take received bytes. Raises MarkerServerError for an old QTM, and for other servers."""
        packets, self._unread = split_packets(self._unread + data, _packet_size)
        frames: list[StreamFrame] = []
        replies: list[bytes] = []
        for whole in packets:
            _, kind = HEAD.unpack_from(whole)
            packet = whole[HEAD.size :]
            if kind == DATA:
                frame = self._frame(PacketReader(packet), replies)
                frames += [] if frame is None else [frame]
            elif kind in _ANSWERS:
                replies += _ANSWERS[kind](self, packet)
        return Received(frames, replies)

    def _error(self, packet: bytes) -> list[bytes]:
        text = _text(packet)
        if "version" in text.lower():
            raise MarkerServerError(f"this QTM does not speak version {VERSION} of its protocol ({text}); update it")
        raise MarkerServerError(f"QTM refuses: {text}")

    def _command(self, packet: bytes) -> list[bytes]:
        text = _text(packet)
        if text == _WELCOME:
            return [command(f"Version {VERSION}")]
        return self._ask() if text.lower().startswith("version set") else []

    def _event(self, packet: bytes) -> list[bytes]:
        return self._ask() if self._streams and packet[:1] == bytes([SETTINGS_CHANGED]) else []

    def _parameters(self, packet: bytes) -> list[bytes]:
        self._labels, self._bodies, self._up = read_parameters(packet)
        self._asks = False
        if self._streams:
            return []
        self._streams = True
        return [command(_STREAM)]

    def _ask(self) -> list[bytes]:
        if self._asks:
            return []
        self._asks = True
        return [command(_PARAMETERS)]

    def _frame(self, packet: PacketReader, replies: list[bytes]) -> StreamFrame | None:
        """Return the frame of a data packet; None while the labels of its markers are not known."""
        timestamp, _, components = packet.values("qII")
        position, unnamed = np.zeros((0, 3)), np.zeros((0, 3))
        bodies = np.zeros(0, _BODY)
        for _ in range(min(components, 32)):
            size, kind = packet.values("II")
            part = packet.block(size - HEAD.size)
            if kind not in (POSITIONS, UNNAMED, BODIES):
                continue
            count = part.count()
            part.skip(4)  # rates of dropped frames and frames out of synchronisation
            if kind == POSITIONS:
                position = part.array("<f4", count, 3)
            elif kind == UNNAMED:
                unnamed = part.records(_UNNAMED, count)["position"].astype(float)
            else:
                bodies = part.records(_BODY, count)
        if self._labels is None or (len(position), len(bodies)) != (len(self._labels), len(self._bodies)):
            replies += self._ask()  # markers were added or removed
            return None
        rotation = None
        if len(bodies):
            rotation = np.full((len(position) + len(bodies), 4), np.nan)
            matrix = bodies["matrix"].reshape(-1, 3, 3).transpose(0, 2, 1).astype(float)  # sent column by column
            rotation[len(position) :] = rotations_of(matrix)
            position = np.concatenate([position, bodies["position"]])
        names = (*self._labels, *self._bodies)
        return StreamFrame(timestamp * 1e-6, names, position, "mm", self._up, rotation, unnamed)


_ANSWERS: dict[int, Callable[[QtmConversation, bytes], list[bytes]]] = {
    ERROR: QtmConversation._error,
    COMMAND: QtmConversation._command,
    XML: QtmConversation._parameters,
    EVENT: QtmConversation._event,
}


def command(text: str) -> bytes:
    """Return the packet of a command."""
    content = text.encode() + b"\0"
    return HEAD.pack(HEAD.size + len(content), COMMAND) + content


def read_parameters(packet: bytes) -> tuple[tuple[str, ...], tuple[str, ...], Up]:
    """Return labels, names of rigid bodies and the upward axis of the parameters "3D 6D".

    Raises MarkerServerError for other content, and for upward axes other than +Y and +Z.
    """
    if b"<!" in packet:  # entities could grow without bound
        raise MarkerServerError("parameters that are not QTM's: a document type")
    try:
        root = ElementTree.fromstring(packet.rstrip(b"\0"))
    except ElementTree.ParseError as error:
        raise MarkerServerError(f"parameters that are not XML ({error})") from None
    axis = (root.findtext("./The_3D/AxisUpwards") or "+Z").strip().upper()
    if axis not in ("+Y", "Y", "+Z", "Z"):
        raise MarkerServerError(f"QTM's upward axis is {axis}; set it to +Y or +Z (Project options, Axis definitions)")
    labels = tuple((one.text or "").strip() for one in root.findall("./The_3D/Label/Name"))
    bodies = tuple((one.text or "").strip() for one in root.findall("./The_6D/Body/Name"))
    return labels, bodies, "y" if axis.endswith("Y") else "z"


def _text(packet: bytes) -> str:
    return packet.partition(b"\0")[0].decode("utf-8", "replace")
