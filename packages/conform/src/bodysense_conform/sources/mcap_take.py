"""MCAP takes as subjects: bodies and hands in the schemas of `io.mcap_take`, by anybody's writer."""

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
# What reading a damaged file raises beside its format's own errors.
_BROKEN = (ValueError, MemoryError, ArithmeticError, LookupError, struct.error, EOFError, RuntimeError)


@dataclass(frozen=True, eq=False)
class _Track:
    """One topic: M messages that could be read."""

    joints: np.ndarray  # (M, J) of a layout; all invalid where nothing is tracked
    times: np.ndarray  # (M,) of TIMES
    told: np.ndarray  # (M,) bool, the device's own summary
    log_time: np.ndarray  # (M,) ns
    sequence: np.ndarray  # (M,)
    malformed: int


def read_mcap(path: Path) -> Subject:
    """Read a take. Raises BodysenseError, naming the file and the fix, where it holds no body and no hand."""
    found = _tracks(path)
    tracks = {kind: found[kind] for kind in ("body", *_SIDES) if kind in found}
    if not tracks:
        raise BodysenseError(f"{path}: no message of {BODY_SCHEMA} or {HAND_SCHEMA} in it; export one of these schemas")
    main = tracks.get("body") or next(iter(tracks.values()))
    if not len(main.times):
        raise BodysenseError(
            f"{path}: none of its {main.malformed} messages can be read as {BODY_SCHEMA}; export it again"
        )
    time = main.times["sample"] / 1e9
    parts = [_part(name, track, time) for name, track in tracks.items()]
    names = [name for part in parts for name in part[0]]
    points = ordered(names)
    position, rotation, valid, rotated = _together(parts, points)
    jumps = [np.diff(track.sequence) for track in tracks.values()]
    return Subject(
        name=path.stem,
        format="MCAP",
        points=points,
        time=time,
        position=position,
        rotation=rotation,
        rotated=rotated,
        valid=valid,
        floor=0.0,
        transport=Transport(
            messages=sum(len(track.times) + track.malformed for track in tracks.values()),
            malformed=sum(track.malformed for track in tracks.values()),
            lost=int(sum((jump[jump > 1] - 1).sum() for jump in jumps)),
            log_time=main.log_time / 1e9,
            available=main.times["available"] / 1e9,
            device_time=main.times["device"] / 1e9,
            all_tracked=main.told if "body" in tracks else None,
        ),
    )


