"""SolarXR before SlimeVR 22, with OpenXR runtimes (Monado, WiVRn): requests read, bodies and settings written.

A message is a FlatBuffers `MessageBundle` of `schema/runtime.fbs`. This module opens no sockets.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import flatbuffers
import numpy as np

from bodysense_live.protocols.solarxr.generated import runtime_generated as schema
from bodysense_live.protocols.solarxr.solarxr_body import BodyFrame, BodyLayout

MALFORMED = (struct.error, IndexError, ValueError, TypeError, OverflowError, AttributeError)  # what readers raise
MAX_MESSAGES = 16  # messages read per bundle
_SWITCHED_ON = (  # waist, chest, feet, knees and elbows; hands are off, as controllers track them
    schema.SteamVRTrackersSettingAddWaist,
    schema.SteamVRTrackersSettingAddChest,
    schema.SteamVRTrackersSettingAddLeftFoot,
    schema.SteamVRTrackersSettingAddRightFoot,
    schema.SteamVRTrackersSettingAddLeftKnee,
    schema.SteamVRTrackersSettingAddRightKnee,
    schema.SteamVRTrackersSettingAddLeftElbow,
    schema.SteamVRTrackersSettingAddRightElbow,
)


@dataclass(frozen=True)
class Requests:
    """The requests in a bundle."""

    polls: bool = False  # requests one update
    interval: float | None = None  # s, shortest interval between updates; None: unchanged
    settings: tuple[int | None, ...] = ()  # transaction numbers of settings requests; None: without a number


def read_bundle(packet: bytes) -> Requests | str:
    """Return the requests in a message, or a reason if it is malformed. Unknown requests are ignored."""
    try:
        bundle = schema.MessageBundle.GetRootAs(packet)
        polls, interval, settings = False, None, list[int | None]()
        for message in entries(bundle.DataFeedMsgs, bundle.DataFeedMsgsLength()):
            kind, content = message.MessageType(), message.Message()
            if content is not None and kind == schema.DataFeedMessage.PollDataFeed:
                polls = True
            elif content is not None and kind == schema.DataFeedMessage.StartDataFeed:
                start = of_kind(schema.StartDataFeed, content)
                feeds = entries(start.DataFeeds, start.DataFeedsLength())
                interval = min((feed.MinimumTimeSinceLast() / 1000 for feed in feeds), default=None)
        for message in entries(bundle.RpcMsgs, bundle.RpcMsgsLength()):
            if message.Message() is not None and message.MessageType() == schema.RpcMessage.SettingsRequest:
                number = message.TxId()
                settings.append(None if number is None else number.Id())
        return Requests(polls, interval, tuple(settings))
    except MALFORMED:
        return f"{len(packet)} bytes are not a bundle of SolarXR"


def entries(entry: Callable[[int], Any], length: int) -> Iterator[Any]:
    """Yield the first `MAX_MESSAGES` tables of a vector. Raises IndexError for a table out of bounds."""
    for k in range(min(length, MAX_MESSAGES)):
        found = entry(k)
        if not 0 <= found._tab.Pos < len(found._tab.Bytes):
            raise IndexError("a table is out of bounds")
        yield found


def of_kind(kind: Any, content: Any) -> Any:
    """Return the table of a union as a class of the schema. Raises IndexError if it is out of bounds."""
    if not 0 <= content.Pos < len(content.Bytes):
        raise IndexError("a table is out of bounds")
    found = kind()
    found.Init(content.Bytes, content.Pos)
    return found


class Updates:
    """Updates of constant trackers and bones. The message is built once; each update replaces its numbers."""

    def __init__(self, layout: BodyLayout) -> None:
        self.layout = layout
        self.without_body = _update(layout, with_poses=False)
        self._whole = _update(layout, with_poses=True)
        update = self._update_of(self._whole)
        trackers = [update.SyntheticTrackers(k) for k in range(update.SyntheticTrackersLength())]
        bones = [update.Bones(k) for k in range(update.BonesLength())]
        self._places = PatchedFloats(
            [
                [tracker.Position() for tracker in trackers],
                [tracker.Rotation() for tracker in trackers],
                [bone.HeadPositionG() for bone in bones],
                [bone.RotationG() for bone in bones],
            ],
            (3, 4, 3, 4),
        )

    def packet(self, body: BodyFrame) -> bytes:
        """Return the update of a body."""
        parts = (body.tracker_position, body.tracker_rotation, body.bone_start[:-1], body.bone_rotation[:-1])
        return self._places.patched(self._whole, parts)

    @staticmethod
    def _update_of(packet: bytes) -> Any:
        (message,) = entries(schema.MessageBundle.GetRootAs(packet).DataFeedMsgs, 1)
        return of_kind(schema.DataFeedUpdate, message.Message())


class PatchedFloats:
    """The places of a message's single-precision structs, whose numbers each packet replaces.

    Args:
        structs: structs of the message, part by part.
        sizes: numbers in a struct of each part.
    """

    def __init__(self, structs: Sequence[Sequence[Any]], sizes: Sequence[int]) -> None:
        offsets = [
            np.arange(size) + one._tab.Pos // 4 for part, size in zip(structs, sizes, strict=True) for one in part
        ]
        self._floats = np.concatenate(offsets) if offsets else np.zeros(0, dtype=np.intp)

    def patched(self, message: bytes, parts: Sequence[np.ndarray]) -> bytes:
        """Return the message with the numbers of the parts."""
        found = bytearray(message)
        if len(parts):
            np.frombuffer(found, dtype="<f4")[self._floats] = np.concatenate([part.ravel() for part in parts])
        return bytes(found)


def settings_bundle(transaction: int | None) -> bytes:
    """Return the message that enables trackers; without it runtimes display none."""
    builder = flatbuffers.Builder(256)
    schema.SteamVRTrackersSettingStart(builder)
    for switch_on in _SWITCHED_ON:
        switch_on(builder, True)
    toggles = schema.SteamVRTrackersSettingEnd(builder)
    schema.SettingsResponseStart(builder)
    schema.SettingsResponseAddSteamVrTrackers(builder, toggles)
    response = schema.SettingsResponseEnd(builder)
    schema.RpcMessageHeaderStart(builder)
    if transaction is not None:
        schema.RpcMessageHeaderAddTxId(builder, schema.CreateTransactionId(builder, transaction))
    schema.RpcMessageHeaderAddMessageType(builder, schema.RpcMessage.SettingsResponse)
    schema.RpcMessageHeaderAddMessage(builder, response)
    messages = table_vector(builder, [schema.RpcMessageHeaderEnd(builder)])
    schema.MessageBundleStart(builder)
    schema.MessageBundleAddRpcMsgs(builder, messages)
    return finished(builder, schema.MessageBundleEnd(builder))


def finished(builder: Any, root: int) -> bytes:
    """Return the message of a root table."""
    builder.Finish(root)
    return bytes(builder.Output())


def table_vector(builder: Any, rows: Sequence[int]) -> int:
    """Write a vector of tables."""
    builder.StartVector(4, len(rows), 4)
    for row in reversed(rows):
        builder.PrependUOffsetTRelative(row)
    return builder.EndVector()


def _update(layout: BodyLayout, with_poses: bool) -> bytes:
    """Return an update of all trackers and bones, with poses of zeros, or without poses.

    A bundle has one message: receivers read only the first of each kind.
    """
    builder = flatbuffers.Builder(4096)
    rows = [_tracker(builder, k, *layout.trackers[k], with_poses) for k in range(len(layout.trackers))]
    synthetic = table_vector(builder, rows)
    bones = table_vector(builder, [_bone(builder, *bone, with_poses) for bone in layout.bones[:-1]])
    schema.DataFeedUpdateStart(builder)
    schema.DataFeedUpdateAddSyntheticTrackers(builder, synthetic)
    schema.DataFeedUpdateAddBones(builder, bones)
    update = schema.DataFeedUpdateEnd(builder)
    schema.DataFeedMessageHeaderStart(builder)
    schema.DataFeedMessageHeaderAddMessageType(builder, schema.DataFeedMessage.DataFeedUpdate)
    schema.DataFeedMessageHeaderAddMessage(builder, update)
    messages = table_vector(builder, [schema.DataFeedMessageHeaderEnd(builder)])
    schema.MessageBundleStart(builder)
    schema.MessageBundleAddDataFeedMsgs(builder, messages)
    return finished(builder, schema.MessageBundleEnd(builder))


def _tracker(builder: Any, k: int, body_part: int, name: str, with_pose: bool) -> int:
    text = builder.CreateString(name)
    schema.TrackerInfoStart(builder)
    schema.TrackerInfoAddBodyPart(builder, body_part)
    schema.TrackerInfoAddIsComputed(builder, True)
    schema.TrackerInfoAddDisplayName(builder, text)
    info = schema.TrackerInfoEnd(builder)
    schema.TrackerIdStart(builder)  # no device id: the tracker has no hardware
    schema.TrackerIdAddTrackerNum(builder, k + 1)
    identity = schema.TrackerIdEnd(builder)
    schema.TrackerDataStart(builder)
    schema.TrackerDataAddTrackerId(builder, identity)
    schema.TrackerDataAddInfo(builder, info)
    status = schema.TrackerStatus.OK if with_pose else schema.TrackerStatus.DISCONNECTED
    schema.TrackerDataAddStatus(builder, status)
    if with_pose:
        schema.TrackerDataAddRotation(builder, schema.CreateQuat(builder, 0, 0, 0, 0))
        schema.TrackerDataAddPosition(builder, schema.CreateVec3f(builder, 0, 0, 0))
    return schema.TrackerDataEnd(builder)


def _bone(builder: Any, body_part: int, length: float, with_pose: bool) -> int:
    schema.BoneStart(builder)
    schema.BoneAddBodyPart(builder, body_part)
    schema.BoneAddBoneLength(builder, length)
    if with_pose:
        schema.BoneAddRotationG(builder, schema.CreateQuat(builder, 0, 0, 0, 0))
        schema.BoneAddHeadPositionG(builder, schema.CreateVec3f(builder, 0, 0, 0))
    return schema.BoneEnd(builder)
