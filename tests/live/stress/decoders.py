"""Independent decoders for every packet that the server sends.

python-osc and Wireshark read OSC (VMC, VRChat, VMT), a reader of the public schema reads SolarXR.
"""

from __future__ import annotations

import struct
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError, missing_package
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.io.formats.osc import read_packet
from bodysense_live.protocols import vmc, vrchat
from bodysense_live.protocols.solarxr.runtime_messages import Updates
from bodysense_live.protocols.solarxr.solarxr_body import BodyFrame, body_frame, body_layout
from bodysense_live.protocols.steamvr.vmt import DRIVER_PORT, tracker_packet
from bodysense_live.protocols.steamvr.vmt_hands import hand_packet
from bodysense_live.protocols.vmc import vmc_packets
from bodysense_live.protocols.vrchat import vrchat_packets
from bodysense_live.protocols.webxr import between_eyes

from ..protocols.solarxr.client import update

AT_ONCE = 20_000  # packets in one capture for Wireshark
_POSES = 256  # poses that are generated at a time
_HANDS_EVERY = 8  # poses between two with hands, which take longest
_SENT_FROM = 50000  # source port


@dataclass(frozen=True)
class Sent:
    """A packet, its destination port, and its body if it is of SolarXR."""

    data: bytes
    port: int
    body_frame: BodyFrame | None = None


@dataclass
class Decoded:
    """Counts of correctly decoded packets and their messages."""

    osc: int = 0
    osc_messages: int = 0
    wireshark: int = 0  # also counted in osc; 0 without Wireshark
    solarxr: int = 0


def sent_packets(rng: np.random.Generator) -> Iterator[Sent]:
    """Yield packets of every output protocol, of bodies in random poses, without end."""
    skeleton, time = default_skeleton(), 0.0
    standing, eyes = standing_pose(skeleton).rotation, between_eyes(skeleton)
    updates = Updates(body_layout(skeleton, eyes))
    while True:
        turns = quaternion_exp(rng.normal(0, 0.4, (_POSES, len(skeleton.joints), 3)))
        poses = Pose(skeleton, rng.uniform(-5, 5, (_POSES, 3)), quaternion_multiply(standing, turns))
        position, rotation = (np.asarray(values) for values in forward_kinematics(poses))
        for k in range(_POSES):
            time += 1 / 72
            yield from (Sent(data, vmc.PORT) for data in vmc_packets(poses[k], time))
            yield from (Sent(data, vrchat.PORT) for data in vrchat_packets(poses[k], (position[k], rotation[k])))
            places = dict(zip(skeleton.points, position[k], strict=True))
            joints = dict(zip(skeleton.joints, rotation[k], strict=True))
            yield Sent(tracker_packet(0, places, joints), DRIVER_PORT)
            hands = ("left", "right") if k % _HANDS_EVERY == 0 else ()
            yield from (
                Sent(hand_packet(side, 8 + n, skeleton, places, joints), DRIVER_PORT) for n, side in enumerate(hands)
            )
            body = body_frame(places, joints, eyes)
            yield Sent(updates.packet(body), 0, body)


def decode(count: int, rng: np.random.Generator, tshark: str | None) -> Iterator[Decoded]:
    """Decode `count` packets and yield the counts after every part.

    `tshark` is Wireshark's program, which decodes in parallel; None: without Wireshark. Raises BodysenseError for a
    packet that is decoded differently.
    """
    endless, found = sent_packets(rng), Decoded()
    for start in range(0, count, AT_ONCE):
        part = [next(endless) for _ in range(min(AT_ONCE, count - start))]
        osc = [sent for sent in part if sent.body_frame is None]
        meant = [_meant(sent.data) for sent in osc]
        with ExitStack() as stack:
            reading = None if tshark is None else stack.enter_context(_wireshark(tshark, osc))
            for sent, messages in zip(osc, meant, strict=True):
                if _python_osc(sent.data) != messages:
                    raise BodysenseError(f"python-osc reads it differently: {sent.data.hex()}")
            found.osc, found.osc_messages = found.osc + len(osc), found.osc_messages + sum(map(len, meant))
            for sent in part:
                found.solarxr += sent.body_frame is not None and _reads_body(sent.data, sent.body_frame)
            if reading is not None:
                found.wireshark += reading([[address for address, _ in messages] for messages in meant])
        yield found


