"""Every packet that goes out is read by decoders that are not ours, as it was meant: python-osc and Wireshark's.

BODYSENSE_PACKETS=1000000 pytest -m slow -s tests/serve/test_decoders.py
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from pythonosc.osc_packet import OscPacket

from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.rotation import quaternion_exp, quaternion_multiply
from bodysense.body.skeleton import default_skeleton
from bodysense.serve import vmc, vrchat
from bodysense.serve.osc import read_packet
from bodysense.serve.vmc import vmc_packets
from bodysense.serve.vmt import DRIVER_PORT, tracker_packet
from bodysense.serve.vmt_hands import hand_packet
from bodysense.serve.vrchat import vrchat_packets

from .test_wireshark import capture

COUNT = int(os.environ.get("BODYSENSE_PACKETS", "3000"))
HANDS_EVERY = 64  # poses: they take longest
AT_ONCE = 20_000  # packets that Wireshark is given at a time
SKELETON = default_skeleton()


@dataclass(frozen=True)
class Sent:
    """A packet and the port that it goes to."""

    data: bytes
    port: int


def packets(rng: np.random.Generator) -> Iterator[Sent]:
    """Packets of bodies in any pose, without end: VMC, VRChat, VMT's trackers and hands."""
    frame, standing = 0, standing_pose(SKELETON)
    while True:
        turns = quaternion_exp(rng.normal(0, 0.4, (len(SKELETON.joints), 3)))
        pose = Pose(SKELETON, rng.uniform(-5, 5, 3), quaternion_multiply(standing.rotation, turns))
        position, rotation = (np.asarray(values) for values in forward_kinematics(pose))
        yield from (Sent(data, vmc.PORT) for data in vmc_packets(pose, frame / 72))
        yield from (Sent(data, vrchat.PORT) for data in vrchat_packets(pose, (position, rotation)))
        places = dict(zip(SKELETON.points, position, strict=True))
        joints = dict(zip(SKELETON.joints, rotation, strict=True))
        yield Sent(tracker_packet(0, places, joints), DRIVER_PORT)
        if frame % HANDS_EVERY == 0:
            yield Sent(hand_packet("left", 8, SKELETON, places, joints), DRIVER_PORT)
            yield Sent(hand_packet("right", 9, SKELETON, places, joints), DRIVER_PORT)
        frame += 1


def chunks() -> Iterator[list[Sent]]:
    """`COUNT` packets, some at a time."""
    endless = packets(np.random.default_rng(1))
    for start in range(0, COUNT, AT_ONCE):
        yield [next(endless) for _ in range(min(AT_ONCE, COUNT - start))]


@pytest.mark.slow
def test_python_osc_reads_every_packet_as_it_was_meant() -> None:
    read = messages = 0
    for part in chunks():
        for sent in part:
            theirs, ours = [one.message for one in OscPacket(sent.data).messages], read_packet(sent.data)
            assert not isinstance(ours, str)
            assert [(one.address, tuple(one.params)) for one in theirs] == [
                (one.address, one.arguments) for one in ours
            ]
            read, messages = read + 1, messages + len(theirs)
    print(f"python-osc read {read} of {COUNT} packets, {messages} messages")
    assert read == COUNT


@pytest.mark.slow
def test_wireshark_reads_every_packet(tmp_path: Path) -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("no tshark on this machine: apt-get install tshark")
    read = messages = 0
    for part in chunks():
        path = tmp_path / "sent.pcap"
        for port in sorted({sent.port for sent in part}):
            data = [sent.data for sent in part if sent.port == port]
            path.write_bytes(capture(data, port))
            fields = ("-e", "osc.message.header.path", "-e", "_ws.malformed", "-e", "_ws.expert.severity")
            command = [tshark, "-n", "-r", str(path), "--enable-heuristic", "osc_udp", "-T", "fields", *fields]
            ran = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
            rows = [row.split("\t") for row in ran.stdout.splitlines()]
            assert len(rows) == len(data)
            for packet, (paths, *faults) in zip(data, rows, strict=True):
                ours = read_packet(packet)
                assert not isinstance(ours, str)
                assert paths.split(",") == [one.address for one in ours] and not any(faults)
                read, messages = read + 1, messages + len(ours)
    print(f"Wireshark read {read} of {COUNT} packets, {messages} messages")
    assert read == COUNT
