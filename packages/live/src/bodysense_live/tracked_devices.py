"""Headset, controllers and trackers by their serials: which device is which point, and how long one counts as tracked.

VMC, VMT and other runtimes send a serial and a pose of each device. Which device is which point:

- what the table of names says of its serial;
- a Hmd is the headset; a controller whose serial has 'left' or 'right' in it is that hand's;
- two other controllers are distinguished, once, by which is further to the left as seen by the headset (one alone by
  its side of it), and keep their hands by serial;
- a tracker is what its serial says: hip (waist, pelvis), chest, and left or right foot (ankle), knee, elbow. Trackers
  that say nothing are `tracker_1` … `tracker_8`, in the order in which they came, for a calibration to decide.

A device keeps its last pose for a moment and then counts as not tracked.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.errors import BodysenseError
from bodysense.observation import FARTHEST, UNIT_TOLERANCE, Observation, usual_accuracy
from bodysense_live.driver_axes import turned_about
from bodysense_live.messages import Calibrate, Recentre
from bodysense_live.webxr import UNASSIGNED

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
# As sessions name them, and trackers that say nothing.
SIGNALS = ("headset", *HANDS, *(f"{point}_tracker" for point in POINTS[1 + len(HANDS) :]), *UNASSIGNED)
MOST_DEVICES = 32
_usual = lru_cache(maxsize=64)(usual_accuracy)


@dataclass(frozen=True, eq=False)
class TrackedDevice:
    """The last pose of a device, in our world, +Z forward."""

    kind: str
    position: np.ndarray  # (3,) m
    rotation: np.ndarray | None  # (4,) wxyz; None where none was sent that is one
    at: float  # s, when it came
    raw: bool  # in the room's own scale (…/Local), not the avatar's


@dataclass(frozen=True, eq=False)
class DeviceState:
    """Devices that came in until now."""

    devices: Mapping[str, TrackedDevice] = field(default_factory=dict)  # by serial
    hands: Mapping[str, str] = field(default_factory=dict)  # serials of controllers → their points
    unassigned: Mapping[str, str] = field(default_factory=dict)  # serials of trackers that name no joint → UNASSIGNED
    at: float | None = None  # s, when a device last came


@dataclass(frozen=True)
class TrackedDevices:
    """How devices become points. See the module's text."""

    names: Mapping[str, str] = field(default_factory=dict)  # serial → one of POINTS
    longest_silence: float = 0.25  # s after which a device that does not come counts as not tracked

    def __post_init__(self) -> None:
        for serial, point in self.names.items():
            if point not in POINTS:
                raise BodysenseError(f"{point!r} (for {serial!r}) is no device; valid are {', '.join(POINTS)}")

    def put(self, poses: Iterable[tuple[str, TrackedDevice]], state: DeviceState) -> tuple[DeviceState, str | None]:
        """Take in serials and poses; the reason, too, where one of them is of no use."""
        reason, devices, at = None, dict(state.devices), state.at
        for serial, device in poses:
            known = devices.get(serial)
            if known is not None and known.raw and not device.raw and device.at - known.at <= self.longest_silence:
                continue  # the same in the avatar's scale
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
        """Return a frame of `SIGNALS`, ordered as `POINTS`, at the newest device's time; None without a recent device.

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
        """Whether at least one device is tracked, and all tracked devices came at `now`."""
        ages = [now - device.at for device in state.devices.values()]
        fresh = [age for age in ages if age <= self.longest_silence]
        return bool(fresh) and max(fresh) == 0

    def _point(self, serial: str, kind: str) -> str | None:
        """The point that a device is by its name alone."""
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
        """Name trackers whose serials name no joint; named ones keep their names."""
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
        """Return the hands of controllers without a hand in their names."""
        fresh = {serial: device for serial, device in devices.items() if now - device.at <= self.longest_silence}
        sideless = [name for name, device in fresh.items() if device.kind == "Con" and not self._point(name, "Con")]
        new = [name for name in sideless if name not in hands]
        head = next((device for name, device in fresh.items() if self._point(name, device.kind) == "headset"), None)
        if not new or head is None or head.rotation is None:
            return hands
        kept = {
            name: point for name, point in hands.items() if name in fresh
        }  # a controller may be another's successor
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
    """No other sensors are worn."""


@dataclass(frozen=True)
class DeviceReader(ABC):
    """A decoder of packets, whose state has `devices`: `VmcTrackers`, `VmtReader` …"""

    initial_state: ClassVar[Any]  # the state before the first packet
    devices: TrackedDevices = TrackedDevices()
    sensors: Callable[[float], Observation | None] = no_sensors  # frames of others on the same wearer

    def start(self) -> Any:
        """Return the state before the first packet."""
        return self.initial_state

    @abstractmethod
    def take(self, packet: bytes, now: float, state: Any) -> tuple[Any, str | None]:
        """Take in a packet that came at `now` s; the reason, too, where it or a part of it is of no use."""

    def tracked(self, now: float, state: Any) -> Observation | None:
        """One frame of the devices, as of the last one that came; None where none came lately."""
        return self.devices.observation(now, state.devices)

    def observation(self, now: float, state: Any) -> Observation | None:
        """One frame of devices and sensors; None where none came lately."""
        found, sensors = self.tracked(now, state), self.sensors(now)
        if found is None or sensors is None:
            return found if sensors is None else sensors
        names = ("position", "rotation", "has_position", "has_rotation", "accuracy")
        both = {name: np.concatenate([getattr(found, name), getattr(sensors, name)], axis=1) for name in names}
        return replace(found, points=(*found.points, *sensors.points), **both)

    def is_whole(self, now: float, state: Any) -> bool:
        """Whether all devices that are tracked came at `now`."""
        return self.devices.is_whole(now, state.devices)

    def commands(self, packet: bytes) -> Sequence[Calibrate | Recentre]:
        """Return the commands in a packet."""
        return ()

    def serials(self, state: Any) -> Mapping[str, str]:
        """Return the signal's names of trackers whose serials name no joint, by serial."""
        return state.devices.unassigned


