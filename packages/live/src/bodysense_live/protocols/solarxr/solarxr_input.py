"""Headset and controllers that an OpenXR runtime sends to SlimeVR's server: protobuf messages, read without a library.

Source: SlimeVR's driver protocol (`ProtobufMessages.proto`) and its sender in Monado. A controller is sent with its
pointing pose, not its grip pose, so only its position is used.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

from bodysense_live.protocols.driver_axes import from_driver_rotation
from bodysense_live.sessions.tracked_devices import DeviceReader, DeviceState, TrackedDevice, pose_of

LARGEST = 1024  # bytes of a message
_POSITION, _ADDED, _STATUS = 1, 3, 4  # numbers of the fields that name the kind of a message
_ROLES = {19: ("Hmd", "HMD"), 13: ("Con", "left controller"), 14: ("Con", "right controller")}
_MAX_ADDED = 64
_TRACKED = 1
Value = int | float | bytes


@dataclass(frozen=True, eq=False)
class InputState:
    """The devices received so far."""

    roles: Mapping[int, int] = field(default_factory=dict)  # by id
    lost: frozenset[int] = frozenset()  # ids of devices that are lost
    devices: DeviceState = DeviceState()


@dataclass(frozen=True)
class InputReader(DeviceReader):
    """The decoder of a runtime's messages."""

    initial_state: ClassVar = InputState()

    def take(self, packet: bytes, now: float, state: InputState) -> tuple[InputState, str | None]:
        """Read a message received at `now` s. Return the next state, and a reason if the message is invalid."""
        try:
            for number, value in read_fields(packet).items():
                if not isinstance(value, bytes):
                    continue
                fields = read_fields(value)
                identity = _integer(fields.get(1))
                if number == _ADDED and len(state.roles) < _MAX_ADDED:
                    state = replace(state, roles={**state.roles, identity: _integer(fields.get(4))})
                elif number == _STATUS:
                    is_lost = _integer(fields.get(2)) != _TRACKED
                    state = replace(state, lost=state.lost | {identity} if is_lost else state.lost - {identity})
                elif number == _POSITION:
                    return self._read_position(fields, identity, now, state)
        except ValueError as error:
            return state, str(error)
        return state, None

    def _read_position(
        self, fields: Mapping[int, Value], identity: int, now: float, state: InputState
    ) -> tuple[InputState, str | None]:
        role = _ROLES.get(state.roles.get(identity, 0))
        if role is None or identity in state.lost or not {2, 3, 4} <= fields.keys():
            return state, None
        numbers = [fields.get(k, 0.0) for k in range(2, 9)]
        if not all(isinstance(value, float) for value in numbers):
            return state, "a position is not of floats"
        pose = pose_of(numbers, "a position")
        if isinstance(pose, str):
            return state, pose
        (place, turn), (kind, serial) = pose, role
        rotation = None if turn is None or kind != "Hmd" else from_driver_rotation(turn)
        devices, reason = self.devices.put(
            [(serial, TrackedDevice(kind, place, rotation, now, raw=True))], state.devices
        )
        return replace(state, devices=devices), reason


def read_fields(data: bytes) -> dict[int, Value]:
    """Return the fields of a protobuf message by number, the last of each. Raises ValueError for malformed bytes."""
    found: dict[int, Value] = {}
    place = 0
    while place < len(data):
        key, place = _varint(data, place)
        number, kind = key >> 3, key & 7
        if kind == 0:
            found[number], place = _varint(data, place)
        elif kind in (1, 5):
            size, form = (8, "<d") if kind == 1 else (4, "<f")
            if place + size > len(data):
                raise ValueError("a number is cut off")
            found[number] = float(struct.unpack_from(form, data, place)[0])
            place += size
        elif kind == 2:
            size, place = _varint(data, place)
            if place + size > len(data):
                raise ValueError("a field is cut off")
            found[number] = data[place : place + size]
            place += size
        else:
            raise ValueError(f"a field has the unknown wire type {kind}")
    return found


def _varint(data: bytes, place: int) -> tuple[int, int]:
    """Return a number and the offset behind it."""
    value = 0
    for k, byte in enumerate(data[place : place + 10]):
        value |= (byte & 127) << 7 * k
        if byte < 128:
            return value, place + k + 1
    raise ValueError("a number is cut off")


def _integer(value: Value | None) -> int:
    return value if isinstance(value, int) else 0
