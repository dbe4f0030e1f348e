"""VRChat by OSC: trackers sent to it, head and wrists read from it (docs/avatars.md).

Source: VRChat's documentation, *OSC Trackers*: world positions (m) and Euler angles (degrees) in Unity's axes. It
advises against always sending all eight trackers: hip and feet may behave better.

VRChat sends /tracking/vrsystem/…/pose to programs that announce it by OSCQuery: six floats, position (m) and Euler
angles (degrees), in Unity's axes. The axes of a wrist's rotation are not documented, so only its position is used.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import euler_to_quaternion
from bodysense.io.formats.osc import Message, PacketForm, read_packet
from bodysense.io.formats.unity import one_finite_pose, unity_euler, unity_position
from bodysense.observing.checks import FARTHEST
from bodysense.observing.observation import Observation
from bodysense_live.protocols.driver_axes import turned_about
from bodysense_live.protocols.osc_commands import commands_of
from bodysense_live.protocols.oscquery import OscAddress
from bodysense_live.protocols.virtual_trackers import TURNED_BY
from bodysense_live.server.messages import Calibrate, Recentre
from bodysense_live.sessions.tracked_devices import DeviceReader, DeviceState, TrackedDevice, one_frame

PORT = 9000
# Part of the body, as options name it → number of a tracker → point.
PARTS: dict[str, dict[str, str]] = {
    "hip": {"1": "pelvis"},
    "feet": {"2": "left_ankle", "3": "right_ankle"},
    "knees": {"4": "left_knee", "5": "right_knee"},
    "chest": {"6": "spine3"},
    "elbows": {"7": "left_elbow", "8": "right_elbow"},
}
ADVISED = ("hip", "feet")  # by VRChat's documentation, if positions are inaccurate


def vrchat_packets(
    pose: Pose, world: tuple[np.ndarray, np.ndarray] | None = None, parts: Collection[str] = ADVISED
) -> list[bytes]:
    """Return one pose as OSC packets: the trackers of `parts` (keys of `PARTS`), and the head.

    `world`: positions (P, 3) m of the points and rotations (J, 4) wxyz of the joints, computed if omitted. Raises
    BodysenseError for a skeleton that lacks a joint, and unless the pose is one finite frame.
    """
    one_finite_pose(pose)
    points, turns = forward_kinematics(pose) if world is None else world
    wanted = {number: point for part, named in PARTS.items() if part in parts for number, point in named.items()}
    wanted["head"] = "head"  # the joint, not the eyes: VRChat aligns it with the avatar's head bone
    places = pose.skeleton.indices(list(wanted.values()))
    joints = pose.skeleton.indices([TURNED_BY.get(point, point) for point in wanted.values()])
    return _form(tuple(wanted)).filled(np.hstack([unity_position(points[places]), unity_euler(turns[joints])]).ravel())


def parts_of(text: str) -> tuple[str, ...]:
    """Return the parts of a list such as "hip,feet". Raises BodysenseError, naming the option, for any other."""
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in PARTS:
            raise BodysenseError(
                f"--vrchat-trackers {text}: {name!r} is not a tracker of VRChat; give a list of {', '.join(PARTS)}"
            )
    return names


@lru_cache(maxsize=64)
def _form(trackers: tuple[str, ...]) -> PacketForm:
    """Return the packet of these trackers with positions and angles to be filled in."""
    rows = [(f"/tracking/trackers/{name}/{what}", "fff", ()) for name in trackers for what in ("position", "rotation")]
    return PacketForm(rows)


VRCHAT_POINTS = ("headset", "left_wrist", "right_wrist")
_POSES = {
    f"/tracking/vrsystem/{part}/pose": point
    for part, point in zip(("head", "leftwrist", "rightwrist"), VRCHAT_POINTS, strict=True)
}
ACCEPTED_ADDRESSES = {address: OscAddress("ffffff", "position in m, Euler angles in degrees") for address in _POSES} | {
    "/bodysense/calibrate": OscAddress("N", "stand upright and still for a second"),
    "/bodysense/recentre": OscAddress("N", "use the wearer's position and heading as the origin"),
}


@dataclass(frozen=True, eq=False)
class VrchatState:
    """Head and wrists received so far, by point."""

    devices: DeviceState = DeviceState()


@dataclass(frozen=True)
class VrchatReader(DeviceReader):
    """The decoder of VRChat's packets."""

    initial_state: ClassVar = VrchatState()

    def take(self, packet: bytes, now: float, state: VrchatState) -> tuple[VrchatState, str | None]:
        """Read a packet received at `now` s. Return the next state, and a reason if any of it is invalid."""
        messages = read_packet(packet)
        if isinstance(messages, str):
            return state, messages
        seen, wrong = dict(state.devices.devices), None
        for message in messages:
            if message.address in _POSES:
                found = _pose(message, now)
                if isinstance(found, str):
                    wrong = found
                else:
                    seen[_POSES[message.address]] = found
        return VrchatState(DeviceState(seen)), wrong

    def tracked(self, now: float, state: VrchatState) -> Observation | None:
        """Return one frame of `VRCHAT_POINTS`; None if no point is tracked."""
        seen = state.devices.devices.items()
        fresh = {point: one for point, one in seen if now - one.at <= self.devices.longest_silence}
        if not fresh:
            return None
        position, rotation = np.full((len(VRCHAT_POINTS), 3), np.nan), np.full((len(VRCHAT_POINTS), 4), np.nan)
        for point, one in fresh.items():
            k = VRCHAT_POINTS.index(point)
            position[k] = one.position
            if one.rotation is not None:
                rotation[k] = one.rotation
        return one_frame(VRCHAT_POINTS, position, rotation, max(one.at for one in fresh.values()))

    def commands(self, packet: bytes) -> list[Calibrate | Recentre]:
        """Return the commands in a packet."""
        return commands_of(packet)


def _pose(message: Message, now: float) -> TrackedDevice | str:
    """Return position and rotation of a message, or a reason if it is malformed."""
    numbers = message.arguments
    if len(numbers) != 6 or not all(isinstance(x, float) for x in numbers):
        return f"{message.address} is not three coordinates and three angles"
    values = np.array(numbers, dtype=float)
    if not np.isfinite(values).all() or np.abs(values[:3]).max() > FARTHEST:
        return f"{message.address} is not finite, or farther than {FARTHEST:g} m away"
    turn = None
    if _POSES[message.address] == "headset":
        # Unity's Euler angles x, y, z in degrees, applied about Z, then X, then Y, in a left-handed world.
        turned = euler_to_quaternion(np.deg2rad(np.remainder(values[3:], 360.0))[[1, 0, 2]], "YXZ")
        turn = turned_about(turned * np.array([1.0, 1.0, -1.0, -1.0]))  # a headset's −Z is forward
    return TrackedDevice(_POSES[message.address], unity_position(values[:3]), turn, now, raw=True)