def one_frame(points: tuple[str, ...], position: np.ndarray, rotation: np.ndarray, time: float) -> Observation:
    """Return an observation of positions (P, 3) m and rotations (P, 4) wxyz, NaN if unknown, at `time` s."""
    return Observation(
        points=points,
        position=position[None],
        rotation=rotation[None],
        has_position=np.asarray(np.isfinite(position[None]).all(axis=-1)),
        has_rotation=np.asarray(np.isfinite(rotation[None]).all(axis=-1)),
        accuracy=_usual(points)[None].copy(),
        time=np.array([time]),
    )


def pose_of(numbers: Sequence[Any], what: str) -> tuple[np.ndarray, np.ndarray | None] | str:
    """Return position (3,) and rotation (4,) of seven numbers, the rotation None if invalid, or a reason."""
    values = np.array(numbers, dtype=float)
    if not np.isfinite(values).all() or np.abs(values[:3]).max() > FARTHEST:
        return f"{what} is not finite, or farther than {FARTHEST:g} m away"
    length = float(np.linalg.norm(values[3:])) if np.abs(values[3:]).max() < 2 else 0.0
    return values[:3], values[3:] / length if abs(length - 1) < UNIT_TOLERANCE else None


def read_device_names(path: str | Path) -> dict[str, str]:
    """A table of devices: a JSON object, {"LHR-5A3C21FF": "left_ankle", …}. Raises BodysenseError for any other file.

    `TrackedDevices` and `SlimevrSettings` check the points.
    """
    try:
        table = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror}); give a table of devices, .json") from None
    except (ValueError, RecursionError):
        table = None
    if not isinstance(table, dict) or not all(isinstance(point, str) for point in table.values()):
        raise BodysenseError(f"{path}: a table of devices is a JSON object, serial to one of {', '.join(POINTS)}")
    return table