def _meant(data: bytes) -> list[tuple[str, list[object]]]:
    messages = read_packet(data)
    if isinstance(messages, str):
        raise BodysenseError(f"a packet of ours: {messages}: {data.hex()}")
    return [(one.address, list(one.arguments)) for one in messages]


def _python_osc(data: bytes) -> list[tuple[str, list[object]]]:
    try:
        from pythonosc.osc_packet import OscPacket
    except ImportError as error:
        raise missing_package(error) from None
    return [(one.message.address, one.message.params) for one in OscPacket(data).messages]


def _reads_body(data: bytes, body: BodyFrame) -> bool:
    """Check that every number of an update equals the body's; raises BodysenseError if not."""
    decoded = update(data)
    for rows, slots, values in (
        (decoded.rows(1), ((4, 3), (3, 4)), (body.tracker_position, body.tracker_rotation)),
        (decoded.rows(2), ((3, 3), (1, 4)), (body.bone_start[:-1], body.bone_rotation[:-1])),
    ):
        for (slot, size), wanted in zip(slots, values, strict=True):
            read = np.array([row.floats(slot, size) for row in rows], dtype=np.float32)
            if not np.array_equal(read, wanted.astype(np.float32)):
                raise BodysenseError(f"a reader of SolarXR reads it differently: {data.hex()}")
    return True


@contextmanager
def _wireshark(tshark: str, sent: Sequence[Sent]) -> Iterator[Callable[[Sequence[Sequence[str]]], int]]:
    """Decode a capture of packets by Wireshark's OSC dissector in its own process.

    Yields a function that waits for it and returns the number of decoded packets. It raises BodysenseError for a packet
    with other addresses than those given, or with a fault.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bodysense-")))
        (folder / "sent.pcap").write_bytes(capture([(one.data, one.port) for one in sent]))
        fields = ("osc.message.header.path", "_ws.malformed", "_ws.expert.severity")
        command = [tshark, "-n", "-r", str(folder / "sent.pcap"), "--enable-heuristic", "osc_udp"]
        command += ["-T", "fields", *(word for field in fields for word in ("-e", field))]
        out = stack.enter_context((folder / "read.txt").open("w+"))
        process = stack.enter_context(subprocess.Popen(command, stdout=out, stderr=subprocess.DEVNULL, text=True))
        stack.callback(process.kill)

        def check(addresses: Sequence[Sequence[str]]) -> int:
            if process.wait():
                raise BodysenseError(f"{tshark} failed; run it by itself: {tshark} --version")
            out.seek(0)
            rows = [row.rstrip("\n").split("\t") for row in out]
            if len(rows) != len(addresses):
                raise BodysenseError(f"Wireshark reads {len(rows)} of {len(addresses)} packets")
            for (paths, *faults), wanted in zip(rows, addresses, strict=True):
                if paths.split(",") != wanted or any(faults):
                    raise BodysenseError(f"Wireshark reads {paths} {faults}, not {wanted}")
            return len(rows)

        yield check


def capture(packets: Sequence[tuple[bytes, int]]) -> bytes:
    """Return a capture file of UDP datagrams to loopback ports, in libpcap's format with raw IPv4 (link type 101)."""
    parts = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 101)]
    address = bytes([127, 0, 0, 1])
    for packet, port in packets:
        udp = struct.pack(">HHHH", _SENT_FROM, port, 8 + len(packet), 0) + packet
        ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, address, address) + udp
        parts.append(struct.pack("<IIII", 0, 0, len(ip), len(ip)) + ip)
    return b"".join(parts)
