"""SlimeVR's trackers by UDP: their packets read, the server's replies written. No sockets here.

Source: SlimeVR's server and firmware (protocol 22). A datagram is a type (u32), an increasing number (u64) and the
content, all big-endian. Trackers send their rotation, in their own world with +Z up. They do not send their position
or mounting (`inertial`).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bodysense.geometry.rotation import quaternion_multiply
from bodysense.observing.checks import UNIT_TOLERANCE
from bodysense_live.server.messages import Calibrate, Recentre

PORT = 6969
MAX_TRACKERS, MAX_SENSORS = 32, 16
HEARTBEAT_EVERY = 0.5  # s
_HANDSHAKE, _ROTATION, _SENSOR, _BOTH, _FEATURES = 3, 17, 15, 23, 22
_HEARTBEAT, _SECOND_ROTATION, _ACTION = 1, 16, 21  # an old tracker sends rotations as type 1
_BUNDLE, _COMPACT = 100, 101
_HEAD = struct.Struct(">IQ")
_GREETING = (b"\x03Hey OVR =D 5").ljust(64, b"\0")
_BUNDLES = b"\x03"  # our features: bundles, plain and compact
_UPRIGHT = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0])  # from a world with +Z up to one with +Y up
# Body position that a sensor reports → joint that turns this segment.
POSITIONS = {
    1: "head",
    2: "neck",
    3: "spine3",
    4: "spine2",
    5: "spine1",
    6: "pelvis",
    **dict(enumerate(("left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle"), start=7)),
    **dict(enumerate(("left_elbow", "right_elbow", "left_shoulder", "right_shoulder"), start=13)),
    **dict(enumerate(("left_wrist", "right_wrist", "left_collar", "right_collar"), start=17)),
}
_ACTIONS: dict[int, Calibrate | Recentre] = {
    2: Calibrate(),
    3: Recentre(),
    4: Calibrate(),
}  # resets: full, yaw, mounting


@dataclass(frozen=True, eq=False)
class Sensor:
    """One sensor of a tracker."""

    works: bool = True
    joint: str | None = None  # as the sensor reports
    rotation: np.ndarray | None = None  # (4,) wxyz, in the tracker's world, +Y up
    at: float = -np.inf  # s, when the rotation was received


@dataclass(frozen=True, eq=False)
class SlimevrTracker:
    """A tracker with its sensors."""

    address: tuple[str, int]
    number: int = 0  # number of its newest datagram
    sensors: Mapping[int, Sensor] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SlimevrState:
    """The connected trackers by serial, their hardware address as 'AA:BB:CC:DD:EE:FF'."""

    trackers: Mapping[str, SlimevrTracker] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class DatagramResult:
    """The result of a datagram."""

    state: SlimevrState
    replies: tuple[bytes, ...] = ()
    commands: tuple[Calibrate | Recentre, ...] = ()
    reason: str | None = None  # why the datagram is invalid, if it is


def heartbeat() -> bytes:
    """Return the packet that keeps a tracker connected."""
    return _HEAD.pack(_HEARTBEAT, 0)


def take(
    packet: bytes, address: tuple[str, int], now: float, state: SlimevrState, known: frozenset[str]
) -> DatagramResult:
    """Read a datagram received from `address` at `now` s.

    `known`: serials of the accepted trackers; all, if it is empty.
    """
    if len(packet) < _HEAD.size:
        return DatagramResult(state, reason=f"{len(packet)} bytes; a datagram of SlimeVR has at least {_HEAD.size}")
    kind, number = _HEAD.unpack_from(packet)
    if kind == _HANDSHAKE:
        return _handshake(packet, address, state, known)
    serial = next((name for name, one in state.trackers.items() if one.address == address), None)
    if serial is None:
        return DatagramResult(state, reason="a tracker without a handshake")
    tracker = state.trackers[serial]
    if number and number <= tracker.number:
        return DatagramResult(state, reason="late: a newer datagram of the tracker came before")
    update = _TrackerUpdate(replace(tracker, number=max(number, tracker.number)))
    reason = None
    for kind_inside, body in _messages(kind, packet[_HEAD.size :]):
        reason = update.read(kind_inside, body, packet, now) or reason
    after = SlimevrState({**state.trackers, serial: update.tracker})
    return DatagramResult(after, tuple(update.replies), tuple(update.commands), reason)


def _handshake(packet: bytes, address: tuple[str, int], state: SlimevrState, known: frozenset[str]) -> DatagramResult:
    """Add the tracker of a handshake, or update its address."""
    place = _HEAD.size + 7 * 4
    firmware = packet[place] if len(packet) > place else 0
    mac = packet[place + 1 + firmware : place + 7 + firmware]
    if len(mac) < 6 or not any(mac):  # old and emulated trackers send none
        serial = f"{address[0]}:{address[1]}"
    else:
        serial = mac.hex(":").upper()
    if known and serial not in known:
        return DatagramResult(state, reason=f"the tracker {serial} is not in the table")
    if serial not in state.trackers and len(state.trackers) >= MAX_TRACKERS:
        return DatagramResult(state, reason=f"more than {MAX_TRACKERS} trackers")
    before = state.trackers.get(serial)
    others = {name: one for name, one in state.trackers.items() if one.address != address}
    sensors = {} if before is None else before.sensors
    return DatagramResult(SlimevrState({**others, serial: SlimevrTracker(address, sensors=sensors)}), (_GREETING,))


def _messages(kind: int, body: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield the messages of a datagram: the only one, or those of a bundle."""
    if kind not in (_BUNDLE, _COMPACT):
        yield kind, body
        return
    size, head = (2, 4) if kind == _BUNDLE else (1, 1)
    place = 0
    while place + size + head <= len(body):
        length = int.from_bytes(body[place : place + size], "big")
        inside = body[place + size : place + size + length]
        if length < head or len(inside) < length:
            return
        yield int.from_bytes(inside[:head], "big"), inside[head:]
        place += size + length


