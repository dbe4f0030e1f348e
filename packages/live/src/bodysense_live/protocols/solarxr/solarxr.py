"""SolarXR, SlimeVR's protocol with OpenXR runtimes (Monado, WiVRn): requests read, bodies and settings written.

Source: the public schema (SolarXR-Protocol, 2026-04) and its driver in Monado. A message is a FlatBuffers
`MessageBundle`; fields are identified by their slots. This module opens no sockets.

A body consists of synthetic trackers, and of bones that start at the joint nearer to the head. Axes are a driver's: a
segment that hangs down and faces −Z has the identity rotation, and a bone points along its −Y.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bodysense.body.skeleton import Skeleton
from bodysense.errors import missing_package
from bodysense.geometry.products import multiply, rotate
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply, shortest_arc
from bodysense_live.protocols.driver_axes import ABOUT_Y
from bodysense_live.protocols.virtual_trackers import TURNED_BY

POLL, START, UPDATE = 1, 2, 3  # kinds of data feed messages
SETTINGS_REQUEST, SETTINGS_RESPONSE = 6, 7  # kinds of RPC messages
DISCONNECTED, OK = 1, 2  # states of a tracker
_MAX_MESSAGES = 16  # messages read per bundle
_SETTINGS = {0: True, 1: True, 7: True, 8: True, 9: True, 10: True, 11: True, 12: True, 13: False, 14: False}
# slot of a toggle → state: waist, chest, feet, knees and elbows are on; hands are off, as controllers track them


@dataclass(frozen=True)
class Requests:
    """The requests in a bundle."""

    polls: bool = False  # requests one update
    interval: float | None = None  # s, shortest interval between updates; None: unchanged
    settings: tuple[int | None, ...] = ()  # transaction numbers of settings requests; None: without a number


@dataclass(frozen=True)
class BodyLayout:
    """The constant part of updates: trackers (body part, name) and bones (body part, length in m)."""

    trackers: tuple[tuple[int, str], ...]
    bones: tuple[tuple[int, float], ...]


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """The part that changes with every update: positions in m and rotations xyzw, in the runtime's world."""

    tracker_position: np.ndarray  # (T, 3)
    tracker_rotation: np.ndarray  # (T, 4)
    bone_start: np.ndarray  # (B, 3)
    bone_rotation: np.ndarray  # (B, 4)


def read_bundle(packet: bytes) -> Requests | str:
    """Return the requests in a message, or a reason if it is malformed. Unknown requests are ignored."""
    try:
        root = _root(packet)
        polls, interval, settings = False, None, list[int | None]()
        for message in _tables(root, 0):
            kind, inside = _union(message, 0)
            if inside is not None and kind == POLL:
                polls = True
            elif inside is not None and kind == START:
                feeds = _tables(inside, 0)
                interval = min((_number(feed, 0, "<H") for feed in feeds), default=0) / 1000 if feeds else None
        for message in _tables(root, 1):
            kind, inside = _union(message, 1)
            if inside is not None and kind == SETTINGS_REQUEST:
                at = _field_offset(message, 0)
                settings.append(None if at is None else int(struct.unpack_from("<I", packet, at)[0]))
        return Requests(polls, interval, tuple(settings))
    except (struct.error, IndexError, ValueError, TypeError, OverflowError):
        return f"{len(packet)} bytes are not a bundle of SolarXR"


def _root(packet: bytes) -> Any:
    from flatbuffers.table import Table

    return Table(packet, struct.unpack_from("<I", packet)[0])


def _field_offset(table: Any, slot: int) -> int | None:
    """Return the byte offset of a field; None for a missing field. Raises struct.error if it is out of bounds."""
    offset = table.Offset(4 + 2 * slot)
    if not offset:
        return None
    at = int(table.Pos + offset)
    if not 0 <= at < len(table.Bytes):
        raise struct.error("a field is out of bounds")
    return at


def _number(table: Any, slot: int, form: str) -> int:
    at = _field_offset(table, slot)
    return 0 if at is None else int(struct.unpack_from(form, table.Bytes, at)[0])


