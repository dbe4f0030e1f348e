"""MCAP takes as subjects: bodies and hands in the schemas of `bodysense.io.formats.mcap_take`, by any writer."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.arrays import check_sizes
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.mcap_take import (
    BODY_JOINTS,
    BODY_LAYOUT,
    BODY_SCHEMA,
    HAND_JOINTS,
    HAND_LAYOUT,
    HAND_SCHEMA,
    TIMES,
    hand_axes,
    hand_rotation,
    ours_from,
)
from bodysense_conform.subject import SIDES, Subject, Transport, points_subject

_FIRST, _SECOND = 4, 6  # bytes; places of the fields of a FlatBuffers table in its list of fields
# Errors that reading a damaged file raises, apart from its format's own.
_BROKEN = (ValueError, MemoryError, ArithmeticError, LookupError, struct.error, EOFError, RuntimeError)


def read_mcap(path: Path) -> Subject:
    """Read a take. Raises BodysenseError, naming the file and the fix, if it holds no body and no hand."""
    topics = _messages(path)
    rows = {kind: _rows(kind, topics[kind]) for kind in ("body", *SIDES) if kind in topics}
    if "body" in rows or any(map(len, rows.values())):
        rows = {kind: found for kind, found in rows.items() if kind == "body" or len(found)}
    if not rows:
        raise BodysenseError(f"{path}: no message of {BODY_SCHEMA} or {HAND_SCHEMA} in it; export one of these schemas")
    first, main = next(iter(rows.items()))
    if not len(main):
        raise BodysenseError(
            f"{path}: none of its {len(topics[first])} messages can be read as {BODY_SCHEMA}; export it again"
        )
    time = main["times"]["sample"] / 1e9
    parts = [_part(kind, found, time) for kind, found in rows.items()]
    names = [name for part in parts for name in part[0]]  # of duplicate wrists, the body's is used
    position, rotation, valid = (np.concatenate([part[k] for part in parts], axis=1) for k in (1, 2, 3))
    rotated = np.array([not name.endswith("_tip") for name in names])
    messages = sum(len(topics[kind]) for kind in rows)
    jumps = [np.diff(found["sequence"]) for found in rows.values()]
    transport = Transport(
        messages=messages,
        malformed=messages - sum(map(len, rows.values())),
        lost=int(sum((jump[jump > 1] - 1).sum() for jump in jumps)),
        log_time=main["log_time"] / 1e9,
        available=main["times"]["available"] / 1e9,
        device_time=main["times"]["device"] / 1e9,
        all_tracked=main["all_tracked"] if first == "body" else None,
        all_valid=np.asarray(main["joints"]["valid"].all(axis=1)) if first == "body" else None,
    )
    subject = points_subject(path.stem, "MCAP", names, time, position, rotation, rotated, valid)
    return replace(subject, floor=0.0, transport=transport)


def _messages(path: Path) -> dict[str, list[Any]]:
    """Return the messages of a file's topics: 'body', 'left', 'right'."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from zstandard import ZstdError

    found: dict[str, list[Any]] = {}
    try:
        data = path.read_bytes()  # a wrong length in the file cannot read beyond its end
        _check_chunks(path, data)
        for schema, channel, message in make_reader(BytesIO(data)).iter_messages(log_time_order=False):
            name = channel.topic.rpartition("/")[2]
            if schema is not None and schema.name == BODY_SCHEMA:
                found.setdefault("body", []).append(message)
            elif schema is not None and schema.name == HAND_SCHEMA and name.startswith(SIDES):
                found.setdefault(next(side for side in SIDES if name.startswith(side)), []).append(message)
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None
    except (McapError, ZstdError, *_BROKEN) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BodysenseError(f"{path}: not a whole MCAP file ({reason[:80]}); export it again") from None
    return found


def _check_chunks(path: Path, data: bytes) -> None:
    """Raise BodysenseError if the chunks of a file unpack to far more than its size."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader
    from zstandard import frame_content_size

    unpacked = 0
    for record in StreamReader(BytesIO(data), emit_chunks=True).records:
        if isinstance(record, Chunk):
            size = frame_content_size(record.data) if record.compression == "zstd" else 0
            unpacked += max(record.uncompressed_size, size)
            check_sizes(path, unpacked, len(data))


def _rows(kind: str, messages: list[Any]) -> np.ndarray:
    """Return the content of readable messages (≤ M,); all joints are invalid in messages without tracking."""
    layout, count = (BODY_LAYOUT, len(BODY_JOINTS)) if kind == "body" else (HAND_LAYOUT, len(HAND_JOINTS))
    read = ((message, read_record(message.data, layout, count)) for message in messages)
    rows = [(*found, message.log_time, message.sequence) for message, found in read if found is not None]
    summary = [("all_tracked", "?"), ("log_time", "<i8"), ("sequence", "<i8")]  # of the device; ns; count
    return np.array(rows, dtype=[("joints", layout, (count,)), ("times", TIMES), *summary])


def read_record(data: bytes, layout: np.dtype, count: int) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Return joints (count,), times and 'all tracked' of one record, or None if it is damaged."""
    from flatbuffers.table import Table

    try:
        table = Table(data, struct.unpack_from("<I", data, 0)[0])
        stamp = table.Offset(_SECOND)
        if not stamp or table.Pos + stamp + TIMES.itemsize > len(data):
            return None
        joints, all_tracked = np.zeros(count, dtype=layout), False
        if payload := table.Offset(_FIRST):
            body = Table(data, table.Indirect(table.Pos + payload))
            place, flag = body.Offset(_FIRST), body.Offset(_SECOND)
            if not place or body.Pos + place + count * layout.itemsize > len(data):
                return None
            joints = np.frombuffer(data, layout, count, body.Pos + place)
            all_tracked = bool(flag) and data[body.Pos + flag] != 0
        return joints, np.frombuffer(data, TIMES, 1, table.Pos + stamp)[0], all_tracked
    except (struct.error, IndexError, ValueError, TypeError):  # of offsets that lead out of the record
        return None


def _part(kind: str, rows: np.ndarray, time: np.ndarray) -> tuple[Sequence[str], np.ndarray, np.ndarray, np.ndarray]:
    """Return names, positions, rotations and validity of one topic at the times of the take."""
    names, near = BODY_JOINTS, np.array(True)
    if kind != "body":
        names = [f"{kind}_{name}" for name in HAND_JOINTS]
        nearest, near = _nearest(rows["times"]["sample"] / 1e9, time)
        rows = rows[nearest]
    joints = rows["joints"]
    with np.errstate(invalid="ignore"):  # damaged numbers are NaN
        theirs = joints["rotation"].astype(float)
        position, rotation = ours_from(joints["position"].astype(float), theirs)
    if kind != "body":
        axes = hand_axes(default_skeleton(), kind)
        rotation = hand_rotation(theirs, np.array([axes.get(name, [1.0, 0, 0, 0]) for name in names]))
    return names, position, rotation, joints["valid"] & near[..., None]


def _nearest(sampled: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each time (T,) the nearest sample, and whether it is within half an interval."""
    order = np.argsort(sampled, kind="stable")
    after = np.clip(np.searchsorted(sampled[order], time), 1, max(len(sampled) - 1, 1))
    both = order[np.minimum([after - 1, after], len(sampled) - 1)]
    best = both[np.abs(sampled[both] - time).argmin(axis=0), np.arange(len(time))]
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return best, np.abs(sampled[best] - time) <= 0.6 * max(usual, 1e-3)
