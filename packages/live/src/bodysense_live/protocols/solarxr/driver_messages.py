"""SolarXR's driver interface of SlimeVR 22: its messages, and the bones that drivers receive.

A message is a FlatBuffers `MessageBundle` of `schema/driver.fbs`. This module opens no sockets.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import flatbuffers
import numpy as np

from bodysense.geometry.products import multiply, rotate
from bodysense.geometry.rotation import quaternion_conjugate
from bodysense_live.protocols.solarxr.generated import driver_generated as schema
from bodysense_live.protocols.solarxr.runtime_messages import (
    MALFORMED,
    PatchedFloats,
    entries,
    finished,
    of_kind,
    table_vector,
)
from bodysense_live.protocols.solarxr.solarxr_body import BONES, HIP, TO_BONE, BodyFrame, BodyLayout

VERSION = 2  # of the protocol, as SlimeVR's server 22 has it
PARENTS: dict[str, str | None] = {  # SlimeVR's standard bones in the order of their ids: name → parent
    "head": None,
    "neck": "head",
    "upper_chest": "neck",
    "lower_chest": "upper_chest",
    "upper_waist": "lower_chest",
    "lower_waist": "upper_waist",
    "hip": "lower_waist",
    **{
        f"{side}_{bone}": f"{side}_{parent}" if sided else parent
        for bone, parent, sided in (
            ("upper_leg", "hip", False),
            ("lower_leg", "upper_leg", True),
            ("foot", "lower_leg", True),
            ("upper_arm", "shoulder", True),
            ("lower_arm", "upper_arm", True),
            ("hand", "lower_arm", True),
            ("shoulder", "neck", False),
        )
        for side in ("left", "right")
    },
}
BONE_IDS = {name: k for k, name in enumerate(PARENTS, start=1)}
_ROWS = {"hip": HIP, **{bone.key: bone for bone in BONES}}
_ORDER = [0, *(1 + (*BONES, HIP).index(_ROWS[name]) for name in list(PARENTS)[1:])]  # rows of a body's frame
_FROM_BONE = quaternion_conjugate(TO_BONE)[_ORDER]  # (21, 4) wxyz


@dataclass(frozen=True)
class BoneParts:
    """The parts of bones that a driver requests."""

    length: bool = False
    rotation: bool = False
    orientation: bool = False
    start: bool = False
    end: bool = False


@dataclass(frozen=True)
class Request:
    """One message of a driver, by its fields that are used."""

    kind: str  # a key of `CONNECTION` or `DRIVER`, or "" for an unknown message
    number: int = 0  # of the request, 0 without one
    version: int = 0
    name: str = ""  # of the driver, or the identifier of a tracker's hardware
    mask: BoneParts | None = None
    bone: int = 0
    tracker: int = 0
    status: int = 0
    position: tuple[float, ...] | None = None  # m
    rotation: tuple[float, ...] | None = None  # xyzw


def is_hello(packet: bytes) -> bool:
    """Return whether a connection's first message opens the protocol of SlimeVR 22.

    An older client starts with a data feed's message in the same place: its field is an offset, a multiple of 4.
    """
    try:
        bundle = schema.MessageBundle.GetRootAs(packet)
        message = next(entries(bundle.ConnectionMsgs, bundle.ConnectionMsgsLength()), None)
        if message is None or message.MessageType() != schema.ConnectionMessage.ClientHello:
            return False
        version = of_kind(schema.ClientHello, message.Message()).ProtocolVersion()
        return 0 < version < 4 or version % 4 != 0
    except MALFORMED:
        return False


def read_requests(packet: bytes) -> list[Request] | str:
    """Return the messages in a bundle, or a reason if it is malformed."""
    try:
        bundle, found = schema.MessageBundle.GetRootAs(packet), list[Request]()
        for message in entries(bundle.ConnectionMsgs, bundle.ConnectionMsgsLength()):
            kind = _CONNECTION.get(message.MessageType(), "")
            version = of_kind(schema.ClientHello, message.Message()).ProtocolVersion() if kind == "hello" else 0
            found.append(Request(kind, version=version))
        for message in entries(bundle.DriverMsgs, bundle.DriverMsgsLength()):
            reader = _DRIVER.get(message.MessageType())
            if reader is not None and message.Message() is not None:
                found.append(replace(reader(message.Message()), number=message.TxId()))
        return found
    except MALFORMED:
        return f"{len(packet)} bytes are not a bundle of SolarXR"


_CONNECTION = {
    schema.ConnectionMessage.ClientHello: "hello",
    schema.ConnectionMessage.BoneRegistryRequest: "registry",
    schema.ConnectionMessage.ConfigurationDone: "configured",
}


def _read_registration(content: Any) -> Request:
    message = of_kind(schema.RegisterDriver, content)
    mask = message.BoneMask()
    parts = None
    if mask is not None:
        parts = BoneParts(
            mask.BoneLength(), mask.Rotation(), mask.Orientation(), mask.HeadPosition(), mask.TailPosition()
        )
    return Request("register", name=_text(message.DriverName()), mask=parts)


def _read_tracker(content: Any) -> Request:
    message = of_kind(schema.AddTrackerRequest, content)
    return Request("add", name=_text(message.HardwareIdentifier()), bone=message.BoneId())


def _read_status(content: Any) -> Request:
    message = of_kind(schema.UpdateTrackerStatus, content)
    return Request("status", tracker=message.TrackerId(), status=message.Status())


def _read_pose(content: Any) -> Request:
    message = of_kind(schema.UpdateTrackerPosition, content)
    place, turn = message.Position(), message.Rotation()
    return Request(
        "pose",
        tracker=message.TrackerId(),
        position=None if place is None else (place.X(), place.Y(), place.Z()),
        rotation=None if turn is None else (turn.X(), turn.Y(), turn.Z(), turn.W()),
    )


_DRIVER: dict[int, Callable[[Any], Request]] = {
    schema.DriverMessage.RegisterDriver: _read_registration,
    schema.DriverMessage.AddTrackerRequest: _read_tracker,
    schema.DriverMessage.UpdateTrackerStatus: _read_status,
    schema.DriverMessage.UpdateTrackerPosition: _read_pose,
}


def _text(text: bytes | None) -> str:
    return "" if text is None else text.decode("utf-8")


def server_hello(is_accepted: bool) -> bytes:
    """Return the answer to a hello, with the version that is served."""
    builder = flatbuffers.Builder(64)
    status = schema.HelloStatus.ACCEPTED if is_accepted else schema.HelloStatus.REJECTED_UNSUPPORTED_VERSION
    schema.ServerHelloStart(builder)
    schema.ServerHelloAddStatus(builder, status)
    schema.ServerHelloAddProtocolVersion(builder, VERSION)
    return _connection(builder, schema.ConnectionMessage.ServerHello, schema.ServerHelloEnd(builder))


def bone_registry() -> bytes:
    """Return the names, ids and parents of bones."""
    builder, rows = flatbuffers.Builder(2048), list[int]()
    for name, parent in PARENTS.items():
        key, title = builder.CreateString(f"slimevr:{name}"), builder.CreateString(name.replace("_", " "))
        schema.BoneDefinitionStart(builder)
        schema.BoneDefinitionAddId(builder, BONE_IDS[name])
        schema.BoneDefinitionAddKey(builder, key)
        schema.BoneDefinitionAddDisplayName(builder, title)
        schema.BoneDefinitionAddParent(builder, 0 if parent is None else BONE_IDS[parent])
        rows.append(schema.BoneDefinitionEnd(builder))
    bones = table_vector(builder, rows)
    schema.BoneRegistryStart(builder)
    schema.BoneRegistryAddBones(builder, bones)
    return _connection(builder, schema.ConnectionMessage.BoneRegistry, schema.BoneRegistryEnd(builder))


def configuration_done() -> bytes:
    """Return the message that ends the configuration of a connection."""
    builder = flatbuffers.Builder(64)
    schema.ConfigurationDoneStart(builder)
    return _connection(builder, schema.ConnectionMessage.ConfigurationDone, schema.ConfigurationDoneEnd(builder))


def connection_error(text: str) -> bytes:
    """Return the answer to a message that came too early in a connection."""
    builder = flatbuffers.Builder(128)
    message = builder.CreateString(text)
    schema.InitializationRequiredErrorStart(builder)
    data = schema.InitializationRequiredErrorEnd(builder)
    schema.ConnectionErrorStart(builder)
    schema.ConnectionErrorAddMessage(builder, message)
    schema.ConnectionErrorAddDataType(builder, schema.ConnectionErrorData.InitializationRequiredError)
    schema.ConnectionErrorAddData(builder, data)
    return _connection(builder, schema.ConnectionMessage.ConnectionError, schema.ConnectionErrorEnd(builder))


def registration_available() -> bytes:
    """Return the message that admits registrations of drivers."""
    builder = flatbuffers.Builder(64)
    schema.RegistrationAvailableStart(builder)
    return _driver(builder, schema.DriverMessage.RegistrationAvailable, schema.RegistrationAvailableEnd(builder))


def registration_response(status: int, reply_to: int) -> bytes:
    """Return the answer to a registration: a `RegistrationStatus`."""
    builder = flatbuffers.Builder(64)
    schema.DriverRegistrationResponseStart(builder)
    schema.DriverRegistrationResponseAddStatus(builder, status)
    content = schema.DriverRegistrationResponseEnd(builder)
    return _driver(builder, schema.DriverMessage.DriverRegistrationResponse, content, reply_to)


def tracker_response(status: int, tracker: int, reply_to: int) -> bytes:
    """Return the answer to a new tracker: an `AddTrackerStatus`, and the tracker's id."""
    builder = flatbuffers.Builder(64)
    schema.AddTrackerResponseStart(builder)
    schema.AddTrackerResponseAddStatus(builder, status)
    schema.AddTrackerResponseAddTrackerId(builder, tracker)
    content = schema.AddTrackerResponseEnd(builder)
    return _driver(builder, schema.DriverMessage.AddTrackerResponse, content, reply_to)


