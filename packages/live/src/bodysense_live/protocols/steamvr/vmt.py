"""SteamVR by VMT (Virtual Motion Tracker), OSC over UDP: devices are read from it, virtual trackers written to it.

Source: VMT's documentation, *API*, and its driver, which accepts only the documented types and numbers of arguments.
No sockets here. Positions and rotations are in the driver's raw space: right-handed, −Z forward.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from bodysense.io.formats.osc import Message, PacketForm, message_bytes, read_packet
from bodysense_live.protocols.driver_axes import driver_rotation, from_driver_rotation
from bodysense_live.protocols.virtual_trackers import TURNED_BY
from bodysense_live.sessions.tracked_devices import DeviceReader, DeviceState, TrackedDevice, pose_of

DRIVER_PORT = 39570  # UDP, of the driver
LAST_INDEX = 57  # largest index of a virtual device
OFF, TRACKER, LEFT_HAND, RIGHT_HAND = 0, 1, 5, 6  # kinds of virtual devices; hands as an Index controller's
_OURS = "VMT_"  # prefix of serials of virtual devices
_BASE_STATIONS = ("LHB-",)  # prefixes of their serials
_LONGEST_LIST = 4096  # characters of a list of devices
_SEVEN = 7 * "f"
_IDENTITY_ROOM = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class VmtState:
    """The devices and serials received so far."""

    devices: DeviceState = DeviceState()
    headset: str = "HMD"  # its serial
    others: tuple[str, ...] = ()  # serials of other devices, without VMT's own and base stations
    lacks_room: bool = False  # VMT reports that it has no room matrix, and displays nothing


@dataclass(frozen=True)
class VmtReader(DeviceReader):
    """The decoder of the driver's packets."""

    initial_state: ClassVar = VmtState()

    def take(self, packet: bytes, now: float, state: VmtState) -> tuple[VmtState, str | None]:
        """Read a packet received at `now` s. Return the next state, and a reason if any of it is invalid."""
        messages = read_packet(packet)
        if isinstance(messages, str):
            return state, messages
        poses: list[tuple[str, TrackedDevice]] = []
        wrong: str | None = None
        for message in messages:
            if message.address == "/VMT/Out/Devices/List":
                state = _with_list(message, state)
            elif message.address == "/VMT/Out/Unavailable":
                state = replace(state, lacks_room=message.arguments[:1] == (1,))
            elif message.address == "/VMT/Out/SubscribedDevice":
                found = self._device(message, now, state)
                if isinstance(found, str):
                    wrong = found
                else:
                    poses.append(found)
        devices, reason = self.devices.put(poses, state.devices)
        return replace(state, devices=devices), reason or wrong

    def _device(self, message: Message, now: float, state: VmtState) -> tuple[str, TrackedDevice] | str:
        serial, numbers = message.arguments[0] if message.arguments else None, message.arguments[1:8]
        if not isinstance(serial, str) or len(numbers) < 7 or not all(isinstance(x, float) for x in numbers):
            return f"{message.address} is not a serial, three coordinates and a quaternion"
        pose = pose_of(numbers, f"{message.address}: {serial[:40]!r}")
        if isinstance(pose, str):
            return pose
        place, turn = pose
        rotation = None if turn is None else from_driver_rotation(turn)
        return serial, TrackedDevice(self._kind(serial, state), place, rotation, now, raw=True)

    def _kind(self, serial: str, state: VmtState) -> str:
        """Return a device's kind, which VMT does not send: one or two devices outside the table are controllers."""
        if serial in ("HMD", state.headset):
            return "Hmd"
        lowered = serial.lower()
        if "controller" in lowered or "hand" in lowered:
            return "Con"
        unnamed = [one for one in state.others if one not in self.devices.names]
        return "Con" if serial in unnamed and len(unnamed) <= 2 else "Tra"


def _with_list(message: Message, state: VmtState) -> VmtState:
    """Return the state after a list of devices, lines of `index:serial`; the headset has index 0."""
    text = message.arguments[0] if message.arguments else None
    if not isinstance(text, str) or len(text) > _LONGEST_LIST:
        return state
    rows: dict[str, str] = {}
    for line in text.splitlines():
        number, colon, serial = line.strip().partition(":")
        if colon:
            rows[number] = serial
    others = [
        serial for number, serial in rows.items() if number != "0" and not serial.startswith((_OURS, *_BASE_STATIONS))
    ]
    return replace(state, headset=rows.get("0", state.headset), others=tuple(dict.fromkeys(others)))


def subscriptions(state: VmtState, address: str, port: int) -> list[bytes]:
    """Return the requests to the driver. Send them repeatedly, so that a restarted driver gets them, too."""
    requests = [
        message_bytes("/VMT/Set/Destination", "si", address, port),
        message_bytes("/VMT/Get/Devices/List", ""),
        *(message_bytes("/VMT/Subscribe/Device", "s", serial) for serial in (state.headset, *state.others)),
    ]
    if state.lacks_room:  # identity: the room is the raw space
        requests.append(message_bytes("/VMT/Set/RoomMatrix/Temporary", 12 * "f", *_IDENTITY_ROOM))
    return requests


def tracker_packet(first: int, points: Mapping[str, np.ndarray], turns: Mapping[str, np.ndarray]) -> bytes:
    """Return a bundle of all virtual trackers, from positions (3,) m and rotations (4,) wxyz in the driver's world.

    Indices start at `first`, in the order of `TURNED_BY`.
    """
    place = np.array([points[name] for name in TURNED_BY])
    turn = driver_rotation(np.array([turns[joint] for joint in TURNED_BY.values()]))
    (packet,) = _form(first).filled(np.hstack([place, turn]).ravel())
    return packet


@lru_cache
def _form(first: int) -> PacketForm:
    return PacketForm([device_message(first + k, TRACKER) for k in range(len(TURNED_BY))])


def device_message(index: int, kind: int) -> tuple[str, str, tuple[int, int, float]]:
    """Return the message that switches a virtual device on, without position (m) and rotation (x y z w)."""
    return "/VMT/Raw/Driver", f"iif{_SEVEN}", (index, kind, 0.0)


def off_messages(indices: Sequence[int]) -> list[bytes]:
    """Return messages that switch virtual devices off; otherwise the driver displays their last pose forever."""
    return [message_bytes("/VMT/Raw/Driver", f"iif{_SEVEN}", k, OFF, *(7 * (0.0,)), 1.0) for k in indices]