def _tracks(path: Path) -> dict[str, _Track]:
    """The topics of a file: 'body', 'left', 'right'."""
    from mcap.exceptions import McapError
    from mcap.reader import make_reader
    from zstandard import ZstdError

    found: dict[str, list[Any]] = {}
    try:
        data = path.read_bytes()  # of which no more can be read than there is, whatever a length says
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
    """Raise BodysenseError where the chunks of a file say that they unpack to far more than it is."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader
    from zstandard import frame_content_size

    unpacked = 0
    for record in StreamReader(BytesIO(data), emit_chunks=True).records:
        if isinstance(record, Chunk):
            said = frame_content_size(record.data) if record.compression == "zstd" else 0
            unpacked += max(record.uncompressed_size, said)
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
        told=np.array([row[2] for _, row in good], dtype=bool),
        log_time=np.array([message.log_time for message, _ in good], dtype=np.int64),
        sequence=np.array([message.sequence for message, _ in good], dtype=np.int64),
        malformed=len(rows) - len(good),
    )


def read_record(data: bytes, layout: np.dtype, count: int) -> tuple[np.ndarray, np.ndarray, bool] | None:
    """Joints (count,), times and 'all tracked' of one record; None for what is none."""
    try:
        table = struct.unpack_from("<I", data, 0)[0]
        stamp = _field(data, table, 1)
        if stamp is None or stamp + TIMES.itemsize > len(data):
            return None
        times = np.frombuffer(data, TIMES, 1, stamp)[0]
        joints, told = np.zeros(count, dtype=layout), False
        payload = _field(data, table, 0)
        if payload is not None:
            payload += struct.unpack_from("<I", data, payload)[0]
            place, flag = _field(data, payload, 0), _field(data, payload, 1)
            if place is None or place + count * layout.itemsize > len(data):
                return None
            joints = np.frombuffer(data, layout, count, place)
            told = flag is not None and data[flag] != 0
        return joints, times, told
    except (struct.error, IndexError, ValueError):
        return None


def _field(data: bytes, table: int, slot: int) -> int | None:
    """Where a field of a FlatBuffers table lies; None where it was left out."""
    vtable = table - struct.unpack_from("<i", data, table)[0]
    size = struct.unpack_from("<H", data, vtable)[0]
    if vtable < 0 or 4 + 2 * slot >= size:
        return None
    offset = struct.unpack_from("<H", data, vtable + 4 + 2 * slot)[0]
    return table + offset if offset else None


_Part = tuple[list[str], np.ndarray, np.ndarray, np.ndarray]


def _part(kind: str, track: _Track, time: np.ndarray) -> _Part:
    """Names, places, turns and validity of one topic at the times of the take."""
    if kind == "body":
        names: list[str | None] = [name if name in default_skeleton().points else None for name in BODY_JOINTS]
        position, rotation = ours_from(*_numbers(track.joints))
    else:
        names = [None if name is None else f"{kind}_{name}" for name in HAND_JOINTS]
        axes = hand_axes(default_skeleton(), kind)
        table = np.array([axes.get(name or "", [1.0, 0, 0, 0]) for name in names])
        position, rotation = _numbers(track.joints)
        rotation, position = hand_rotation(rotation, table), position * np.array([-1.0, 1.0, -1.0])
    keep = [k for k, name in enumerate(names) if name is not None]
    position, rotation, valid = position[:, keep], rotation[:, keep], track.joints["valid"][:, keep]
    if kind != "body":
        place, there = _nearest(track.times["sample"] / 1e9, time)
        position, rotation, valid = position[place], rotation[place], valid[place] & there[:, None]
    return [name for name in names if name is not None], position, rotation, valid


def _numbers(joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    with np.errstate(invalid="ignore"):  # of damaged numbers, which are NaN
        return joints["position"].astype(float), joints["rotation"].astype(float)


def _nearest(sampled: np.ndarray, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each time (T,) the nearest sample, and whether it is near: within half an interval."""
    if not len(sampled):
        return np.zeros(len(time), dtype=int), np.zeros(len(time), dtype=bool)
    order = np.argsort(sampled, kind="stable")
    place = np.clip(np.searchsorted(sampled[order], time), 1, max(len(sampled) - 1, 1))
    before, after = order[np.minimum(place - 1, len(sampled) - 1)], order[np.minimum(place, len(sampled) - 1)]
    best = np.where(np.abs(sampled[before] - time) <= np.abs(sampled[after] - time), before, after)
    usual = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    return best, np.abs(sampled[best] - time) <= 0.6 * max(usual, 1e-3)


def _together(parts: list[_Part], points: tuple[str, ...]) -> tuple[np.ndarray, ...]:
    """All topics' points in the order of `points`; of a wrist that comes twice the body's counts."""
    frames = len(parts[0][1])
    position, rotation = np.full((frames, len(points), 3), np.nan), np.full((frames, len(points), 4), np.nan)
    valid, rotated = np.zeros((frames, len(points)), dtype=bool), np.zeros(len(points), dtype=bool)
    for names, places, turns, good in reversed(parts):
        for k, name in enumerate(names):
            point = points.index(name)
            position[:, point], rotation[:, point], valid[:, point] = places[:, k], turns[:, k], good[:, k]
            rotated[point] = not name.endswith("_tip")
    return position, rotation, valid, rotated