class SkeletonUpdates:
    """Updates of a body's bones for drivers. The message is built once; each update replaces its numbers."""

    def __init__(self, layout: BodyLayout, mask: BoneParts) -> None:
        self._lengths, self._mask = np.array([length for _, length in layout.bones])[_ORDER], mask
        lengths = self._lengths if mask.length else None
        self.without_body = _skeleton(BoneParts(), lengths)
        self._whole = _skeleton(mask, lengths)
        (message,) = entries(schema.MessageBundle.GetRootAs(self._whole).DriverMsgs, 1)
        update = of_kind(schema.SkeletonUpdate, message.Message())
        bones = [update.Bones(k) for k in range(update.BonesLength())]
        parts = [
            *([[bone.Rotation() for bone in bones]] if mask.rotation else []),
            *([[bone.Orientation() for bone in bones]] if mask.orientation else []),
            *([[bone.HeadPosition() for bone in bones]] if mask.start else []),
            *([[bone.TailPosition() for bone in bones]] if mask.end else []),
        ]
        self._places = PatchedFloats(parts, [4] * (mask.rotation + mask.orientation) + [3] * (mask.start + mask.end))

    def packet(self, body: BodyFrame) -> bytes:
        """Return the update of a body."""
        orientation, start = np.roll(body.bone_rotation[_ORDER], 1, axis=-1), body.bone_start[_ORDER]
        parts = [
            *([np.roll(multiply(orientation, _FROM_BONE), -1, axis=-1)] if self._mask.rotation else []),
            *([body.bone_rotation[_ORDER]] if self._mask.orientation else []),
            *([start] if self._mask.start else []),
            *([start + rotate(orientation, np.outer(self._lengths, _DOWN))] if self._mask.end else []),
        ]
        return self._places.patched(self._whole, parts)


