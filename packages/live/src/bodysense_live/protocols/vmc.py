"""VMC (Virtual Motion Capture protocol): bones sent to avatars, devices read from senders (docs/avatars.md).

Source: protocol.vmc.info, *Marionette*: Root/Pos (2.0) and Bone/Pos, named like Unity's `HumanBodyBones`, local to the
parent, quaternions x, y, z, w, then /VMC/Ext/OK (2.5) and T. Rotations are relative to VRM's T-pose.

A pose is one datagram of about 4.4 kB, because some receivers use the bones after each datagram. OK and T come last,
because others keep the bones that they have when OK or T arrives.

Headset, controllers and trackers arrive as /VMC/Ext/Hmd|Con|Tra/Pos and …/Pos/Local. `VmcTrackers` reads packets and
opens no socket. Messages may be lost, doubled, late or malformed: a packet with an older /VMC/Ext/T than the last is
dropped, a malformed one is refused with a reason, and nothing raises. `tracked_devices` assigns devices to points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import normalize
from bodysense.io.formats.gltf.humanoid import VRM_BONES, check_humanoid, t_posed, unity_bone
from bodysense.io.formats.osc import LARGEST, Argument, Message, PacketForm, read_packet
from bodysense.io.formats.unity import from_unity_rotation, one_finite_pose, unity_position, unity_rotation
from bodysense_live.protocols.osc_commands import COMMANDS, commands_of
from bodysense_live.server.messages import Calibrate, Recentre
from bodysense_live.sessions.tracked_devices import MOST_DEVICES, DeviceReader, DeviceState, TrackedDevice, pose_of

PORT = 39539  # of receivers ("marionettes")
_SEVEN = "s" + 7 * "f"
_CALIBRATED, _NORMAL = 3, 0


def vmc_packets(pose: Pose, time: float, tracked: bool = True) -> list[bytes]:
    """Return one pose as OSC packets, each for one datagram; `time` (s) is the sender's.

    The root stays at the origin; the hips have the body's position. `tracked` is false if the body's signals are lost.
    Raises BodysenseError for a skeleton without the bones of a humanoid, and unless the pose is one finite frame.
    """
    one_finite_pose(pose)
    joints = _joints(pose.skeleton)
    posed = t_posed(pose)
    place = posed.skeleton.rest_offset[: len(pose.skeleton.joints)].copy()
    place[0] = pose.root_position
    values = np.concatenate([unity_position(place), unity_rotation(normalize(posed.rotation))], axis=1)
    return _form(tracked).filled(np.append(values[joints], time))


@lru_cache(maxsize=64)
def _joints(skeleton: Skeleton) -> np.ndarray:
    """Return the joints (52,) to send."""
    check_humanoid(skeleton)
    return skeleton.indices(list(VRM_BONES))


@lru_cache
def _form(tracked: bool) -> PacketForm:
    """Return the packet of a pose with the bones' poses and the time to be filled in."""
    return PacketForm(
        [
            ("/VMC/Ext/Root/Pos", _SEVEN, ("root", 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)),
            *(("/VMC/Ext/Bone/Pos", _SEVEN, (unity_bone(bone),)) for bone in VRM_BONES.values()),
            ("/VMC/Ext/OK", "iiii", (1, _CALIBRATED, _NORMAL, int(tracked))),
            ("/VMC/Ext/T", "f", ()),
        ],
        LARGEST,
    )


_KINDS = {f"/VMC/Ext/{kind}/Pos{tail}": (kind, bool(tail)) for kind in ("Hmd", "Con", "Tra") for tail in ("", "/Local")}
# The argument of VMC's calibration, a mode (0 usual, 1 and 2 for mixed reality), is ignored.
_VMC_COMMANDS: dict[str, Calibrate | Recentre] = {**COMMANDS, "/VMC/Ext/Set/Calib/Exec": Calibrate()}
_MOST_POSES = 4 * MOST_DEVICES  # poses in a packet
_LONGEST_SERIAL = 128


@dataclass(frozen=True, eq=False)
class VmcState:
    """The devices received so far, and the sender's clock."""

    devices: DeviceState = DeviceState()
    clock: float | None = None  # s, sender's time of the newest packet with one


@dataclass(frozen=True)
class VmcTrackers(DeviceReader):
    """The decoder of VMC's packets, as the module describes it."""

    initial_state: ClassVar = VmcState()
    longest_delay: float = 1.0  # s; if a sender's clock goes back by more, it was restarted

    def take(self, packet: bytes, now: float, state: VmcState) -> tuple[VmcState, str | None]:
        """Read a packet received at `now` s. Return the next state, and a reason if any of it is invalid."""
        messages = read_packet(packet)
        if isinstance(messages, str):
            return state, messages
        rows = [message for message in messages if message.address in _KINDS]
        if len(rows) > _MOST_POSES:
            return state, f"more than {_MOST_POSES} devices in one packet"
        times = (one.arguments for one in messages if one.address == "/VMC/Ext/T")
        clock = next((float(given[0]) for given in times if given and _finite(given[:1])), None)  # type: ignore[arg-type]
        if clock is not None:
            if state.clock is not None and 0 < state.clock - clock <= self.longest_delay:
                return state, f"late: sent at {clock:g} s, after one of {state.clock:g} s"
            state = replace(state, clock=clock)
        found = [_device(message, now) for message in rows]
        wrong = [one for one in found if isinstance(one, str)]
        devices, reason = self.devices.put([one for one in found if not isinstance(one, str)], state.devices)
        return replace(state, devices=devices), reason or (wrong[-1] if wrong else None)

    def commands(self, packet: bytes) -> list[Calibrate | Recentre]:
        """Return the commands in a packet: VMC's calibration, or ours."""
        return commands_of(packet, _VMC_COMMANDS)


def _device(message: Message, now: float) -> tuple[str, TrackedDevice] | str:
    """Return serial and pose of a message, or a reason. Arguments after the eighth are ignored, as VMC demands."""
    serial, numbers = message.arguments[0] if message.arguments else None, message.arguments[1:8]
    if not isinstance(serial, str) or len(serial) > _LONGEST_SERIAL or len(numbers) < 7 or not _finite(numbers):
        return f"{message.address} is not a serial, three coordinates and a quaternion"
    pose = pose_of(numbers, f"{message.address}: {serial!r}")
    if isinstance(pose, str):
        return pose
    (place, turn), (kind, raw) = pose, _KINDS[message.address]
    rotation = None if turn is None else from_unity_rotation(turn)
    return serial, TrackedDevice(kind, unity_position(place), rotation, now, raw)


def _finite(values: tuple[Argument, ...]) -> bool:
    return all(isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < np.inf for x in values)
