"""VMC as a subject: the messages that an avatar program receives on a UDP port."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import normalize, quaternion_multiply, quaternion_rotate
from bodysense.io.formats.gltf.humanoid import VRM_BONES, unity_bone
from bodysense.io.formats.osc import LARGEST, Message, read_packet
from bodysense.io.formats.unity import from_unity_rotation, unity_position
from bodysense_conform.subject import Subject, Transport, nearest_ancestor, ordered, points_subject

_OURS = {unity_bone(bone): joint for joint, bone in VRM_BONES.items()}
_TRANSFORM = 8  # arguments: a name and seven numbers
Packet = tuple[float, bytes]  # s of its arrival, and its bytes


def record_vmc(source: str, seconds: float) -> Subject:
    """Listen on `vmc:PORT` or `vmc:ADDRESS:PORT` for some seconds. Raises BodysenseError if no body arrives."""
    host, _, port = source.removeprefix("vmc:").removeprefix("//").rpartition(":")
    if not port.isdecimal() or not 0 < int(port) < 65536:
        raise BodysenseError(f"{source}: no port of UDP; give vmc:39539, or vmc:ADDRESS:PORT")
    packets: list[Packet] = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind((host or "127.0.0.1", int(port)))
        except OSError as error:
            raise BodysenseError(
                f"{source}: {error.strerror or error}; choose another port, or stop the program that has it"
            ) from None
        end = time.monotonic() + seconds
        with suppress(TimeoutError):
            while (remaining := end - time.monotonic()) > 0:
                receiver.settimeout(remaining)
                data = receiver.recv(LARGEST)
                packets.append((time.monotonic(), data))
    if not packets:
        raise BodysenseError(f"{source}: nothing came in {seconds:g} s; start the sender, and let it send to this port")
    return vmc_subject(packets, source)


def vmc_subject(packets: Sequence[Packet], name: str) -> Subject:
    """Return packets as a subject; a frame ends when a bone repeats. Raises BodysenseError if there is no body."""
    frames: list[dict[str, np.ndarray]] = []
    times: list[float] = []
    current: dict[str, np.ndarray] = {}
    clock: float | None = None
    malformed = 0
    for arrival, data in packets:
        found = read_packet(data)
        if isinstance(found, str):
            malformed += 1
            continue
        for message in found:  # of all bones in the packet: senders put it before or after them
            if message.address == "/VMC/Ext/T" and message.arguments and isinstance(message.arguments[0], (int, float)):
                clock = float(message.arguments[0])
                break
        for joint, values in filter(None, map(_bone, found)):
            if joint in current and joint != "root":
                frames.append(current)
                current = {"root": current["root"]} if "root" in current else {}
            if len(times) == len(frames):
                times.append(arrival if clock is None else clock)
            current[joint] = values
    # The last frame may be cut off by the end of the recording.
    names = ordered({joint for frame in frames for joint in frame})
    if len(frames) < 2 or "pelvis" not in names:
        raise BodysenseError(
            f"{name}: {len(packets)} packets with {len(frames)} frames of bones; send VMC's bones to it"
        )
    there = np.array([[joint in frame for joint in names] for frame in frames])
    position, rotation = _world_poses(frames, names)
    time, rotated = np.array(times[: len(frames)]), np.ones(len(names), dtype=bool)
    subject = points_subject(name, "VMC", names, time, position, rotation, rotated, there)
    return replace(subject, transport=Transport(messages=len(packets), malformed=malformed))


def _bone(message: Message) -> tuple[str, np.ndarray] | None:
    """Return the joint, or 'root', of a message, and its seven numbers."""
    values = message.arguments
    if message.address not in ("/VMC/Ext/Root/Pos", "/VMC/Ext/Bone/Pos") or len(values) < _TRANSFORM:
        return None
    numbers = values[1:_TRANSFORM]
    if not all(isinstance(number, (int, float)) for number in numbers):
        return None
    joint = "root" if message.address == "/VMC/Ext/Root/Pos" else _OURS.get(str(values[0]))
    return None if joint is None else (joint, np.array(numbers, dtype=float))


def _world_poses(frames: list[dict[str, np.ndarray]], names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Convert frames of bones, local to their parents, to world positions (T, P, 3) and rotations (T, P, 4)."""
    unknown, still = np.full(7, np.nan), np.array([0, 0, 0, 0, 0, 0, 1.0])
    table = np.array([[frame.get("root", still), *(frame.get(joint, unknown) for joint in names)] for frame in frames])
    moves, turns = unity_position(table[..., :3]), from_unity_rotation(table[..., 3:])
    position, rotation = {"root": moves[:, 0]}, {"root": turns[:, 0]}
    for k, joint in enumerate(names, start=1):
        parent = nearest_ancestor(joint, names) or "root"
        unit = normalize(rotation[parent])  # children hang on rotations of unit length, whatever the joint's own is
        position[joint] = position[parent] + quaternion_rotate(unit, moves[:, k])
        rotation[joint] = quaternion_multiply(unit, turns[:, k])
    places, turned = ([values[joint] for joint in names] for values in (position, rotation))
    return np.stack(places, axis=1), np.stack(turned, axis=1)
