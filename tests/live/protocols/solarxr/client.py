"""SolarXR clients, an older runtime and a driver of SlimeVR 22, written from the slots of the public schema.

They share no code with the server.
"""

from __future__ import annotations

import struct
from typing import Any

import flatbuffers
import numpy as np
from flatbuffers.table import Table


class Row:
    """A FlatBuffers table at an offset in a message; its fields are addressed by slot."""

    def __init__(self, data: bytes, place: int) -> None:
        self.data, self.place, self.table = data, place, Table(data, place)

    def at(self, slot: int) -> int | None:
        """Return the offset of a field; None if it is absent."""
        offset = self.table.Offset(4 + 2 * slot)
        return self.place + offset if offset else None

    def value(self, slot: int, form: str, default: Any = 0) -> Any:
        """Return a number."""
        place = self.at(slot)
        return default if place is None else struct.unpack_from("<" + form, self.data, place)[0]

    def floats(self, slot: int, count: int) -> np.ndarray | None:
        """Return a struct of single-precision numbers; None if it is absent."""
        place = self.at(slot)
        return None if place is None else np.array(struct.unpack_from(f"<{count}f", self.data, place))

    def row(self, slot: int) -> Row | None:
        """Return the table of a field; None if it is absent."""
        place = self.at(slot)
        return None if place is None else Row(self.data, place + struct.unpack_from("<I", self.data, place)[0])

    def rows(self, slot: int) -> list[Row]:
        """Return the tables of a vector."""
        vector = self.row(slot)
        if vector is None:
            return []
        count = struct.unpack_from("<I", self.data, vector.place)[0]
        places = [vector.place + 4 + 4 * k for k in range(count)]
        return [Row(self.data, place + struct.unpack_from("<I", self.data, place)[0]) for place in places]

    def text(self, slot: int) -> str:
        """Return a text."""
        vector = self.row(slot)
        assert vector is not None
        size = struct.unpack_from("<I", self.data, vector.place)[0]
        return self.data[vector.place + 4 : vector.place + 4 + size].decode()


def bundle(packet: bytes) -> Row:
    """Return the root table of a message."""
    return Row(packet, struct.unpack_from("<I", packet)[0])


def update(packet: bytes) -> Row:
    """Return the only data feed message of a bundle."""
    (message,) = bundle(packet).rows(0)
    assert message.value(0, "B") == 3 and not bundle(packet).rows(1)
    found = message.row(1)
    assert found is not None
    return found


def request(polls: bool = True, starts: int | None = None, asks: int | None = 0) -> bytes:
    """Return the packets of Monado's driver: a poll or a start of updates, and a request for settings."""
    builder = flatbuffers.Builder(256)
    feeds = []
    builder.StartObject(6)
    if starts is not None:
        builder.PrependUint16Slot(0, starts, 0)
    builder.PrependBoolSlot(3, True, False)
    config = builder.EndObject()
    for kind in [1] * polls + [2] * (starts is not None):
        if kind == 2:
            builder.StartVector(4, 1, 4)
            builder.PrependUOffsetTRelative(config)
            inside = builder.EndVector()
        else:
            inside = config
        builder.StartObject(1)
        builder.PrependUOffsetTRelativeSlot(0, inside, 0)
        message = builder.EndObject()
        builder.StartObject(2)
        builder.PrependUint8Slot(0, kind, 0)
        builder.PrependUOffsetTRelativeSlot(1, message, 0)
        feeds.append(builder.EndObject())
    calls = []
    if asks is not None:
        builder.StartObject(0)
        empty = builder.EndObject()
        builder.StartObject(3)
        if asks:
            builder.Prep(4, 4)
            builder.PrependUint32(asks)
            builder.PrependStructSlot(0, builder.Offset(), 0)
        builder.PrependUint8Slot(1, 6, 0)
        builder.PrependUOffsetTRelativeSlot(2, empty, 0)
        calls.append(builder.EndObject())
    vectors = []
    for rows in (feeds, calls):
        builder.StartVector(4, len(rows), 4)
        for row in reversed(rows):
            builder.PrependUOffsetTRelative(row)
        vectors.append(builder.EndVector())
    builder.StartObject(3)
    for slot, vector in enumerate(vectors):
        builder.PrependUOffsetTRelativeSlot(slot, vector, 0)
    builder.Finish(builder.EndObject())
    return bytes(builder.Output())


