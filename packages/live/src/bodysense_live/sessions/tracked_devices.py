"""Headset, controllers and trackers by serial: the point of each device, and how long a device counts as tracked.

VMC, VMT and other runtimes send a serial and a pose of each device. The point of a device, by the first rule that fits:

- the table of device names has its serial;
- a Hmd is the headset; a controller whose serial contains 'left' or 'right' is that hand's;
- two other controllers are assigned once, by which is further left as seen from the headset (one alone by its side of
  the headset), and keep their hands by serial;
- a tracker's serial names its point: hip (waist, pelvis), chest, and left or right foot (ankle), knee, elbow. Other
  trackers are unassigned: `tracker_1` … `tracker_8` in the order of arrival, until calibration finds their joints.

A device keeps its last pose for `longest_silence` and is then not tracked.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import read_json
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.observing.checks import FARTHEST, UNIT_TOLERANCE
from bodysense.observing.observation import Observation, usual_accuracy
from bodysense_live.protocols.driver_axes import turned_about
from bodysense_live.protocols.webxr import UNASSIGNED
from bodysense_live.server.messages import Calibrate, Recentre

HANDS = ("left_controller", "right_controller")
_PARTS = {  # words of serials → joint
    "pelvis": ("hip", "waist", "pelvis"),
    "spine3": ("chest",),
    "ankle": ("foot", "ankle"),
    "knee": ("knee",),
    "elbow": ("elbow",),
}
_MIDDLE = ("pelvis", "spine3")
POINTS = (
    "headset",
    *HANDS,
    *_MIDDLE,
    *(f"{side}_{part}" for part in _PARTS if part not in _MIDDLE for side in ("left", "right")),
)
# Names in the signal of a session: trackers have the suffix `_tracker`, and unassigned ones are included.
SIGNALS = ("headset", *HANDS, *(f"{point}_tracker" for point in POINTS[1 + len(HANDS) :]), *UNASSIGNED)
MOST_DEVICES = 32
_cached_accuracy = lru_cache(maxsize=64)(usual_accuracy)


@dataclass(frozen=True, eq=False)
class TrackedDevice:
    """The last pose of a device, in our world, +Z forward."""

    kind: str  # Hmd, Con or Tra; VRChat's devices have the name of their point
    position: np.ndarray  # (3,) m
    rotation: np.ndarray | None  # (4,) wxyz; None if it is missing or invalid
    at: float  # s, when it was received
    raw: bool  # in the room's scale (…/Local), not the avatar's


@dataclass(frozen=True, eq=False)
class DeviceState:
    """The devices received so far."""

    devices: Mapping[str, TrackedDevice] = field(default_factory=dict)  # by serial
    hands: Mapping[str, str] = field(default_factory=dict)  # controllers without a side in their serials → points
    unassigned: Mapping[str, str] = field(default_factory=dict)  # serials of unassigned trackers → `UNASSIGNED`
    at: float | None = None  # s, when a pose was last received


@dataclass(frozen=True)
class TrackedDevices:
    """The assignment of devices to points, as the module describes it."""

    names: Mapping[str, str] = field(default_factory=dict)  # serial → one of POINTS
    longest_silence: float = 0.25  # s without a pose, after which a device is not tracked

    def __post_init__(self) -> None:
        for serial, point in self.names.items():
            if point not in POINTS:
                raise BodysenseError(f"{point!r} (for {serial!r}) is not a device; valid are {', '.join(POINTS)}")

    def put(self, poses: Iterable[tuple[str, TrackedDevice]], state: DeviceState) -> tuple[DeviceState, str | None]:
        """Add poses by serial. Return the next state, and a reason if a pose is dropped."""
        reason, devices, at = None, dict(state.devices), state.at
        for serial, device in poses:
            known = devices.get(serial)
            if known is not None and known.raw and not device.raw and device.at - known.at <= self.longest_silence:
                continue  # the same pose in the avatar's scale
            if known is None and len(devices) >= MOST_DEVICES:
                devices = {name: old for name, old in devices.items() if device.at - old.at <= self.longest_silence}
                if len(devices) >= MOST_DEVICES:
                    reason = f"more than {MOST_DEVICES} devices"
                    continue
            devices[serial] = device
            at = device.at
        if at is None:
            return state, reason
        hands, unassigned = self._hands(devices, at, state.hands), self._assign_names(devices, state.unassigned)
        return DeviceState(devices, hands, unassigned, at), reason

    def observation(self, now: float, state: DeviceState) -> Observation | None:
        """Return a frame of `SIGNALS` at the newest device's time; None without a tracked device.

        The headset's and the controllers' axes are WebXR's (−Z forward); a tracker has the axes of its own mounting.
        """
        if state.at is None:
            return None
        position, rotation = np.full((len(SIGNALS), 3), np.nan), np.full((len(SIGNALS), 4), np.nan)
        newest = np.full(len(SIGNALS), -np.inf)
        for serial, device in state.devices.items():
            point = self._point(serial, device.kind) or state.hands.get(serial) or state.unassigned.get(serial)
            if point is None or now - device.at > self.longest_silence:
                continue
            place = POINTS.index(point) if point in POINTS else SIGNALS.index(point)
            if device.at > newest[place]:
                newest[place], position[place] = device.at, device.position
                rotation[place] = np.nan if device.rotation is None else device.rotation
                if place <= len(HANDS):
                    rotation[place] = turned_about(rotation[place])
        return one_frame(SIGNALS, position, rotation, state.at) if np.isfinite(newest).any() else None

    def is_whole(self, now: float, state: DeviceState) -> bool:
        """Return whether at least one device is tracked, and all tracked devices were received at `now`."""
        ages = [now - device.at for device in state.devices.values()]
        fresh = [age for age in ages if age <= self.longest_silence]
        return bool(fresh) and max(fresh) == 0

    def _point(self, serial: str, kind: str) -> str | None:
        """Return the point of a device by its serial and kind, or None."""
        if serial in self.names:
            return self.names[serial]
        if kind == "Hmd":
            return "headset"
        lowered = serial.lower()
        side = next((side for side in ("left", "right") if side in lowered), None)
        if kind == "Con":
            return f"{side}_controller" if side else None
        part = next((part for part, words in _PARTS.items() if any(word in lowered for word in words)), None)
        if part in _MIDDLE:
            return part
        return f"{side}_{part}" if side and part else None

    def _assign_names(self, devices: Mapping[str, TrackedDevice], unassigned: Mapping[str, str]) -> Mapping[str, str]:
        """Return names of unassigned trackers; those named before keep their names."""
        new = [
            name
            for name, device in devices.items()
            if device.kind == "Tra" and name not in unassigned and self._point(name, "Tra") is None
        ]
        if not new:
            return unassigned
        free = [name for name in UNASSIGNED if name not in unassigned.values()]
        return {**unassigned, **dict(zip(new, free, strict=False))}

    def _hands(self, devices: Mapping[str, TrackedDevice], now: float, hands: Mapping[str, str]) -> Mapping[str, str]:
        """Return the hands of controllers without a side in their serials."""
        fresh = {serial: device for serial, device in devices.items() if now - device.at <= self.longest_silence}
        sideless = [name for name, device in fresh.items() if device.kind == "Con" and not self._point(name, "Con")]
        new = [name for name in sideless if name not in hands]
        head = next((device for name, device in fresh.items() if self._point(name, device.kind) == "headset"), None)
        if not new or head is None or head.rotation is None:
            return hands
        # A controller that is not tracked loses its hand, because another one may have replaced it.
        kept = {name: point for name, point in hands.items() if name in fresh}
        taken = {*kept.values(), *(self._point(name, device.kind) for name, device in fresh.items())}
        free = [hand for hand in HANDS if hand not in taken]
        toward_left = {
            name: float(quaternion_rotate(quaternion_conjugate(head.rotation), fresh[name].position - head.position)[0])
            for name in new
        }
        new.sort(key=lambda name: -toward_left[name])
        if len(free) == 2 and len(new) == 1:
            free = [HANDS[0] if toward_left[new[0]] > 0 else HANDS[1]]
        return kept | dict(zip(new, free, strict=False))


def no_sensors(now: float) -> Observation | None:
    """Return None: there are no further sensors."""


@dataclass(frozen=True)
class DeviceReader(ABC):
    """A decoder of packets, the base of `VmcTrackers`, `VmtReader` and others. Its states have `devices`."""

    initial_state: ClassVar[Any]  # the state before the first packet
    devices: TrackedDevices = TrackedDevices()
    sensors: Callable[[float], Observation | None] = no_sensors  # frames of further sensors on the same wearer

    def start(self) -> Any:
        """Return the state before the first packet."""
        return self.initial_state

    @abstractmethod
    def take(self, packet: bytes, now: float, state: Any) -> tuple[Any, str | None]:
        """Read a packet received at `now` s. Return the next state, and a reason if any of it is invalid."""

    def tracked(self, now: float, state: Any) -> Observation | None:
        """Return one frame of the devices; None if no device is tracked."""
        return self.devices.observation(now, state.devices)

    def observation(self, now: float, state: Any) -> Observation | None:
        """Return one frame of devices and sensors; None if nothing is tracked."""
        found, sensors = self.tracked(now, state), self.sensors(now)
        if found is None or sensors is None:
            return found if sensors is None else sensors
        names = ("position", "rotation", "has_position", "has_rotation", "accuracy")
        both = {name: np.concatenate([getattr(found, name), getattr(sensors, name)], axis=1) for name in names}
        return replace(found, points=(*found.points, *sensors.points), **both)

    def is_whole(self, now: float, state: Any) -> bool:
        """Return whether all tracked devices were received at `now`."""
        return self.devices.is_whole(now, state.devices)

    def commands(self, packet: bytes) -> Sequence[Calibrate | Recentre]:
        """Return the commands in a packet."""
        return ()

    def serials(self, state: Any) -> Mapping[str, str]:
        """Return the signal's names of unassigned trackers, by serial."""
        return state.devices.unassigned


