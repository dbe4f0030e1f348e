"""The wire between a client and the server, version 1: dataclasses and bytes, little-endian, no I/O (docs/protocol.md).

Text messages are JSON objects with a `type` (`bodysense_live/server/messages.py`); binary messages are the frames of
this module.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.observing.checks import FARTHEST, UNIT_TOLERANCE

VERSION = 1
SUBPROTOCOL = "bodysense.1"
SIGNAL, POSE, TRUTH = 1, 2, 3  # kinds of frames
CONTACTS = 4  # of a pose: ankles and balls of the feet
HAS_POSITION, HAS_ROTATION = 1, 2  # bits of a point
MOST_POINTS = 128  # of a hello
SIGNAL_HEAD = struct.Struct("<BBHId")  # kind, flags, points, sequence, time in s
POSE_HEAD = struct.Struct("<BBHId")  # kind, flags, joints, sequence, time in s
POINT = np.dtype(
    [("point", "u1"), ("has", "u1"), ("accuracy", "<u2"), ("position", "<f4", (3,)), ("rotation", "<f4", (4,))]
)
ACCURACY_UNIT = 1e-4  # m
LARGEST_SIGNAL = SIGNAL_HEAD.size + MOST_POINTS * POINT.itemsize
_LEAST, _MOST = (1 - 0.99 * UNIT_TOLERANCE) ** 2, (1 + 0.99 * UNIT_TOLERANCE) ** 2  # squares of lengths near enough 1
_LATEST = 1e11  # s: Unix time is 1.7e9 s; in milliseconds it is refused


class ProtocolError(BodysenseError):
    """A message of a peer is unusable; `code` is that of the closing WebSocket frame (RFC 6455, section 7.4)."""

    def __init__(self, reason: str, code: int = 1007) -> None:
        super().__init__(reason)
        self.code = code


@dataclass(frozen=True, eq=False)
class SignalFrame:
    """One moment of tracking: N points, by index in the hello, in the signal's own world."""

    sequence: int
    time: float  # s
    point: np.ndarray  # (N,) u8, place in the points of the hello
    has: np.ndarray  # (N,) u8, HAS_POSITION | HAS_ROTATION
    position: np.ndarray  # (N, 3) f32 m
    rotation: np.ndarray  # (N, 4) f32 wxyz
    # (N,) u16, `ACCURACY_UNIT`s: the expected error of a position; 0 if the device does not know. None: all 0.
    accuracy: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class PoseFrame:
    """The body that answers a signal; as truth (the real motion, in a replay) it ends after its rotations."""

    sequence: int  # of the signal that is answered
    time: float  # s, of that signal
    root_position: np.ndarray  # (3,) m, world
    rotation: np.ndarray  # (J, 4) wxyz, parent ← joint
    expected_error: np.ndarray  # (P,) m
    hidden: np.ndarray  # (P,) probability; 1 if it was not measured
    contact: np.ndarray  # (4,) probability that left and right ankle, left and right ball of the foot rest on something
    microseconds: int = 0  # spent in the server


def wire_accuracy(metres: np.ndarray) -> np.ndarray:
    """Convert accuracies (N,) m to those of a signal frame; NaN becomes 0."""
    return np.clip(np.rint(np.nan_to_num(metres, posinf=FARTHEST) / ACCURACY_UNIT), 0, 0xFFFF).astype("<u2")


def write_signal(frame: SignalFrame) -> bytes:
    """Return the bytes of a signal frame."""
    rows = np.zeros(len(frame.point), dtype=POINT)
    for name in ("point", "has", "position", "rotation"):
        rows[name] = getattr(frame, name)
    if frame.accuracy is not None:
        rows["accuracy"] = frame.accuracy
    return SIGNAL_HEAD.pack(SIGNAL, 0, len(rows), frame.sequence, frame.time) + rows.tobytes()


def signal_time(data: bytes) -> float:
    """Return the time (s) of a signal frame without reading its points. Raises ProtocolError for any other bytes."""
    return _signal_head(data)[2]


def read_signal(data: bytes, points: int) -> SignalFrame:
    """Read the frame of a binary message of a client that named this number of `points`.

    Raises ProtocolError for other bytes, and for implausible numbers: not finite, farther than `FARTHEST` from the
    origin, rotations that are not of unit length.
    """
    count, sequence, time = _signal_head(data)
    rows = np.frombuffer(data, POINT, count, SIGNAL_HEAD.size)
    frame = SignalFrame(
        sequence, time, rows["point"], rows["has"], rows["position"], rows["rotation"], rows["accuracy"]
    )
    if count:
        _check_points(frame, points)
    return frame