def _table_at(table: Any, at: int) -> Any:
    """Return the table to which the offset at a byte points."""
    from flatbuffers.table import Table

    there = at + struct.unpack_from("<I", table.Bytes, at)[0]
    if not 0 <= there < len(table.Bytes):
        raise struct.error("a table is out of bounds")
    return Table(table.Bytes, there)


def _tables(table: Any, slot: int, most: int = _MAX_MESSAGES) -> list[Any]:
    """Return the first tables of a vector."""
    at = _field_offset(table, slot)
    if at is None:
        return []
    vector = _table_at(table, at).Pos
    count = struct.unpack_from("<I", table.Bytes, vector)[0]
    return [_table_at(table, vector + 4 + 4 * k) for k in range(min(count, most))]


def _union(table: Any, slot: int) -> tuple[int, Any]:
    """Return kind and table of a union, which has two slots."""
    at = _field_offset(table, slot + 1)
    return _number(table, slot, "<B"), None if at is None else _table_at(table, at)


class Updates:
    """Updates of constant trackers and bones. The message is built once; each update replaces its numbers.

    Raises BodysenseError if flatbuffers is missing.
    """

    def __init__(self, layout: BodyLayout) -> None:
        self.layout = layout
        self.without_body = _update(layout, None)
        count, bones = len(layout.trackers), len(layout.bones)
        still = BodyFrame(np.zeros((count, 3)), np.zeros((count, 4)), np.zeros((bones, 3)), np.zeros((bones, 4)))
        self._whole = _update(layout, still)
        update = _update_of(self._whole)
        offsets = [
            *((_field_offset(row, 4), 3) for row in _tables(update, 1, count)),
            *((_field_offset(row, 3), 4) for row in _tables(update, 1, count)),
            *((_field_offset(row, 3), 3) for row in _tables(update, 2, bones)),
            *((_field_offset(row, 1), 4) for row in _tables(update, 2, bones)),
        ]
        self._floats = np.concatenate([np.arange(size) + (at or 0) // 4 for at, size in offsets])

    def packet(self, body: BodyFrame) -> bytes:
        """Return the update of a body."""
        message = bytearray(self._whole)
        values = [
            part.ravel()
            for part in (
                body.tracker_position,
                body.tracker_rotation,
                body.bone_start,
                body.bone_rotation,
            )
        ]
        np.frombuffer(message, dtype="<f4")[self._floats] = np.concatenate(values)
        return bytes(message)


def _update(layout: BodyLayout, body: BodyFrame | None) -> bytes:
    """Return an update of all trackers and bones; without poses if the body is None."""
    builder = _builder()
    rows = [_tracker(builder, k, *layout.trackers[k], body) for k in range(len(layout.trackers))]
    drawn = [_bone(builder, k, *layout.bones[k], body) for k in range(len(layout.bones))]
    synthetic, skeleton = _vector(builder, rows), _vector(builder, drawn)
    builder.StartObject(6)
    builder.PrependUOffsetTRelativeSlot(1, synthetic, 0)
    builder.PrependUOffsetTRelativeSlot(2, skeleton, 0)
    update = builder.EndObject()
    builder.StartObject(2)
    builder.PrependUint8Slot(0, UPDATE, 0)
    builder.PrependUOffsetTRelativeSlot(1, update, 0)
    return _bundle(builder, 0, builder.EndObject())


def _update_of(packet: bytes) -> Any:
    """Return the table of the update in a bundle."""
    return _union(_tables(_root(packet), 0)[0], 0)[1]


def settings_bundle(transaction: int | None) -> bytes:
    """Return the message that enables trackers; without it runtimes display none."""
    builder = _builder()
    builder.StartObject(15)
    for slot, is_on in _SETTINGS.items():
        builder.PrependBoolSlot(slot, is_on, False)
    toggles = builder.EndObject()
    builder.StartObject(1)
    builder.PrependUOffsetTRelativeSlot(0, toggles, 0)
    response = builder.EndObject()
    builder.StartObject(3)
    if transaction is not None:
        builder.Prep(4, 4)
        builder.PrependUint32(transaction)
        builder.PrependStructSlot(0, builder.Offset(), 0)
    builder.PrependUint8Slot(1, SETTINGS_RESPONSE, 0)
    builder.PrependUOffsetTRelativeSlot(2, response, 0)
    return _bundle(builder, 1, builder.EndObject())


def _builder() -> Any:
    try:
        from flatbuffers import Builder
    except ImportError as error:
        raise missing_package(error) from None
    return Builder(4096)


def _bundle(builder: Any, slot: int, message: int) -> bytes:
    """Return a bundle of one message; receivers read only the first of each kind."""
    messages = _vector(builder, [message])
    builder.StartObject(3)
    builder.PrependUOffsetTRelativeSlot(slot, messages, 0)
    builder.Finish(builder.EndObject())
    return bytes(builder.Output())


def _vector(builder: Any, rows: Sequence[int]) -> int:
    builder.StartVector(4, len(rows), 4)
    for row in reversed(rows):
        builder.PrependUOffsetTRelative(row)
    return builder.EndVector()


def _floats(builder: Any, slot: int, values: np.ndarray) -> None:
    """Write an inline struct of single-precision numbers into a table."""
    builder.Prep(4, 4 * len(values))
    for value in reversed(values.tolist()):
        builder.PrependFloat32(value)
    builder.PrependStructSlot(slot, builder.Offset(), 0)


def _tracker(builder: Any, k: int, body_part: int, name: str, body: BodyFrame | None) -> int:
    text = builder.CreateString(name)
    builder.StartObject(12)
    builder.PrependUint8Slot(1, body_part, 0)
    builder.PrependBoolSlot(5, True, False)  # is_computed
    builder.PrependUOffsetTRelativeSlot(7, text, 0)
    info = builder.EndObject()
    builder.StartObject(2)  # no device id: the tracker has no hardware
    builder.PrependUint8Slot(1, k + 1, 0)
    identity = builder.EndObject()
    builder.StartObject(13)
    builder.PrependUOffsetTRelativeSlot(0, identity, 0)
    builder.PrependUOffsetTRelativeSlot(1, info, 0)
    builder.PrependUint8Slot(2, DISCONNECTED if body is None else OK, 0)
    if body is not None:
        _floats(builder, 3, body.tracker_rotation[k])
        _floats(builder, 4, body.tracker_position[k])
    return builder.EndObject()


def _bone(builder: Any, k: int, body_part: int, length: float, body: BodyFrame | None) -> int:
    builder.StartObject(4)
    builder.PrependUint8Slot(0, body_part, 0)
    builder.PrependFloat32Slot(2, length, 0.0)
    if body is not None:
        _floats(builder, 1, body.bone_rotation[k])
        _floats(builder, 3, body.bone_start[k])
    return builder.EndObject()


Places = Mapping[str, np.ndarray]  # by the names of points or joints
_DOWN = np.array([0.0, -1.0, 0.0])
# Our identity rotation is a level arm, SolarXR's a hanging one.
_HANGING = {side: quaternion_exp(np.array([0.0, 0.0, sign * np.pi / 2])) for side, sign in (("left", 1), ("right", -1))}
TRACKERS: tuple[tuple[int, str, str], ...] = (  # body part, name, point
    (5, "waist", "pelvis"),
    (22, "chest", "spine3"),
    (10, "left foot", "left_ankle"),
    (11, "right foot", "right_ankle"),
    (6, "left knee", "left_knee"),
    (7, "right knee", "right_knee"),
    (16, "left elbow", "left_elbow"),
    (17, "right elbow", "right_elbow"),
)


@dataclass(frozen=True)
class _Bone:
    body_part: int
    start: str
    end: str
    joint: str  # the bone has its rotation
    rest: tuple[float, float, float] = (0.0, -1.0, 0.0)  # direction if the body stands and faces −Z


def _sided(number: int, start: str, end: str, joint: str, rest: tuple[float, float, float] = (0, -1, 0)) -> list[_Bone]:
    """Return the left and right bone; the right one's body part is `number + 1`."""
    x, y, z = rest
    return [
        _Bone(number + k, f"{side}_{start}", f"{side}_{end}", f"{side}_{joint}", (sign * x, y, z))
        for k, side, sign in ((0, "left", 1), (1, "right", -1))
    ]


BONES: tuple[_Bone, ...] = (
    _Bone(2, "head", "neck", "neck"),
    _Bone(22, "neck", "spine3", "spine3"),
    _Bone(3, "spine3", "spine2", "spine2"),
    _Bone(4, "spine2", "spine1", "spine1"),
    _Bone(5, "spine1", "pelvis", "pelvis"),
    *_sided(20, "collar", "shoulder", "collar", (-1, 0, 0)),
    *_sided(16, "shoulder", "elbow", "shoulder"),
    *_sided(14, "elbow", "wrist", "elbow"),
    *_sided(18, "wrist", "middle1", "wrist"),
    *_sided(6, "hip", "knee", "hip"),
    *_sided(8, "knee", "ankle", "knee"),
    *_sided(10, "ankle", "foot", "ankle", (0, 0, -1)),
)
_HEAD = 1  # from between the eyes back to the joint
_ARM_JOINTS = ("shoulder", "elbow", "wrist")
_TRACKER_POINTS = [point for _, _, point in TRACKERS]
_STARTS, _ENDS = [bone.start for bone in BONES], [bone.end for bone in BONES]
_JOINTS = [*(TURNED_BY[point] for point in _TRACKER_POINTS), "head", *(bone.joint for bone in BONES)]
_REST = np.array([(0.0, 0.0, 1.0), *(bone.rest for bone in BONES)])  # (1 + B, 3)


def _to_segment(joint: str) -> np.ndarray:
    """Return the rotation (4,) wxyz from a joint's axes to its segment's axes in a driver's world."""
    side, _, part = joint.partition("_")
    return quaternion_multiply(_HANGING[side], ABOUT_Y) if part in _ARM_JOINTS else ABOUT_Y


_SEGMENTS = np.array([_to_segment(joint) for joint in _JOINTS])
_TO_BONE = np.asarray(shortest_arc(np.broadcast_to(_DOWN, _REST.shape), _REST))


def body_layout(skeleton: Skeleton, eyes: np.ndarray) -> BodyLayout:
    """Return trackers and bone lengths of a body. `eyes`: point between the eyes, (3,) m from the head's joint."""
    rest = skeleton.path @ skeleton.rest_offset
    apart = np.linalg.norm(rest[skeleton.indices(_ENDS)] - rest[skeleton.indices(_STARTS)], axis=1)
    bones = zip((bone.body_part for bone in BONES), apart.tolist(), strict=True)
    trackers = tuple((part, name) for part, name, _ in TRACKERS)
    return BodyLayout(trackers, ((_HEAD, float(np.linalg.norm(eyes))), *bones))


def body_frame(points: Places, turns: Places, eyes: np.ndarray) -> BodyFrame:
    """Return the poses of trackers and bones from positions (3,) m and rotations (4,) wxyz in the runtime's world."""
    segments = multiply(np.array([turns[joint] for joint in _JOINTS]), _SEGMENTS)
    at_eyes = points["head"] + rotate(turns["head"][None], eyes[None])[0]
    start = np.array([at_eyes, *(points[name] for name in _STARTS)])
    direction = np.array([points["head"], *(points[name] for name in _ENDS)]) - start
    turned = multiply(segments[len(TRACKERS) :], _TO_BONE)
    now = rotate(turned, _DOWN[None])
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-9)
    return BodyFrame(
        tracker_position=np.array([points[name] for name in _TRACKER_POINTS]),
        tracker_rotation=_to_xyzw(segments[: len(TRACKERS)]),
        bone_start=start,
        bone_rotation=_to_xyzw(multiply(np.asarray(shortest_arc(now, direction)), turned)),
    )


def _to_xyzw(rotation: np.ndarray) -> np.ndarray:
    return np.roll(rotation, -1, axis=-1)
