"""MCAP takes as subjects: bodies and hands in the schemas of `bodysense.io.mcap_take`, by any writer."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.arrays import check_sizes
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.mcap_take import (
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
from bodysense_conform.subject import Subject, Transport, ordered

_SIDES = ("left", "right")
# Errors that reading a damaged file raises, apart from its format's own.
_BROKEN = (ValueError, MemoryError, ArithmeticError, LookupError, struct.error, EOFError, RuntimeError)


@dataclass(frozen=True, eq=False)
class _Track:
    """One topic: M messages that could be read."""

    joints: np.ndarray  # (M, J) of a layout; all invalid if nothing is tracked
    times: np.ndarray  # (M,) of TIMES
    all_tracked: np.ndarray  # (M,) bool, the device's own summary
    log_time: np.ndarray  # (M,) ns
    sequence: np.ndarray  # (M,)
    malformed: int


def read_mcap(path: Path) -> Subject:
    """Read a take. Raises BodysenseError, naming the file and the fix, if it holds no body and no hand."""
    found = _tracks(path)
    readable = [kind for kind in ("body", *_SIDES) if kind in found and (kind == "body" or len(found[kind].times))]
    tracks = {kind: found[kind] for kind in readable or found}
    if not tracks:
        raise BodysenseError(f"{path}: no message of {BODY_SCHEMA} or {HAND_SCHEMA} in it; export one of these schemas")
    main = next(iter(tracks.values()))
    if not len(main.times):
        raise BodysenseError(
            f"{path}: none of its {main.malformed} messages can be read as {BODY_SCHEMA}; export it again"
        )
    time = main.times["sample"] / 1e9
    parts = [_part(name, track, time) for name, track in tracks.items()]
    points = ordered([name for part in parts for name in part[0]])
    shape = (len(time), len(points))
    position, rotation, valid = np.full((*shape, 3), np.nan), np.full((*shape, 4), np.nan), np.zeros(shape, dtype=bool)
    for names, places, turns, good in reversed(parts):  # of a wrist that comes twice the body's counts
        columns = [points.index(name) for name in names]
        position[:, columns], rotation[:, columns], valid[:, columns] = places, turns, good
    jumps = [np.diff(track.sequence) for track in tracks.values()]
    return Subject(
        name=path.stem,
        format="MCAP",
        points=points,
        time=time,
        position=position,
        rotation=rotation,
        rotated=np.array([not name.endswith("_tip") for name in points]),
        valid=valid,
        floor=0.0,
        transport=Transport(
            messages=sum(len(track.times) + track.malformed for track in tracks.values()),
            malformed=sum(track.malformed for track in tracks.values()),
            lost=int(sum((jump[jump > 1] - 1).sum() for jump in jumps)),
            log_time=main.log_time / 1e9,
            available=main.times["available"] / 1e9,
            device_time=main.times["device"] / 1e9,
            all_tracked=main.all_tracked if "body" in tracks else None,
        ),
    )


def _tracks(path: Path) -> dict[str, _Track]:
    """Read the topics of a file: 'body', 'left', 'right'."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from zstandard import ZstdError

    found: dict[str, list[Any]] = {}
    try:
        data = path.read_bytes()  # no more can be read than there is, whatever a length in the file is
        _check_chunks(path, data)
        for schema, channel, message in make_reader(BytesIO(data)).iter_messages(log_time_order=False):
            kind = _kind(channel.topic, "" if schema is None else schema.name)
            if kind is not None:
                found.setdefault(kind, []).append(message)
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror})") from None
    except (McapError, ZstdError, *_BROKEN) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise BodysenseError(f"{path}: not a whole MCAP file ({reason[:80]}); export it again") from None
    return {kind: _track(kind, messages) for kind, messages in found.items()}


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


def _kind(topic: str, schema: str) -> str | None:
    if schema == BODY_SCHEMA:
        return "body"
    name = topic.rpartition("/")[2]
    return next((side for side in _SIDES if name.startswith(side)), None) if schema == HAND_SCHEMA else None