def _signal_head(data: bytes) -> tuple[int, int, float]:
    """Return the number of points, the sequence number and the time (s) of a signal frame of the right length."""
    if len(data) < SIGNAL_HEAD.size:
        raise ProtocolError(f"a frame of {len(data)} bytes; its head alone is {SIGNAL_HEAD.size} bytes")
    kind, flags, count, sequence, time = SIGNAL_HEAD.unpack_from(data)
    if kind != SIGNAL or flags:
        raise ProtocolError(f"a frame of kind {kind} with flags {flags}; clients send kind {SIGNAL} with flags 0")
    if len(data) != SIGNAL_HEAD.size + count * POINT.itemsize:
        raise ProtocolError(
            f"a frame of {len(data)} bytes; {count} points take {SIGNAL_HEAD.size + count * POINT.itemsize}"
        )
    if not abs(time) < _LATEST:  # NaN, too
        raise ProtocolError(
            f"a frame at {time:g} s; give seconds of the client's own clock, below {_LATEST:g}, not milliseconds"
        )
    return count, sequence, time


def _check_points(frame: SignalFrame, points: int) -> None:
    """Refuse points that the hello did not name and implausible numbers."""
    point, has = frame.point.tobytes(), frame.has.tobytes()  # bytes are faster to check than small arrays
    if max(point) >= points:
        raise ProtocolError(f"a point with number {max(point)}; the hello named {points}")
    if max(has) > HAS_POSITION | HAS_ROTATION:
        raise ProtocolError(f"a point that has {max(has)}; 1 is a position, 2 a rotation, 3 both")
    if len(set(point)) < len(point):
        raise ProtocolError("a frame names a point twice; give each once")
    # NaN compares false, and squares that overflow are not of unit length.
    with np.errstate(all="ignore"):
        away, size = np.vecdot(frame.position, frame.position), np.vecdot(frame.rotation, frame.rotation)
        if all(one <= FARTHEST**2 for one in away.tolist()) and all(_LEAST < one < _MOST for one in size.tolist()):
            return  # most frames, which need no closer look
        near = np.abs(frame.position) <= FARTHEST
        unit = np.abs(np.sqrt(size) - 1) < UNIT_TOLERANCE
    if not near.all() and not (near.all(axis=1) | (frame.has & HAS_POSITION == 0)).all():
        raise ProtocolError(f"a position that is not finite or beyond {FARTHEST:g} m; give metres, or clear its bit")
    if not unit.all() and not (unit | (frame.has & HAS_ROTATION == 0)).all():
        raise ProtocolError("a rotation that is not of unit length; give w, x, y, z, or clear its bit")


@lru_cache(maxsize=256)
def pose_layout(joints: int, points: int) -> np.dtype:
    """Return the layout of a pose frame of such a skeleton, without padding."""
    return np.dtype(
        [
            ("kind", "u1"),
            ("flags", "u1"),
            ("joints", "<u2"),
            ("sequence", "<u4"),
            ("time", "<f8"),
            ("root_position", "<f4", (3,)),
            ("rotation", "<f4", (joints, 4)),
            ("expected_error", "<f4", (points,)),
            ("hidden", "u1", (points,)),
            ("contact", "u1", (CONTACTS,)),
            ("microseconds", "<u4"),
        ]
    )


def write_pose(frame: PoseFrame, microseconds: int = 0) -> bytes:
    """Return the bytes of a pose frame and the server's time for it."""
    head = POSE_HEAD.pack(POSE, 0, len(frame.rotation), frame.sequence, frame.time)
    probability = (np.concatenate([frame.hidden, frame.contact]) * 255 + 0.5).astype(np.uint8)
    return b"".join(
        (
            head,
            frame.root_position.astype("<f4").tobytes(),
            frame.rotation.astype("<f4").tobytes(),
            frame.expected_error.astype("<f4").tobytes(),
            probability.tobytes(),
            microseconds.to_bytes(4, "little"),
        )
    )


def write_truth(frame: PoseFrame) -> bytes:
    """Return the bytes of a truth frame: a pose frame that ends after its rotations."""
    head = POSE_HEAD.pack(TRUTH, 0, len(frame.rotation), frame.sequence, frame.time)
    return head + frame.root_position.astype("<f4").tobytes() + frame.rotation.astype("<f4").tobytes()


def read_pose(data: bytes, points: int) -> PoseFrame:
    """Read the frame of a pose or a truth of a skeleton with this number of `points`, as a client does.

    Raises ProtocolError for other bytes.
    """
    if len(data) < POSE_HEAD.size or data[0] not in (POSE, TRUTH):
        raise ProtocolError(f"a frame of {len(data)} bytes that is no pose")
    joints = POSE_HEAD.unpack_from(data)[2]
    layout = pose_layout(joints, points)
    truth = data[0] == TRUTH
    wanted = POSE_HEAD.size + 12 + 16 * joints if truth else layout.itemsize
    if len(data) != wanted:
        raise ProtocolError(f"a pose of {len(data)} bytes; {joints} joints and {points} points take {wanted}")
    row = np.frombuffer(data + bytes(layout.itemsize - wanted), layout)[0]
    return PoseFrame(
        int(row["sequence"]),
        float(row["time"]),
        row["root_position"],
        row["rotation"],
        row["expected_error"],
        row["hidden"] / 255,
        row["contact"] / 255,
        int(row["microseconds"]),
    )
