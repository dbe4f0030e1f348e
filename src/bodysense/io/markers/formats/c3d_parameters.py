"""The parameters of a C3D file: groups of named numbers and texts, from three kinds of processors."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError

BLOCK = 512  # bytes; a file consists of such blocks, and the first is the header
INTEL, DEC, MIPS = 84, 85, 86  # the processors that wrote files
BYTE_ORDERS = {INTEL: "<", DEC: "<", MIPS: ">"}
_SIZES = {-1: 1, 1: 1, 2: 2, 4: 4}  # bytes of a character, a byte, an integer, a real
_MOST = 20_000  # parameters of a file
_WORD = 1 << 16  # values of an integer, which some programs write with a sign
Value = list[str] | np.ndarray


@dataclass(frozen=True)
class Parameters:
    """Values by group and name, both in capitals."""

    values: Mapping[tuple[str, str], Value]

    def texts(self, group: str, name: str) -> list[str]:
        """Return texts without the blanks around them; empty if missing."""
        value = self.values.get((group, name), [])
        return list(value) if isinstance(value, list) else []

    def text(self, group: str, name: str) -> str:
        """Return the first of some texts; '' if missing."""
        return (self.texts(group, name) or [""])[0]

    def number(self, group: str, name: str) -> float:
        """Return the first of some numbers; 0 if missing."""
        value = self.values.get((group, name))
        return float(value.flat[0]) if isinstance(value, np.ndarray) and value.size else 0.0

    def frames(self) -> int:
        """Return the number of frames if the header's 16 bits cannot hold it; 0 if unknown.

        It is POINT:LONG_FRAMES, a POINT:FRAMES beyond 16 bits, or the distance of TRIAL's fields; the largest counts.
        """
        ends = [self._long(("TRIAL", f"ACTUAL_{end}_FIELD")) for end in ("START", "END")]
        of_trial = ends[1] - ends[0] + 1 if all(ends) else 0
        whole = int(self.number("POINT", "FRAMES")) if self.number("POINT", "FRAMES") >= _WORD else 0
        return max(0, of_trial, whole, self._long(("POINT", "LONG_FRAMES")))

    def _long(self, name: tuple[str, str]) -> int:
        """Return a whole number of up to 32 bits: one number, or its low and its high 16 bits; 0 if missing."""
        value = self.values.get(name)
        if not isinstance(value, np.ndarray) or value.size not in (1, 2) or not np.isfinite(value).all():
            return 0
        low, *high = (int(part) for part in value.flat)
        if value.size == 1:
            return low % _WORD if value.dtype.kind == "i" else max(low, 0)
        return low % _WORD + _WORD * (high[0] % _WORD)


def read_parameters(path: Path, data: bytes) -> tuple[Parameters, int]:
    """Return a file's parameters, and the processor that wrote it. Raises BodysenseError if they are damaged."""
    at = BLOCK * (max(data[0], 1) - 1)
    if at + 4 > len(data):
        raise BodysenseError(f"{path}: cannot be read as C3D (it ends before its parameters); was the file cut short?")
    processor = data[at + 3]
    if processor not in BYTE_ORDERS:
        raise BodysenseError(f"{path}: cannot be read as C3D (no processor is {processor}); export it again")
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Value]] = []
    at += 4
    try:
        for _ in range(_MOST):
            length, group = struct.unpack_from("bb", data, at)
            if not length or not group:
                break
            name = data[at + 2 : at + 2 + abs(length)].decode("latin-1").strip().upper()
            at += 2 + abs(length)
            step = struct.unpack_from(f"{BYTE_ORDERS[processor]}h", data, at)[0]
            if group < 0:
                groups[-group] = name
            else:
                found.append((group, name, _value(data, at + 2, processor)))
            if step <= 0:
                break
            at += step
    except (struct.error, ValueError, IndexError) as error:
        raise BodysenseError(f"{path}: cannot be read as C3D ({error}); export it again") from None
    values = {(groups[group], name): value for group, name, value in found if group in groups}
    return Parameters(values), processor


def from_dec(raw: np.ndarray) -> np.ndarray:
    """Convert reals of DEC's processors, bytes (..., 4 N), to numbers (..., N): swap halves, exponent minus 2."""
    words = np.ascontiguousarray(raw).view("<u2")
    swapped = np.stack([words[..., 1::2], words[..., 0::2]], axis=-1)
    return np.ascontiguousarray(swapped).view("<f4")[..., 0].astype(np.float64) / 4


def parameter_blocks(groups: Mapping[str, Mapping[str, object]]) -> bytes:
    """Return groups of whole numbers, reals and lists of texts as parameter blocks in Intel's order."""
    records: list[bytes] = []
    for number, (group, values) in enumerate(groups.items(), start=1):
        records.append(_record(group, -number, b""))
        records += [_record(name, number, _packed(value)) for name, value in values.items()]
    body = b"".join(records) + bytes(2)
    count = -(-(len(body) + 4) // BLOCK)
    return (bytes([1, 0x50, count, INTEL]) + body).ljust(count * BLOCK, b"\0")


def _record(name: str, group: int, content: bytes) -> bytes:
    """Return a group or a parameter without a description; its step leads from itself to the next."""
    return (
        struct.pack("bb", len(name), group) + name.encode() + struct.pack("<h", 2 + len(content) + 1) + content + b"\0"
    )


def _packed(value: object) -> bytes:
    """Return type, dimensions and data of a parameter."""
    if isinstance(value, list):
        texts = [str(text).encode("latin-1", "replace")[:255] for text in value]
        width = max((len(text) for text in texts), default=0)
        return struct.pack("bBBB", -1, 2, width, len(texts)) + b"".join(text.ljust(width) for text in texts)
    if isinstance(value, float):
        return struct.pack("<bBf", 4, 0, value)
    return struct.pack("<bBH", 2, 0, int(str(value)))


def _value(data: bytes, at: int, processor: int) -> Value:
    """Read the parameter whose type is at `at`. Raises ValueError if it does not end within the file."""
    kind, dimensions = struct.unpack_from("bB", data, at)
    if kind not in _SIZES:
        raise ValueError(f"a parameter of type {kind}")
    shape = tuple(data[at + 2 : at + 2 + dimensions])
    at += 2 + dimensions
    count = 1
    for length in shape:
        count *= length
    size = count * _SIZES[kind]
    if at + size > len(data):
        raise ValueError(f"a parameter of {size} bytes")
    content = data[at : at + size]
    if kind == -1:
        width = shape[0] if shape else 1
        texts = [content[k : k + width] for k in range(0, size, width)] if width else []
        return [text.decode("utf-8", "replace").strip(" \0") for text in texts]
    if kind == 4 and processor == DEC:
        return from_dec(np.frombuffer(content, "u1")[None])[0]
    mark = BYTE_ORDERS[processor]
    return np.frombuffer(content, {1: "i1", 2: f"{mark}i2", 4: f"{mark}f4"}[kind])
