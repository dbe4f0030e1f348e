"""The conversation with a driver of SlimeVR 22: its requests are answered, its headset and trackers are read.

A connection is configured first (hello, bones, done). Then a driver registers, adds trackers and sends their poses.
A headset is the tracker of the head's bone, a controller that of a hand's bone; the rotation of a controller's grip is
not documented, so only its position is used.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import ClassVar

from bodysense_live.protocols.driver_axes import from_driver_rotation
from bodysense_live.protocols.solarxr import driver_messages as messages
from bodysense_live.protocols.solarxr.driver_messages import BONE_IDS, VERSION, BoneParts, Request, read_requests
from bodysense_live.protocols.solarxr.generated.driver_generated import (
    AddTrackerStatus,
    RegistrationStatus,
    TrackerStatus,
)
from bodysense_live.sessions.tracked_devices import MOST_DEVICES, DeviceReader, DeviceState, TrackedDevice, pose_of

_DEVICES = {  # id of a bone → kind and serial of a tracker on it
    BONE_IDS[bone]: device
    for bone, device in (
        ("head", ("Hmd", "HMD")),
        ("left_hand", ("Con", "left controller")),
        ("right_hand", ("Con", "right controller")),
        ("hip", ("Tra", "hip")),
        ("upper_chest", ("Tra", "chest")),
        *((f"{side}_{bone}", ("Tra", f"{side} {part}")) for side in ("left", "right") for bone, part in (
            ("foot", "foot"), ("upper_leg", "knee"), ("upper_arm", "elbow"),
        )),
    )
}  # fmt: skip


@dataclass(frozen=True)
class DriverTracker:
    """A tracker that a driver has added."""

    identity: str  # of the hardware
    kind: str  # of `TrackedDevice`
    serial: str
    is_lost: bool = False


@dataclass(frozen=True, eq=False)
class DriverState:
    """A connection with a driver, and what its last packet was answered with."""

    greeted: bool = False
    configured: bool = False
    name: str = ""  # of the registered driver; empty without registration
    mask: BoneParts | None = None  # parts of bones that the driver requests; None: no updates
    trackers: tuple[DriverTracker, ...] = ()  # the first has id 1
    devices: DeviceState = DeviceState()
    replies: tuple[bytes, ...] = ()
    closes: bool = False  # the connection ends after the replies


@dataclass(frozen=True)
class DriverReader(DeviceReader):
    """The decoder of one driver's messages. `names` returns the names of other registered drivers."""

    initial_state: ClassVar = DriverState()
    names: Callable[[], Collection[str]] = field(default=tuple)

    def take(self, packet: bytes, now: float, state: DriverState) -> tuple[DriverState, str | None]:
        """Read a message received at `now` s. Return the next state, and a reason if the message is invalid."""
        state = replace(state, replies=())
        requests = read_requests(packet)
        if isinstance(requests, str):
            return state, requests
        reason = None
        for request in requests:
            if request.kind == "pose":
                state, problem = self._read_pose(request, now, state)
                reason = reason or problem
            else:
                state = self._answer(request, state)
        return state, reason

    def _answer(self, request: Request, state: DriverState) -> DriverState:
        """Return the state after a request, with its replies."""
        if not state.greeted:
            accepted = request.kind == "hello" and request.version == VERSION
            reply = messages.server_hello(accepted) if request.kind == "hello" else _too_early()
            return replace(state, greeted=accepted, closes=not accepted, replies=(*state.replies, reply))
        if request.kind == "registry":
            return _replied(state, messages.bone_registry())
        if request.kind == "configured":
            return _replied(
                replace(state, configured=True), messages.configuration_done(), messages.registration_available()
            )
        if not state.configured:
            return _replied(state, _too_early())
        if request.kind == "register":
            return self._register(request, state)
        if request.kind == "add":
            return _add(request, state)
        if request.kind == "status" and 0 < request.tracker <= len(state.trackers):
            is_lost = request.status not in (TrackerStatus.OK, TrackerStatus.BUSY)
            trackers = list(state.trackers)
            trackers[request.tracker - 1] = replace(trackers[request.tracker - 1], is_lost=is_lost)
            return replace(state, trackers=tuple(trackers))
        return state

    def _register(self, request: Request, state: DriverState) -> DriverState:
        if not request.name:
            status, name = RegistrationStatus.REJECTED_UNNAMED, ""
        elif request.name in self.names():
            status, name = RegistrationStatus.REJECTED_DUPLICATE, ""
        else:
            status, name = RegistrationStatus.ACCEPTED, request.name
        registered = replace(state, name=name, mask=request.mask if name else None)
        return _replied(registered, messages.registration_response(status, request.number))

    def _read_pose(self, request: Request, now: float, state: DriverState) -> tuple[DriverState, str | None]:
        if not state.name or not 0 < request.tracker <= len(state.trackers) or request.position is None:
            return state, None
        tracker = state.trackers[request.tracker - 1]
        pose = pose_of([*request.position, *(request.rotation or (0.0, 0.0, 0.0, 0.0))], "a position")
        if tracker.is_lost or isinstance(pose, str):
            return state, pose if isinstance(pose, str) else None
        place, turn = pose
        rotation = None if turn is None or tracker.kind == "Con" else from_driver_rotation(turn)
        device = TrackedDevice(tracker.kind, place, rotation, now, raw=True)
        devices, reason = self.devices.put([(tracker.serial, device)], state.devices)
        return replace(state, devices=devices), reason


def _add(request: Request, state: DriverState) -> DriverState:
    """Add a tracker, or find the one with the same hardware."""
    known = [tracker.identity for tracker in state.trackers]
    status, number = AddTrackerStatus.ERROR, 0
    if request.name in known:
        status, number = AddTrackerStatus.ALREADY_EXISTS, 1 + known.index(request.name)
    elif state.name and request.name and len(known) < MOST_DEVICES:
        kind, serial = _DEVICES.get(request.bone, ("Tra", request.name))
        status, number = AddTrackerStatus.CREATED, len(known) + 1
        state = replace(state, trackers=(*state.trackers, DriverTracker(request.name, kind, serial)))
    return _replied(state, messages.tracker_response(status, number, request.number))


def _replied(state: DriverState, *replies: bytes) -> DriverState:
    return replace(state, replies=(*state.replies, *replies))


def _too_early() -> bytes:
    return messages.connection_error("the connection is not configured: send ClientHello, then ConfigurationDone")