# ---- a driver of SlimeVR 22: kinds of messages of the connection and of drivers
HELLO, SERVER_HELLO, CONFIGURED, ERROR, ASK_BONES, BONES = 1, 2, 3, 4, 5, 6
AVAILABLE, REGISTER, REGISTERED, ADD, ADDED, STATUS, _, POSE, SKELETON = range(1, 10)


def connection_message(kind: int, version: int = 0) -> bytes:
    """Return a message of the connection; only a hello has a version."""
    builder = flatbuffers.Builder(64)
    builder.StartObject(1 if kind == HELLO else 0)
    if kind == HELLO:
        builder.PrependUint32Slot(0, version, 0)
    content = builder.EndObject()
    builder.StartObject(2)
    builder.PrependUint8Slot(0, kind, 0)
    builder.PrependUOffsetTRelativeSlot(1, content, 0)
    return _bundled(builder, 0, builder.EndObject())


def register(name: str | None, mask: tuple[int, ...] | None, number: int = 0) -> bytes:
    """Return a driver's registration; `mask`: slots of the parts of bones that it requests."""
    builder = flatbuffers.Builder(128)
    text = None if name is None else builder.CreateString(name)
    parts = None
    if mask is not None:
        builder.StartObject(7)
        for slot in mask:
            builder.PrependBoolSlot(slot, True, False)
        parts = builder.EndObject()
    builder.StartObject(2)
    if text is not None:
        builder.PrependUOffsetTRelativeSlot(0, text, 0)
    if parts is not None:
        builder.PrependUOffsetTRelativeSlot(1, parts, 0)
    return _driver_message(builder, REGISTER, builder.EndObject(), number)


def add_tracker(identity: str, bone: int, number: int) -> bytes:
    """Return a driver's request for a tracker."""
    builder = flatbuffers.Builder(128)
    text = builder.CreateString(identity)
    builder.StartObject(4)
    builder.PrependUOffsetTRelativeSlot(0, text, 0)
    builder.PrependUint16Slot(3, bone, 0)
    return _driver_message(builder, ADD, builder.EndObject(), number)


def tracker_status(tracker: int, status: int) -> bytes:
    """Return the status of a tracker."""
    builder = flatbuffers.Builder(64)
    builder.StartObject(2)
    builder.PrependUint16Slot(0, tracker, 0)
    builder.PrependUint8Slot(1, status, 0)
    return _driver_message(builder, STATUS, builder.EndObject(), 0)


def tracker_pose(tracker: int, place: tuple[float, ...], turn: tuple[float, ...] = (0, 0, 0, 1)) -> bytes:
    """Return the pose of a tracker: m, and a quaternion xyzw."""
    builder = flatbuffers.Builder(128)
    builder.StartObject(5)
    builder.PrependUint16Slot(0, tracker, 0)
    for slot, values in ((1, turn), (2, place)):
        builder.Prep(4, 4 * len(values))
        for value in reversed(values):
            builder.PrependFloat32(value)
        builder.PrependStructSlot(slot, builder.Offset(), 0)
    return _driver_message(builder, POSE, builder.EndObject(), 0)


def connection_answer(packet: bytes) -> tuple[int, Row]:
    """Return kind and content of a bundle's only message of the connection."""
    (message,) = bundle(packet).rows(0)
    content = message.row(1)
    assert content is not None and not bundle(packet).rows(3)
    return message.value(0, "B"), content


def driver_answer(packet: bytes) -> tuple[int, Row, int]:
    """Return kind, content and the answered request's number of a bundle's only message to a driver."""
    (message,) = bundle(packet).rows(3)
    content = message.row(3)
    assert content is not None and not bundle(packet).rows(0)
    return message.value(2, "B"), content, message.value(1, "I")


def _driver_message(builder: flatbuffers.Builder, kind: int, content: int, number: int) -> bytes:
    builder.StartObject(4)
    builder.PrependUint32Slot(0, number, 0)
    builder.PrependUint8Slot(2, kind, 0)
    builder.PrependUOffsetTRelativeSlot(3, content, 0)
    return _bundled(builder, 3, builder.EndObject())


def _bundled(builder: flatbuffers.Builder, slot: int, message: int) -> bytes:
    builder.StartVector(4, 1, 4)
    builder.PrependUOffsetTRelative(message)
    messages = builder.EndVector()
    builder.StartObject(4)
    builder.PrependUOffsetTRelativeSlot(slot, messages, 0)
    builder.Finish(builder.EndObject())
    return bytes(builder.Output())