def one_frame(points: tuple[str, ...], position: np.ndarray, rotation: np.ndarray, time: float) -> Observation:
    """Return an observation of positions (P, 3) m and rotations (P, 4) wxyz, NaN if unknown, at `time` s."""
    return Observation(
        points=points,
        position=position[None],
        rotation=rotation[None],
        has_position=np.asarray(np.isfinite(position[None]).all(axis=-1)),
        has_rotation=np.asarray(np.isfinite(rotation[None]).all(axis=-1)),
        accuracy=_cached_accuracy(points)[None].copy(),
        time=np.array([time]),
    )


def pose_of(numbers: Sequence[Any], what: str) -> tuple[np.ndarray, np.ndarray | None] | str:
    """Return position (3,) and rotation (4,) of seven numbers, or a reason; None for an invalid rotation."""
    values = np.array(numbers, dtype=float)
    if not np.isfinite(values).all() or np.abs(values[:3]).max() > FARTHEST:
        return f"{what} is not finite, or farther than {FARTHEST:g} m away"
    length = float(np.linalg.norm(values[3:])) if np.abs(values[3:]).max() < 2 else 0.0
    return values[:3], values[3:] / length if abs(length - 1) < UNIT_TOLERANCE else None


def read_device_names(path: str | Path) -> dict[str, str]:
    """Read a table of devices, a JSON object {"LHR-5A3C21FF": "left_ankle", …}. Raises BodysenseError for other files.

    `TrackedDevices` and `SlimevrSettings` check the points.
    """
    wanted = f"a table of devices is a JSON object, serial to one of {', '.join(POINTS)}"
    table = read_json(path, wanted)
    if not isinstance(table, dict) or not all(isinstance(point, str) for point in table.values()):
        raise BodysenseError(f"{path}: {wanted}")
    return table
