"""The container of binary FBX 7.4: records of a name, properties and records within."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

VERSION = 7400
# The time, identity and end of a file depend on each other; these three are a set that programs accept.
CREATED = "1970-01-01 10:00:00:000"
FILE_ID = bytes.fromhex("28b32aebb624ccc2bfc8b02aa92bfcf1")
_FOOT_ID = bytes.fromhex("fabcab09d0c8d466b176fb831cf7267e")
_FOOT_END = bytes.fromhex("f85a8c6adef5d97eece90ce3758f290b")
_HEAD = b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", VERSION)
_NULL_RECORD = bytes(13)
_ARRAYS = {"i4": b"i", "i8": b"l", "f4": b"f", "f8": b"d"}
_COMPRESSED = 128  # bytes of an array from which it is compressed

Property = bool | int | float | str | bytes | np.ndarray


@dataclass
class Record:
    """A record. Integers are written with 64 bits, `Short` ones with 32; bytes are written raw."""

    name: str
    properties: tuple[Property, ...] = ()
    records: list[Record] = field(default_factory=list)

    def add(self, name: str, *properties: Property, records: Iterable[Record] = ()) -> Record:
        """Add a record within and return it."""
        self.records.append(Record(name, properties, list(records)))
        return self.records[-1]


class Short(int):
    """An integer that is written with 32 bits."""


def contents(records: Iterable[Record]) -> bytes:
    """Return the bytes of a file with these records."""
    body = bytearray(_HEAD)
    for record in records:
        _append(body, record)
    body += _NULL_RECORD + _FOOT_ID
    body += bytes(16 - len(body) % 16)
    return bytes(body + bytes(4) + struct.pack("<I", VERSION) + bytes(120) + _FOOT_END)


def _append(body: bytearray, record: Record) -> None:
    start = len(body)
    name = record.name.encode()
    data = b"".join(_property(value) for value in record.properties)
    body += bytes(12) + bytes([len(name)]) + name + data
    for inner in record.records:
        _append(body, inner)
    if record.records or not record.properties:
        body += _NULL_RECORD
    struct.pack_into("<III", body, start, len(body), len(record.properties), len(data))


def _property(value: Property) -> bytes:
    """Return the bytes of a property."""
    if isinstance(value, bool):
        return b"C" + bytes([value])
    if isinstance(value, Short):
        return b"I" + struct.pack("<i", value)
    if isinstance(value, int):
        return b"L" + struct.pack("<q", value)
    if isinstance(value, float):
        return b"D" + struct.pack("<d", value)
    if isinstance(value, (str, bytes)):
        text = value.encode() if isinstance(value, str) else value
        return (b"S" if isinstance(value, str) else b"R") + struct.pack("<I", len(text)) + text
    data = np.ascontiguousarray(value).astype(value.dtype.newbyteorder("<")).tobytes()
    packed = zlib.compress(data, 1) if len(data) >= _COMPRESSED else data
    head = struct.pack("<III", value.size, len(data) >= _COMPRESSED, len(packed))
    return _ARRAYS[value.dtype.str[1:]] + head + packed
