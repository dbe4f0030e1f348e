"""Damaged and hostile FBX files are refused in one line, soon, and without much memory."""

from __future__ import annotations

import struct
import time
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_fbx import MadeFile

from bodysense.errors import BodysenseError
from bodysense.io.formats.fbx.binary import Record, contents
from bodysense.io.formats.fbx.motion import parse_fbx

PATH = Path("take.fbx")


def animated(count: int = 2, parent: Callable[[int], int] = lambda k: k - 1, *, stop: float = 1.0) -> MadeFile:
    """A file of bones of which the first turns."""
    file = MadeFile()
    layer = file.stack("Take 001", stop)
    bones: list[int] = []
    for k in range(count):
        bones.append(file.bone(f"bone{k}", bones[parent(k)] if k else 0))
    file.curves(layer, bones[0], "Lcl Rotation", np.linspace([0.0, 0, 0], [0, 20, 0], 30))
    return file


def circle() -> bytes:
    """Two bones that are each other's parents."""
    file = animated(2)
    first, second = (record.properties[0] for record in file.objects if record.name == "Model")
    file.links = [link for link in file.links if link.properties[2] not in (0, first) or link.properties[1] != first]
    file.link(int(first), int(second))  # type: ignore[arg-type]
    return file.bytes


def bomb() -> bytes:
    """An array of 1 GiB of zeros in 1 MB."""
    packer = zlib.compressobj(1)
    block = bytes(1 << 24)
    packed = b"".join(packer.compress(block) for _ in range(64)) + packer.flush()
    file = animated()
    keys = next(
        r for curve in file.objects if curve.name == "AnimationCurve" for r in curve.records if r.name == "KeyTime"
    )
    keys.properties = (b"BOMB",)
    data = bytearray(file.bytes)
    at = data.index(b"R" + struct.pack("<I", 4) + b"BOMB")
    array = b"l" + struct.pack("<III", 1 << 27, 1, len(packed)) + packed
    grown = len(array) - 9
    head = data.rindex(b"KeyTime", 0, at) - 13
    for start in _enclosing(data, head):
        (end,) = struct.unpack_from("<I", data, start)
        struct.pack_into("<I", data, start, end + grown)
    struct.pack_into("<I", data, head + 8, len(array))
    after = bytes(data[at + 9 :])
    moved = bytearray(bytes(data[:at]) + array + after)
    return bytes(moved)


def _enclosing(data: bytearray, inner: int) -> list[int]:
    """Return the starts of the records that end at or behind a record, itself included."""
    found, at, end = [], 27, len(data)
    while at < inner:
        stop, _, size, name = struct.unpack_from("<IIIB", data, at)
        if stop > inner:
            found.append(at)
            at += 13 + name + size
            end = stop
        else:
            at = stop
    assert end >= inner
    return [*found, inner]


def _without_curves() -> bytes:
    file = MadeFile()
    file.bone("Hips", 0)
    return file.bytes


def _at_rate(rate: float) -> bytes:
    file = animated()
    file.rate = rate
    return file.bytes


def _with_keys(value: float) -> bytes:
    file = MadeFile()
    layer = file.stack("Take 001", 1.0)
    file.curves(layer, file.bone("Hips", 0), "Lcl Translation", np.full((30, 3), value))
    return file.bytes


def _scaled(scale: float) -> bytes:
    file = animated()
    layer = 1001
    bone = next(record.properties[0] for record in file.objects if record.name == "Model")
    file.curves(layer, int(bone), "Lcl Scaling", np.full((30, 3), scale))  # type: ignore[arg-type]
    return file.bytes


def _nested(depth: int) -> bytes:
    record = Record("a", (1,))
    for _ in range(min(depth, 300)):
        record = Record("a", (1,), [record])
    return contents([record])


HOSTILE: dict[str, tuple[Callable[[], bytes], str]] = {
    "empty": (lambda: b"", "cannot be read, or is damaged"),
    "text": (lambda: b"HIERARCHY\nROOT Hips\n", "cannot be read, or is damaged"),
    "an object file": (lambda: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "cannot be read, or is damaged"),
    "its first line": (lambda: b"Kaydara FBX Binary  \x00\x1a\x00", "cannot be read, or is damaged"),
    "cut short": (lambda: animated().bytes[:2000], "cannot be read, or is damaged"),
    "no skeleton": (lambda: MadeFile().bytes, "no skeleton is in it; export it with its skeleton and animation"),
    "no animation": (_without_curves, "its skeleton is not animated"),
    "too deep": (lambda: animated(2000).bytes, "cannot be read, or is damaged"),
    "too many": (lambda: animated(5100, lambda k: 0).bytes, "5101 nodes, more than 5000; export the skeleton alone"),
    "too long": (lambda: animated(stop=1e6).bytes, "frames of 2 joints; cut it in parts"),
    "an hour of centuries": (lambda: animated(stop=1e8).bytes, "frames of 2 joints; cut it in parts"),
    "too fast": (lambda: _at_rate(1e6), "frames a second, not 1 to 1000; export it again"),
    "not finite": (lambda: _with_keys(np.nan), "its animation is not all finite; export it again"),
    "huge": (lambda: _with_keys(1e30), "its animation is not all finite; export it again"),
    "scaled to nothing": (lambda: _scaled(0.0), "'bone0' is scaled to nothing or mirrored; apply the scale"),
    "mirrored": (lambda: _scaled(-1.0), "'bone0' is scaled to nothing or mirrored; apply the scale"),
    "a bomb": (bomb, "cannot be read, or is damaged"),
    "records in records": (lambda: _nested(5000), "cannot be read, or is damaged"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_refused_in_one_line(name: str) -> None:
    make, message = HOSTILE[name]
    data = make()
    tracemalloc.start()
    begun = time.perf_counter()
    with pytest.raises(BodysenseError) as refused:
        parse_fbx(data, PATH)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert message in str(refused.value) and str(refused.value).startswith("take.fbx: ")
    assert "\n" not in str(refused.value)
    assert time.perf_counter() - begun < 20 and peak < 200e6


def test_bones_in_a_circle_end() -> None:
    """They are refused, or hang on the scene; they never hang the program."""
    try:
        found = parse_fbx(circle(), PATH)
    except BodysenseError as error:
        assert "\n" not in str(error)
    else:
        assert all(parent < joint for joint, parent in enumerate(found.parents))


@given(st.data())
def test_damaged_files_are_refused_or_read(data: st.DataObject) -> None:
    whole = bytearray(animated(5).bytes)
    for _ in range(data.draw(st.integers(1, 8))):
        at = data.draw(st.integers(0, len(whole) - 5))
        if data.draw(st.booleans()):
            whole[at] = data.draw(st.integers(0, 255))
        else:
            struct.pack_into("<I", whole, at, data.draw(st.sampled_from([0, 1, 2**31 - 1, 2**31, 2**32 - 1])))
    try:
        found = parse_fbx(bytes(whole), PATH)
    except BodysenseError as error:
        assert "\n" not in str(error)
    else:
        assert np.isfinite(found.values).all()
