"""SolarXR client, written from the slots of its public schema. It shares no code with the server."""

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
