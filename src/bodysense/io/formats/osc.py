"""Open Sound Control 1.0: packets to messages and back.

Packets are untrusted, so no content may raise, hang or grow: `read_packet` returns the messages or the reason of a
refusal. (The library python-osc, which the tests compare with, never returns
from a bundle that announces a negative size.)
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, pairwise
from typing import TypeAlias

import numpy as np

Argument: TypeAlias = str | int | float | bool | bytes | None

LARGEST = 65_507  # bytes of a packet: more does not fit into a UDP datagram
MOST_MESSAGES = 1024  # in a packet
MOST_ARGUMENTS = 4096  # of a message
DEEPEST = 4  # bundles in bundles
DATAGRAM = 1400  # bytes that a network does not split
_BUNDLE = b"#bundle\0"
_AT_ONCE = struct.pack(">Q", 1)
_NUMBERS = {"i": "i", "f": "f", "d": "d", "h": "q", "t": "Q"}
_WORDS: dict[str, bool | float | None] = {"T": True, "F": False, "N": None, "I": float("inf")}


@dataclass(frozen=True)
class Message:
    """An address and its arguments."""

    address: str
    arguments: tuple[Argument, ...]


def read_packet(packet: bytes) -> tuple[Message, ...] | str:
    """Return the messages of a packet in order, bundles flattened without their times; or the reason of a refusal."""
    if len(packet) > LARGEST:
        return f"{len(packet)} bytes are no datagram"
    try:
        found: list[Message] = []
        for element in _elements(packet, 0):
            found.append(_message(element))
            if len(found) > MOST_MESSAGES:
                return f"more than {MOST_MESSAGES} messages"
        return tuple(found)
    except _Malformed as reason:
        return str(reason)


def message_bytes(address: str, tags: str, *values: Argument) -> bytes:
    """Return one message; `tags` are the types of the values: i, h, f, d, s or b."""
    parts = [_padded(address.encode()), _padded(f",{tags}".encode())]
    for tag, value in zip(tags, values, strict=True):
        if tag == "s":
            parts.append(_padded(str(value).encode()))
        elif tag == "b":
            blob = bytes(value)  # type: ignore[arg-type]
            parts.append(struct.pack(">i", len(blob)) + blob + b"\0" * (-len(blob) % 4))
        else:
            parts.append(struct.pack(">" + _NUMBERS[tag], value))
    return b"".join(parts)


def bundled(messages: Sequence[bytes], largest: int = DATAGRAM) -> list[bytes]:
    """Return messages in bundles of at most `largest` bytes, in order; a larger message is in a bundle of its own."""
    packets, parts, size = [], [_BUNDLE, _AT_ONCE], 16
    for message in messages:
        if size + 4 + len(message) > largest and len(parts) > 2:
            packets.append(b"".join(parts))
            parts, size = [_BUNDLE, _AT_ONCE], 16
        parts += [struct.pack(">i", len(message)), message]
        size += 4 + len(message)
    if len(parts) > 2:
        packets.append(b"".join(parts))
    return packets


class PacketForm:
    """Packets in which only single-precision numbers change: built once, filled for every frame.

    A message is its address, its types and its constant values; the remaining types are `f` and filled later.
    """

    def __init__(self, messages: Sequence[tuple[str, str, tuple[Argument, ...]]], largest: int = DATAGRAM) -> None:
        free = [len(tags) - len(values) for _, tags, values in messages]
        rows = [message_bytes(*row[:2], *row[2], *(n * (0.0,))) for row, n in zip(messages, free, strict=True)]
        packets = bundled(rows, largest)
        self._words = np.frombuffer(b"".join(packets), dtype=">u4")
        self._ends = np.cumsum([len(packet) for packet in packets]).tolist()
        places, end, left = [], 0, list(zip(rows, free, strict=True))
        for packet in packets:
            end, last = end + 16, end + len(packet)
            while end < last:
                row, count = left.pop(0)
                end += 4 + len(row)
                places += range(end // 4 - count, end // 4)
        self._places = np.array(places, dtype=np.intp)

    def filled(self, values: np.ndarray) -> list[bytes]:
        """Return the packets with these numbers (N,), in the order of the messages."""
        words = self._words.copy()
        words[self._places] = values.astype(">f4").view(">u4")
        data = words.tobytes()
        return [data[start:end] for start, end in pairwise((0, *self._ends))]


class _Malformed(Exception):
    """The reason why a packet is refused."""


def _elements(packet: bytes, depth: int) -> Iterator[bytes]:
    """Iterate over the messages, unparsed, of a packet that is one or a bundle of them."""
    if not packet.startswith(_BUNDLE):
        yield packet
        return
    if depth >= DEEPEST:
        raise _Malformed(f"bundles lie more than {DEEPEST} deep")
    place = 16
    if len(packet) < place:
        raise _Malformed("a bundle is cut off")
    while place < len(packet):
        size = int(_number(packet, place, ">i"))
        place += 4
        if size <= 0 or size % 4 or place + size > len(packet):
            raise _Malformed(f"a bundle says that {size} bytes follow, but {len(packet) - place} do")
        yield from _elements(packet[place : place + size], depth + 1)
        place += size


def _message(packet: bytes) -> Message:
    if not packet.startswith(b"/"):
        raise _Malformed("no address: a message begins with '/'")
    address, place = _string(packet, 0)
    if place == len(packet):  # old senders omit the types if there are no arguments
        return Message(address, ())
    tags, place = _string(packet, place)
    if not tags.startswith(",") or len(tags) > MOST_ARGUMENTS:
        raise _Malformed("no types: a comma and at most 4096 letters follow the address")
    values: list[Argument] = []
    for tag, numbers in _parts(tags[1:]):
        if numbers is not None:
            try:
                values += numbers.unpack_from(packet, place)
            except struct.error:
                raise _Malformed("a number is cut off") from None
            place += numbers.size
        elif tag in "sS":
            text, place = _string(packet, place)
            values.append(text)
        elif tag == "b":
            size = int(_number(packet, place, ">i"))
            if size < 0 or place + 4 + size > len(packet):
                raise _Malformed(f"a blob says that {size} bytes follow")
            values.append(packet[place + 4 : place + 4 + size])
            place += 4 + size + -size % 4
        elif tag in _WORDS:
            values.append(_WORDS[tag])
        else:
            raise _Malformed(f"the type {tag!r} is not read here")
    return Message(address, tuple(values))


@lru_cache(maxsize=256)
def _parts(tags: str) -> tuple[tuple[str, struct.Struct | None], ...]:
    """Split types one by one; consecutive numbers are read at once."""
    found: list[tuple[str, struct.Struct | None]] = []
    for are_numbers, run in groupby(tags, _NUMBERS.__contains__):
        if are_numbers:
            found.append(("", struct.Struct(">" + "".join(_NUMBERS[tag] for tag in run))))
        else:
            found += [(tag, None) for tag in run]
    return tuple(found)


def _number(packet: bytes, place: int, form: str) -> int | float:
    try:
        return struct.unpack_from(form, packet, place)[0]
    except struct.error:
        raise _Malformed("a number is cut off") from None


def _string(packet: bytes, place: int) -> tuple[str, int]:
    """Return a text and the position after it."""
    end = packet.find(b"\0", place)
    if end < 0:
        raise _Malformed("a text has no end")
    after = end + 4 - (end - place) % 4
    try:
        return packet[place:end].decode(), min(after, len(packet))
    except UnicodeDecodeError:
        raise _Malformed("a text is not UTF-8") from None


def _padded(text: bytes) -> bytes:
    return text + b"\0" * (4 - len(text) % 4)
