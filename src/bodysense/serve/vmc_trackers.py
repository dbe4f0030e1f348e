"""Headset, controllers and trackers that come in by VMC: /VMC/Ext/Hmd|Con|Tra/Pos and …/Pos/Local (docs/avatars.md).

`VmcTrackers` reads packets and opens no socket. Messages may be lost, doubled, late or nonsense: a device keeps its
last pose for a moment and then counts as not tracked; a packet whose /VMC/Ext/T is older than one that was taken is
left out; what is no message is refused with a reason, and nothing raises.

Which device is which point:

- what the table of names says of its serial;
- a Hmd is the headset; a controller whose serial has 'left' or 'right' in it is that hand's;
- two other controllers are told apart, once, by which is further to the left as seen by the headset (one alone by its
  side of it), and keep their hands by serial;
- a tracker is what its serial says: hip (waist, pelvis), chest, and left or right foot (ankle), knee, elbow. Trackers
  that say nothing are `tracker_1` … `tracker_8`, in the order in which they came, for a calibration to decide.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.capture.osc import Argument, Message, read_packet
from bodysense.errors import BodysenseError
from bodysense.observation import FARTHEST, UNIT_TOLERANCE, Observation, usual_accuracy
from bodysense.serve.unity import from_unity_rotation, unity_position
from bodysense.serve.webxr import UNDECIDED

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
SIGNALS = ("headset", *HANDS, *(f"{point}_tracker" for point in POINTS[1 + len(HANDS) :]), *UNDECIDED)
_ACCURACY = usual_accuracy(SIGNALS)[None]  # (1, P) m
_KINDS = {f"/VMC/Ext/{kind}/Pos{tail}": (kind, bool(tail)) for kind in ("Hmd", "Con", "Tra") for tail in ("", "/Local")}
_ABOUT_Y = np.array([0.0, 0.0, 1.0, 0.0])  # half a turn: from axes whose +Z is forward to those whose −Z is
_MOST_DEVICES = 32
_MOST_TOLD = 4 * _MOST_DEVICES  # poses in a packet
_LONGEST_SERIAL = 128


@dataclass(frozen=True, eq=False)
class Device:
    """One device as it was last told of: in our world, +Z forward."""

    kind: str
    position: np.ndarray  # (3,) m
    rotation: np.ndarray | None  # (4,) wxyz; None where none was sent that is one
    at: float  # s, when it came
    raw: bool  # in the room's own scale (…/Local), not the avatar's


@dataclass(frozen=True, eq=False)
class VmcState:
    """What came in until now."""

    devices: Mapping[str, Device] = field(default_factory=dict)  # by serial
    hands: Mapping[str, str] = field(default_factory=dict)  # serials of controllers → their points
    undecided: Mapping[str, str] = field(default_factory=dict)  # serials of trackers that say nothing → UNDECIDED
    clock: float | None = None  # s, the sender's, of the newest packet that had one
    at: float | None = None  # s, when a device last came


@dataclass(frozen=True)
class VmcTrackers:
    """How devices are read. See the module's text."""

    names: Mapping[str, str] = field(default_factory=dict)  # serial → one of POINTS
    longest_silence: float = 0.25  # s after which a device that does not come counts as not tracked
    longest_delay: float = 1.0  # s: a sender's clock that goes back by more was started afresh

    def __post_init__(self) -> None:
        for serial, point in self.names.items():
            if point not in POINTS:
                raise BodysenseError(f"VMC: {point!r} (for {serial!r}) is no device; valid are {', '.join(POINTS)}")

    def start(self) -> VmcState:
        """Nothing came yet."""
        return VmcState()

    def take(self, packet: bytes, now: float, state: VmcState) -> tuple[VmcState, str | None]:
        """Take in a packet that came at `now` s; the reason, too, where it or a part of it is of no use."""
        messages = read_packet(packet)
        if isinstance(messages, str):
            return state, messages
        told = [message for message in messages if message.address in _KINDS]
        if len(told) > _MOST_TOLD:
            return state, f"more than {_MOST_TOLD} devices in one packet"
        clock = _clock(messages)
        if clock is not None:
            if state.clock is not None and 0 < state.clock - clock <= self.longest_delay:
                return state, f"late: sent at {clock:g} s, after one of {state.clock:g} s"
            state = replace(state, clock=clock)
        reason, devices = None, dict(state.devices)
        for message in told:
            found = _device(message, now)
            if isinstance(found, str):
                reason = found
                continue
            serial, device = found
            known = devices.get(serial)
            if known is not None and known.raw and not device.raw and now - known.at <= self.longest_silence:
                continue  # the same in the avatar's scale
            if known is None and len(devices) >= _MOST_DEVICES:
                devices = {name: old for name, old in devices.items() if now - old.at <= self.longest_silence}
                if len(devices) >= _MOST_DEVICES:
                    reason = f"more than {_MOST_DEVICES} devices"
                    continue
            devices[serial] = device
            state = replace(state, at=now)
        hands, undecided = self._hands(devices, now, state.hands), self._undecided(devices, state.undecided)
        return replace(state, devices=devices, hands=hands, undecided=undecided), reason

    def observation(self, now: float, state: VmcState) -> Observation | None:
        """One frame of `SIGNALS`, ordered as `POINTS`, as of the last device that came; None where none came lately.

        The headset's and the controllers' axes are WebXR's (−Z forward), a tracker's are its own, as it is strapped on.
        """
        if state.at is None:
            return None
        position, rotation = np.full((len(SIGNALS), 3), np.nan), np.full((len(SIGNALS), 4), np.nan)
        newest = np.full(len(SIGNALS), -np.inf)
        for serial, device in state.devices.items():
            point = self._point(serial, device.kind) or state.hands.get(serial) or state.undecided.get(serial)
            if point is None or now - device.at > self.longest_silence:
                continue
            place = POINTS.index(point) if point in POINTS else SIGNALS.index(point)
            if device.at > newest[place]:
                newest[place], position[place] = device.at, device.position
                rotation[place] = np.nan if device.rotation is None else device.rotation
                if place <= len(HANDS):
                    rotation[place] = quaternion_multiply(rotation[place], _ABOUT_Y)
        known = np.isfinite(newest)
        if not known.any():
            return None
        return Observation(
            points=SIGNALS,
            position=position[None],
            rotation=rotation[None],
            has_position=known[None],
            has_rotation=np.asarray(np.isfinite(rotation[None]).all(axis=-1)),
            accuracy=_ACCURACY.copy(),
            time=np.array([state.at]),
        )

    def _point(self, serial: str, kind: str) -> str | None:
        """The point that a device is by its name alone."""
        if serial in self.names:
            return self.names[serial]
        if kind == "Hmd":
            return "headset"
        said = serial.lower()
        side = next((side for side in ("left", "right") if side in said), None)
        if kind == "Con":
            return f"{side}_controller" if side else None
        part = next((part for part, words in _PARTS.items() if any(word in said for word in words)), None)
        if part in _MIDDLE:
            return part
        return f"{side}_{part}" if side and part else None

    def _undecided(self, devices: Mapping[str, Device], undecided: Mapping[str, str]) -> Mapping[str, str]:
        """Names for trackers whose serials say nothing; who was first keeps its name."""
        new = [
            name
            for name, device in devices.items()
            if device.kind == "Tra" and name not in undecided and self._point(name, "Tra") is None
        ]
        if not new:
            return undecided
        free = [name for name in UNDECIDED if name not in undecided.values()]
        return {**undecided, **dict(zip(new, free, strict=False))}

    def _hands(self, devices: Mapping[str, Device], now: float, hands: Mapping[str, str]) -> Mapping[str, str]:
        """The hands of controllers whose names do not say it."""
        fresh = {serial: device for serial, device in devices.items() if now - device.at <= self.longest_silence}
        nameless = [name for name, device in fresh.items() if device.kind == "Con" and not self._point(name, "Con")]
        new = [name for name in nameless if name not in hands]
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


