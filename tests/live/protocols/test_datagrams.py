"""UDP inputs and outputs of a real server: trackers by VMC, markers by OSC, poses to an avatar."""

from __future__ import annotations

import asyncio
import socket
import time

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove, glove_points, marker_positions
from bodysense.body.hands.glove_set import standard_set
from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.pose import Pose
from bodysense.body.skeleton import default_skeleton
from bodysense.io.formats.osc import bundled, message_bytes
from bodysense.io.formats.protocol import SignalFrame
from bodysense_live.protocols.datagrams import MarkerInput, Receiver
from bodysense_live.protocols.links import DeviceInput
from bodysense_live.protocols.vmc import VmcTrackers
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.tracked_devices import SIGNALS

from ..conftest import Connecting, Serving, free_port, signal


def test_poses_are_sent_to_an_avatar(server_of: Serving, connect: Connecting) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as avatar:
        avatar.bind(("127.0.0.1", 0))
        avatar.settimeout(10)
        receivers = (
            Receiver("vmc", "127.0.0.1", avatar.getsockname()[1]),
            Receiver("vrchat", "127.0.0.1", free_port()),
        )
        client = connect(server_of(ServerSettings(receivers=receivers)))
        client.answered(signal(0, 0.0))
        assert b"/VMC/Ext/" in avatar.recv(8000)
        client.answered(signal(1, 0.1))


def test_trackers_by_vmc_and_malformed_packets(server_of: Serving, connect: Connecting) -> None:
    from pythonosc.udp_client import SimpleUDPClient

    port = free_port()
    server = server_of(ServerSettings(vmc_in=port))
    client = connect(server, points=(), watch="vmc")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hostile:
        hostile.sendto(b"\x00" * 20, ("127.0.0.1", port))
        hostile.sendto(b"#bundle\x00" + b"\xff" * 20, ("127.0.0.1", port))
    sender = SimpleUDPClient("127.0.0.1", port)
    for _ in range(5):
        sender.send_message("/VMC/Ext/Hmd/Pos", ["HMD", 0.5, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0])
        time.sleep(0.02)
    pose = client.pose()
    head = default_skeleton().index("head")
    assert pose.hidden[head] < 0.5
    sender._sock.close()


def test_markers_by_osc(server_of: Serving, connect: Connecting) -> None:
    from bodysense_live.protocols.marker_stream import write_frame

    port = free_port()
    client = connect(server_of(ServerSettings(markers_in=port)), points=(), watch="markers")
    hand = hand_skeleton(default_skeleton(), "left")
    still = np.zeros((len(hand.joints), 4))
    still[:, 0] = 1
    places = np.asarray(marker_positions(default_glove(), Pose(hand, np.array([0.4, 1.2, 0.3]), still)))
    markers = dict(zip(glove_points("left"), places, strict=True))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for k in range(5):
            sender.sendto(write_frame(k / 60, markers), ("127.0.0.1", port))
            time.sleep(0.02)
    pose = client.pose()
    assert np.isfinite(pose.rotation).all()


@pytest.mark.parametrize("kind", ["vmc", "markers"])
def test_a_flood_of_packets_is_dropped(kind: str) -> None:
    metrics = Metrics()

    async def flooded() -> None:
        played: list[SignalFrame] = []
        vmc = DeviceInput(played.append, metrics, VmcTrackers(), SIGNALS)
        receiver = vmc if kind == "vmc" else MarkerInput(played.append, metrics, standard_set())
        for _ in range(10_000):
            receiver.datagram_received(b"/nothing", None)

    asyncio.run(flooded())
    counted = metrics.text()[0].decode()
    dropped = {
        reason: float(counted.split(f'bodysense_drops_total{{reason="{reason}"}} ')[1].split()[0])
        for reason in ("flood", "malformed packet")
    }
    assert sum(dropped.values()) == 10_000
    assert dropped["malformed packet"] < 8_000  # a burst, and packets that arrive while it is read


def test_hostile_packets_are_counted(server_of: Serving, connect: Connecting) -> None:
    port = free_port()
    client = connect(server_of(ServerSettings(vmc_in=port)))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as hostile:
        for packet in (b"", b"/a", b"\xff" * 2000):
            hostile.sendto(packet, ("127.0.0.1", port))
    assert client.answered(signal(0, 0.0)).sequence == 0


def test_a_complete_packet_is_a_frame_at_once_and_partial_ones_are_grouped() -> None:
    async def frames(*packets: tuple[str, ...]) -> list[int]:
        """Return the number of frames after each packet."""
        played: list[SignalFrame] = []
        reader = DeviceInput(played.append, Metrics(), VmcTrackers(), SIGNALS)
        found = []
        for serials in packets:
            rows = [message_bytes(f"/VMC/Ext/{kind}/Pos", "sfffffff", kind, *POSE) for kind in serials]
            reader.datagram_received(bundled(rows)[0], None)
            found.append(len(played))
        await asyncio.sleep(0.02)
        return [*found, len(played)]

    assert asyncio.run(frames(("Hmd", "Con"), ("Hmd", "Con"))) == [1, 2, 2]
    assert asyncio.run(frames(("Hmd",), ("Con",), ("Tra",))) == [1, 1, 1, 2]  # a single device is a complete packet


POSE = (0.0, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0)