def _track(kind: str, messages: list[Any]) -> _Track:
    layout, count = (BODY_LAYOUT, len(BODY_JOINTS)) if kind == "body" else (HAND_LAYOUT, len(HAND_JOINTS))
    rows = [(message, read_record(message.data, layout, count)) for message in messages]
    good = [(message, row) for message, row in rows if row is not None]
    return _Track(
        joints=np.array([row[0] for _, row in good], dtype=layout).reshape(len(good), count),
        times=np.array([row[1] for _, row in good], dtype=TIMES).reshape(len(good)),
        all_tracked=np.array([row[2] for _, row in good], dtype=bool),
        log_time=np.array([message.log_time for message, _ in good], dtype=np.int64),
        sequence=np.array([message.sequence for message, _ in good], dtype=np.int64),
        malformed=len(rows) - len(good),
    )


def read_record(data: bytes, layout: np.dtype, count: int) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Return joints (count,), times and 'all tracked' of one record, or None if it is damaged."""
    try:
        table = struct.unpack_from("<I", data, 0)[0]
        stamp = _field(data, table, 1)
        if stamp is None or stamp + TIMES.itemsize > len(data):
            return None
        joints, all_tracked = np.zeros(count, dtype=layout), False
        payload = _field(data, table, 0)
        if payload is not None:
            payload += struct.unpack_from("<I", data, payload)[0]
            place, flag = _field(data, payload, 0), _field(data, payload, 1)
            if place is None or place + count * layout.itemsize > len(data):
                return None
            joints = np.frombuffer(data, layout, count, place)
            all_tracked = flag is not None and data[flag] != 0
        return joints, np.frombuffer(data, TIMES, 1, stamp)[0], all_tracked
    except (struct.error, IndexError, ValueError):
        return None


def _field(data: bytes, table: int, slot: int) -> int | None:
    """Return the offset of a field of a FlatBuffers table, or None if it is absent."""
    vtable = table - struct.unpack_from("<i", data, table)[0]
    size = struct.unpack_from("<H", data, vtable)[0]
    if vtable < 0 or 4 + 2 * slot >= size:
        return None
    offset = struct.unpack_from("<H", data, vtable + 4 + 2 * slot)[0]
    return table + offset if offset else None


def _part(kind: str, track: _Track, time: np.ndarray) -> tuple[list[str], np.ndarray, np.ndarray, np.ndarray]:
    """Names, places, turns and validity of one topic at the times of the take."""
    with np.errstate(invalid="ignore"):  # damaged numbers are NaN
        position, rotation = (track.joints[name].astype(float) for name in ("position", "rotation"))
    if kind == "body":
        names: list[str | None] = [name if name in default_skeleton().points else None for name in BODY_JOINTS]
        position, rotation = ours_from(position, rotation)
    else:
        names = [None if name is None else f"{kind}_{name}" for name in HAND_JOINTS]
        axes = hand_axes(default_skeleton(), kind)
        rotation = hand_rotation(rotation, np.array([axes.get(name or "", [1.0, 0, 0, 0]) for name in names]))
        position = position * np.array([-1.0, 1.0, -1.0])
    keep = [k for k, name in enumerate(names) if name is not None]
    position, rotation, valid = position[:, keep], rotation[:, keep], track.joints["valid"][:, keep]
    if kind != "body":
        nearest, near = _nearest(track.times["sample"] / 1e9, time)
        position, rotation, valid = position[nearest], rotation[nearest], valid[nearest] & near[:, None]
    return [name for name in names if name is not None], position, rotation, valid


def _nearest(sampled: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return for each time (T,) the nearest sample, and whether it is within half an interval."""
    order = np.argsort(sampled, kind="stable")
    after = np.clip(np.searchsorted(sampled[order], time), 1, max(len(sampled) - 1, 1))
    both = order[np.minimum([after - 1, after], len(sampled) - 1)]
    best = both[np.abs(sampled[both] - time).argmin(axis=0), np.arange(len(time))]
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return best, np.abs(sampled[best] - time) <= 0.6 * max(usual, 1e-3)