class _TrackerUpdate:
    """A tracker that the messages of one datagram update."""

    def __init__(self, tracker: SlimevrTracker) -> None:
        self.tracker = tracker
        self.replies: list[bytes] = []
        self.commands: list[Calibrate | Recentre] = []

    def read(self, kind: int, body: bytes, packet: bytes, now: float) -> str | None:
        """Read one message. Return why it is invalid, or None."""
        try:
            if kind == _ROTATION:
                sensor, _, *values = struct.unpack_from(">BB4f", body)
                return self._turn(sensor, values, now)
            if kind == _BOTH:
                sensor, *whole = struct.unpack_from(">B4h", body)
                return self._turn(sensor, [value / 32768 for value in whole], now)
            if kind in (_HEARTBEAT, _SECOND_ROTATION) and len(body) >= 16:
                return self._turn(int(kind == _SECOND_ROTATION), struct.unpack_from(">4f", body), now)
            if kind == _SENSOR:
                return self._read_description(body)
            if kind == _ACTION and body[0] in _ACTIONS:
                self.commands.append(_ACTIONS[body[0]])
            elif kind == _FEATURES:
                self.replies.append(_HEAD.pack(_FEATURES, 0) + _BUNDLES)
        except (struct.error, IndexError):
            return f"a message of type {kind} is cut off"
        return None

    def _turn(self, sensor: int, rotation: Sequence[float], now: float) -> str | None:
        values = np.array([rotation[3], *rotation[:3]])
        length = float(np.linalg.norm(values))
        if not abs(length - 1) < UNIT_TOLERANCE:  # NaN compares false
            return f"sensor {sensor}: its rotation is not a unit quaternion"
        turn = quaternion_multiply(_UPRIGHT, values / length)
        return self._put(sensor, replace(self._sensor(sensor), works=True, rotation=turn, at=now))

    def _read_description(self, body: bytes) -> str | None:
        """Read a sensor's description and acknowledge it."""
        sensor, status = struct.unpack_from(">BB", body)
        joint = POSITIONS.get(body[6]) if len(body) > 6 else None
        was = self._sensor(sensor)
        self.replies.append(struct.pack(">IBB", _SENSOR, sensor, status))
        return self._put(sensor, replace(was, works=status == 1, joint=joint or was.joint))

    def _sensor(self, sensor: int) -> Sensor:
        return self.tracker.sensors.get(sensor, Sensor())

    def _put(self, sensor: int, one: Sensor) -> str | None:
        if sensor >= MAX_SENSORS:
            return f"sensor {sensor}; a tracker has at most {MAX_SENSORS}"
        self.tracker = replace(self.tracker, sensors={**self.tracker.sensors, sensor: one})
        return None
