"""OSC packets of VMC: datagrams to messages, messages to poses. Pure Python.

A pose ends at /VMC/Ext/OK, at /VMC/Ext/T, or with its bundle.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

Argument = str | int | float | bool | bytes | None
_BUNDLE = b"#bundle\0"
_DEEPEST = 4  # bundles in bundles
_NUMBERS = {"i": ">i", "f": ">f", "d": ">d", "h": ">q", "t": ">Q"}
_WORDS: dict[str, Argument] = {"T": True, "F": False, "N": None, "I": float("inf")}
_ENDS = ("/VMC/Ext/OK", "/VMC/Ext/T")
_BONE, _ROOT = "/VMC/Ext/Bone/Pos", "/VMC/Ext/Root/Pos"


@dataclass(frozen=True)
class BonePose:
    """Position (x, y, z) in metres and rotation (x, y, z, w), in Unity's axes."""

    position: tuple[float, float, float]
    rotation: tuple[float, float, float, float]


@dataclass
class Poses:
    """Received bones of an incomplete pose; `take` returns each pose that a packet completes."""

    bones: dict[str, BonePose] = field(default_factory=dict)

    def take(self, packet: bytes) -> list[dict[str, BonePose]]:
        """Read a datagram; return the poses it completes, with the root as 'Root'. Raises ValueError if malformed."""
        poses: list[dict[str, BonePose]] = []
        for address, arguments in messages(packet):
            if address in (_BONE, _ROOT):
                name, bone_pose = _bone_pose(address, arguments)
                self.bones[name if address == _BONE else "Root"] = bone_pose
            elif address in _ENDS:
                self._end(poses)
        if packet.startswith(_BUNDLE):
            self._end(poses)
        return poses

    def _end(self, poses: list[dict[str, BonePose]]) -> None:
        if self.bones:
            poses.append(self.bones)
            self.bones = {}


def messages(packet: bytes, depth: int = 0) -> Iterator[tuple[str, list[Argument]]]:
    """Yield address and arguments of each message of a packet; malformed ones raise ValueError."""
    if not packet.startswith(_BUNDLE):
        yield _message(packet)
        return
    if depth == _DEEPEST:
        raise ValueError(f"more than {_DEEPEST} bundles in bundles")
    place = 16
    while place < len(packet):
        size = int.from_bytes(packet[place : place + 4], "big")
        place += 4
        if size == 0 or place + size > len(packet):
            raise ValueError("a bundle's element is cut off")
        yield from messages(packet[place : place + size], depth + 1)
        place += size


def _message(data: bytes) -> tuple[str, list[Argument]]:
    address, place = _text(data, 0)
    tags, place = _text(data, place)
    if not address.startswith("/") or not tags.startswith(","):
        raise ValueError("not an OSC message")
    arguments: list[Argument] = []
    for tag in tags[1:]:
        if tag in _WORDS:
            arguments.append(_WORDS[tag])
        elif tag == "s":
            text, place = _text(data, place)
            arguments.append(text)
        elif tag in _NUMBERS:
            size = struct.calcsize(_NUMBERS[tag])
            if place + size > len(data):
                raise ValueError(f"{address}: cut off")
            arguments.append(struct.unpack_from(_NUMBERS[tag], data, place)[0])
            place += size
        else:
            raise ValueError(f"{address}: arguments of type {tag!r} are not read")
    return address, arguments


def _text(data: bytes, place: int) -> tuple[str, int]:
    """Return the padded text at a position, and the position after it."""
    end = data.find(b"\0", place)
    if end < 0:
        raise ValueError("a text without an end")
    return data[place:end].decode("utf-8"), (end // 4 + 1) * 4


def _bone_pose(address: str, arguments: list[Argument]) -> tuple[str, BonePose]:
    name, numbers = arguments[0] if arguments else None, arguments[1:8]
    good = [float(x) for x in numbers if isinstance(x, int | float) and abs(x) < float("inf")]
    if not isinstance(name, str) or len(good) < 7 or not any(good[3:]):
        raise ValueError(f"{address} is not a name, a position and a rotation")
    x, y, z, *rotation = good
    return name, BonePose((x, y, z), (rotation[0], rotation[1], rotation[2], rotation[3]))