_DOWN = (0.0, -1.0, 0.0)


def _skeleton(mask: BoneParts, lengths: np.ndarray | None) -> bytes:
    """Return an update of all bones with numbers of zero in the parts of a mask."""
    builder, rows = flatbuffers.Builder(4096), list[int]()
    for k, identity in enumerate(BONE_IDS.values()):
        schema.BoneStart(builder)
        schema.BoneAddId(builder, identity)
        if lengths is not None:
            schema.BoneAddBoneLength(builder, float(lengths[k]))
        if mask.rotation:
            schema.BoneAddRotation(builder, schema.CreateQuat(builder, 0, 0, 0, 0))
        if mask.orientation:
            schema.BoneAddOrientation(builder, schema.CreateQuat(builder, 0, 0, 0, 0))
        if mask.start:
            schema.BoneAddHeadPosition(builder, schema.CreateVec3f(builder, 0, 0, 0))
        if mask.end:
            schema.BoneAddTailPosition(builder, schema.CreateVec3f(builder, 0, 0, 0))
        rows.append(schema.BoneEnd(builder))
    bones = table_vector(builder, rows)
    schema.SkeletonUpdateStart(builder)
    schema.SkeletonUpdateAddBones(builder, bones)
    return _driver(builder, schema.DriverMessage.SkeletonUpdate, schema.SkeletonUpdateEnd(builder))


def _connection(builder: Any, kind: int, content: int) -> bytes:
    """Return a bundle of one message of the connection."""
    schema.ConnectionMessageHeaderStart(builder)
    schema.ConnectionMessageHeaderAddMessageType(builder, kind)
    schema.ConnectionMessageHeaderAddMessage(builder, content)
    messages = table_vector(builder, [schema.ConnectionMessageHeaderEnd(builder)])
    schema.MessageBundleStart(builder)
    schema.MessageBundleAddConnectionMsgs(builder, messages)
    return finished(builder, schema.MessageBundleEnd(builder))


def _driver(builder: Any, kind: int, content: int, reply_to: int = 0) -> bytes:
    """Return a bundle of one message to a driver."""
    schema.DriverMessageHeaderStart(builder)
    schema.DriverMessageHeaderAddReplyTo(builder, reply_to)
    schema.DriverMessageHeaderAddMessageType(builder, kind)
    schema.DriverMessageHeaderAddMessage(builder, content)
    messages = table_vector(builder, [schema.DriverMessageHeaderEnd(builder)])
    schema.MessageBundleStart(builder)
    schema.MessageBundleAddDriverMsgs(builder, messages)
    return finished(builder, schema.MessageBundleEnd(builder))
