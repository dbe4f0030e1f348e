"""VMC as a subject: the messages that an avatar program receives on a UDP port."""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence

import numpy as np

from bodysense.body.rotation import normalize, quaternion_multiply, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.gltf.humanoid import VRM_BONES, unity_bone
from bodysense.io.osc import LARGEST, Message, read_packet
from bodysense.io.unity import from_unity_rotation, unity_position
from bodysense_conform.subject import Subject, Transport, ordered

_OURS = {unity_bone(bone): joint for joint, bone in VRM_BONES.items()}
_TRANSFORM = 8  # arguments: a name and seven numbers
Packet = tuple[float, bytes]  # s of its arrival, and its bytes


def record_vmc(source: str, seconds: float) -> Subject:
    """Listen on `vmc:PORT` or `vmc:ADDRESS:PORT` for some seconds. Raises BodysenseError if no body comes."""
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
        while (remaining := end - time.monotonic()) > 0:
            receiver.settimeout(remaining)
            try:
                data = receiver.recv(LARGEST)
            except TimeoutError:
                break
            packets.append((time.monotonic(), data))
    if not packets:
        raise BodysenseError(f"{source}: nothing came in {seconds:g} s; start the sender, and let it send to this port")
    return vmc_subject(packets, source)


def vmc_subject(packets: Sequence[Packet], name: str) -> Subject:
    """Return packets as a subject; a frame ends when a bone comes again. Raises BodysenseError if there is no body."""
    frames: list[dict[str, np.ndarray]] = []
    times: list[float] = []
    current: dict[str, np.ndarray] = {}
    clock: float | None = None
    malformed = messages = 0
    for arrival, data in packets:
        found = read_packet(data)
        messages += 1
        if isinstance(found, str):
            malformed += 1
            continue
        clock = _clock(found, clock)  # of all bones in the packet: senders put it before or after them
        for message in found:
            bone = _bone(message)
            if bone is None:
                continue
            joint, values = bone
            if joint in current and joint != "root":
                frames.append(current)
                current = {"root": current["root"]} if "root" in current else {}
            if len(times) == len(frames):
                times.append(arrival if clock is None else clock)
            current[joint] = values
    # The last frame may be cut off by the end of the recording.
    times = times[: len(frames)]
    names = ordered(sorted({joint for frame in frames for joint in frame} - {"root"}))
    if len(frames) < 2 or "pelvis" not in names:
        raise BodysenseError(
            f"{name}: {len(packets)} packets with {len(frames)} frames of bones; send VMC's bones to it"
        )
    return _placed(frames, np.array(times), names, name, Transport(messages=messages, malformed=malformed))


def _clock(messages: Sequence[Message], before: float | None) -> float | None:
    """Return the sender's time (s) in a packet, or the time before if the packet has none."""
    for message in messages:
        if message.address == "/VMC/Ext/T" and message.arguments and isinstance(message.arguments[0], (int, float)):
            return float(message.arguments[0])
    return before


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


def _placed(
    frames: list[dict[str, np.ndarray]], times: np.ndarray, names: tuple[str, ...], name: str, transport: Transport
) -> Subject:
    """Return frames of bones, local to their parents, as places in the world."""
    table = np.full((len(frames), len(names) + 1, 7), np.nan)
    for k, frame in enumerate(frames):
        table[k, 0] = frame.get("root", [0, 0, 0, 0, 0, 0, 1.0])
        for p, joint in enumerate(names, start=1):
            if joint in frame:
                table[k, p] = frame[joint]
    move, turn = unity_position(table[..., :3]), from_unity_rotation(table[..., 3:])
    ours = default_skeleton()
    position, rotation = np.full_like(move, np.nan), np.full_like(turn, np.nan)
    unit = np.full_like(turn, np.nan)  # children hang on rotations of unit length, whatever the joint's own length is
    position[:, 0], rotation[:, 0], unit[:, 0] = move[:, 0], turn[:, 0], normalize(turn[:, 0])
    for p, joint in enumerate(names, start=1):
        above = ours.parents[ours.index(joint)]
        while above >= 0 and ours.points[above] not in names:
            above = ours.parents[above]
        parent = names.index(ours.points[above]) + 1 if above >= 0 else 0
        position[:, p] = position[:, parent] + quaternion_rotate(unit[:, parent], move[:, p])
        rotation[:, p] = quaternion_multiply(unit[:, parent], turn[:, p])
        unit[:, p] = normalize(rotation[:, p])
    there = np.array([[joint in frame for joint in names] for frame in frames])
    return Subject(
        name=name,
        format="VMC",
        points=names,
        time=times,
        position=position[:, 1:],
        rotation=rotation[:, 1:],
        rotated=np.ones(len(names), dtype=bool),
        valid=there,
        transport=transport,
    )