def read_device_names(path: str | Path) -> dict[str, str]:
    """A table of devices: a JSON object, {"LHR-5A3C21FF": "left_ankle", …}. Raises BodysenseError for what is none."""
    try:
        table = json.loads(Path(path).read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror}); give a table of devices, .json") from None
    except (ValueError, RecursionError):
        table = None
    if not isinstance(table, dict) or not all(isinstance(point, str) for point in table.values()):
        raise BodysenseError(f"{path}: a table of devices is a JSON object, serial to one of {', '.join(POINTS)}")
    VmcTrackers(table)  # it checks the points
    return table


def _clock(messages: tuple[Message, ...]) -> float | None:
    """The sender's time, where a packet has one."""
    for message in messages:
        if message.address == "/VMC/Ext/T" and message.arguments and _finite(message.arguments[:1]):
            return float(message.arguments[0])  # type: ignore[arg-type]
    return None


def _device(message: Message, now: float) -> tuple[str, Device] | str:
    """Serial and pose of one message, or why it has none; arguments after the eighth are left out, as VMC asks."""
    serial, numbers = message.arguments[0] if message.arguments else None, message.arguments[1:8]
    if not isinstance(serial, str) or len(serial) > _LONGEST_SERIAL or len(numbers) < 7 or not _finite(numbers):
        return f"{message.address} is not a serial, three coordinates and a quaternion"
    values = np.array(numbers, dtype=float)
    if np.abs(values[:3]).max() > FARTHEST:
        return f"{message.address}: {serial!r} is farther than {FARTHEST:g} m away"
    kind, raw = _KINDS[message.address]
    unit = abs(float(np.linalg.norm(values[3:])) - 1) < UNIT_TOLERANCE if np.abs(values[3:]).max() < 2 else False
    rotation = from_unity_rotation(values[3:] / np.linalg.norm(values[3:])) if unit else None
    return serial, Device(kind, unity_position(values[:3]), rotation, now, raw)


def _finite(values: tuple[Argument, ...]) -> bool:
    return all(isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < np.inf for x in values)
