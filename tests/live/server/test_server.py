"""A real server on loopback: sessions, resuming, recording, replay, metrics."""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
import time
import urllib.request
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.io.formats.bvh import read_bvh
from bodysense.io.formats.protocol import SIGNAL, TRUTH, read_pose, write_signal
from bodysense_live.server.messages import (
    Calibrate,
    Hello,
    Ping,
    RecordSwitch,
    Replay,
    Resume,
    Settings,
    UpdateSettings,
)
from bodysense_live.server.settings import ServerSettings
from bodysense_live.sessions.replay import Playable

from ..conftest import DEVICES, Address, Client, Connecting, Serving, signal


def stream(client: Client, frames: int, start: int = 0) -> list[float]:
    """Return the head's expected errors in the answers, m."""
    found = []
    for k in range(start, start + frames):
        pose = client.answered(signal(k, k / 72))
        assert np.isfinite(pose.rotation).all()
        found.append(float(pose.expected_error[0]))
    return found


def text_of(url: str) -> str:
    with urllib.request.urlopen(url, timeout=10) as response:
        return response.read().decode()


def test_a_session_from_hello_to_pose(server: Address, connect: Connecting) -> None:
    client = connect(server, height=1.8, name="me")
    assert client.welcome["height"] == pytest.approx(1.8) and client.welcome["name"] == "me"
    assert client.welcome["settings"]["height"] == 1.8 and not client.welcome["resumed"]
    pose = client.answered(signal(4, 0.5))
    assert (pose.sequence, pose.time) == (4, 0.5) and pose.microseconds > 0
    assert client.text("placed") == {"type": "placed", "offset": [0, 0, 0], "heading": 0}
    np.testing.assert_allclose(np.linalg.norm(pose.rotation, axis=1), 1, atol=1e-3)
    client.send_message(Ping(3.25))
    assert client.text("pong")["time"] == 3.25


def test_settings_are_answered_with_a_welcome(server: Address, connect: Connecting) -> None:
    client = connect(server)
    client.send_message(UpdateSettings({"height": 1.5, "mirror": True}))
    welcome = client.text("welcome")
    assert welcome["settings"]["mirror"] and welcome["height"] == pytest.approx(1.5)
    assert welcome["rest_offset"] != client.welcome["rest_offset"]
    client.send_message(Calibrate())
    assert "stand upright" in client.text("said")["text"]


def test_a_client_that_dies_within_a_frame_resumes(server: Address, connect: Connecting) -> None:
    """The connection ends in the middle of a WebSocket frame."""
    key = base64.b64encode(os.urandom(16)).decode()
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as raw:
        raw.sendall(
            f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        assert raw.recv(65536).startswith(b"HTTP/1.1 101")
        hello = json.dumps({"type": "hello", "version": 1, "points": DEVICES, "height": 1.9}).encode()
        raw.sendall(masked(0x81, hello))
        received = b""
        while b'"resumed":false' not in received:
            more = raw.recv(65536)
            assert more, received
            received += more
        body = received[received.index(b'{"type":"welcome"') :]
        welcome, _ = json.JSONDecoder().raw_decode(body.decode(errors="ignore"))
        for k in range(5):
            raw.sendall(masked(0x82, write_signal(signal(k, k / 72))))
        raw.sendall(masked(0x82, write_signal(signal(5, 5 / 72)))[:40])
    resume = Resume(welcome["session"], welcome["token"])
    client = connect(server, Hello(1, DEVICES, resume=resume))
    assert client.welcome["resumed"] and client.welcome["session"] == welcome["session"]
    assert client.welcome["height"] == pytest.approx(1.9)
    assert client.answered(signal(6, 6 / 72)).sequence == 6


def masked(first: int, payload: bytes) -> bytes:
    """Return a client's WebSocket frame (RFC 6455, section 5.2)."""
    mask = os.urandom(4)
    length = bytes([0x80 | len(payload)]) if len(payload) < 126 else b"\xfe" + struct.pack(">H", len(payload))
    return bytes([first]) + length + mask + bytes(b ^ mask[k % 4] for k, b in enumerate(payload))


def test_a_wrong_token_does_not_resume_a_session(server: Address, connect: Connecting) -> None:
    first = connect(server)
    second = connect(server, Hello(1, DEVICES, resume=Resume(first.welcome["session"], "x" * 22)))
    assert not second.welcome["resumed"] and second.welcome["session"] != first.welcome["session"]
    assert first.answered(signal(0, 0.0)).sequence == 0


def test_resuming_a_session_closes_its_earlier_connection(server: Address, connect: Connecting) -> None:
    from websockets import ConnectionClosed

    first = connect(server)
    second = connect(server, Hello(1, DEVICES, resume=Resume(first.welcome["session"], first.welcome["token"])))
    assert second.welcome["resumed"]
    with pytest.raises(ConnectionClosed):
        while True:
            first.socket.recv(timeout=10)
    assert second.answered(signal(1, 1.0)).sequence == 1


def test_a_client_that_does_not_read_loses_frames_and_uses_no_memory(server_of: Serving, connect: Connecting) -> None:
    import resource

    server = server_of()
    client, other = connect(server), connect(server)
    stream(other, 3)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for k in range(600):
        client.send(signal(k, k / 72))
        time.sleep(1 / 400)
        if k % 100 == 0:
            stream(other, 1, 10 + k)  # the other is answered meanwhile
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # KB
    pose = client.pose()
    while pose.sequence < 599:
        pose = client.pose()


def test_a_recording_is_written_if_it_is_allowed(server_of: Serving, connect: Connecting, tmp_path: Path) -> None:
    client = connect(server_of(ServerSettings(allow_record=tmp_path)))
    assert client.welcome["recording"]
    client.send_message(RecordSwitch(True))
    assert "recording to" in client.text("said")["text"]
    poses = [client.answered(signal(k, k / 60)) for k in range(90)]
    client.send_message(RecordSwitch(False))
    text = client.text("said")["text"]
    (file,) = tmp_path.iterdir()
    assert file.name in text and "/" not in text
    clip = read_bvh(file)
    assert len(clip) == pytest.approx(90, abs=2) and clip.frame_rate == pytest.approx(60)
    # The pelvis is as high as the proportions inferred at the end require.
    np.testing.assert_allclose(clip.pose.root_position[0], poses[0].root_position, atol=0.03)
    np.testing.assert_allclose(clip.pose.root_position[0, [0, 2]], poses[0].root_position[[0, 2]], atol=1e-4)


def test_no_recording_is_written_if_it_is_not_allowed(server: Address, connect: Connecting) -> None:
    client = connect(server)
    assert not client.welcome["recording"]
    client.send_message(RecordSwitch(True))
    assert "--allow-record" in client.text("said")["text"]


def playable(seconds: float = 2.0) -> Playable:
    skeleton, moments = default_skeleton(), np.arange(round(30 * seconds)) / 30
    standing = standing_pose(skeleton)
    root = standing.root_position + np.stack([0.1 * np.sin(moments), np.ones_like(moments), 0 * moments], axis=-1)
    pose = Pose(skeleton, root, np.tile(standing.rotation, (len(moments), 1, 1)))
    return Playable(observe(pose, moments, THREE_POINT), Person(skeleton), pose)


def test_a_replay_is_sent_with_its_true_poses(server_of: Serving, connect: Connecting) -> None:
    server = server_of(ServerSettings(playable=playable()))
    client = connect(server, points=(), watch="replay")
    assert client.welcome["sources"] == ["replay"] and client.welcome["signal"] == ["head", "left_wrist", "right_wrist"]
    assert client.welcome["length"] == pytest.approx(59 / 30)
    points = len(client.welcome["points"])
    begun = time.monotonic()
    first, truth, pose = client.frame(SIGNAL), read_pose(client.frame(TRUTH), points), client.pose()
    assert pose.sequence == truth.sequence == int.from_bytes(first[4:8], "little")
    head = default_skeleton().index("head")
    heads = [forward_kinematics(Pose(default_skeleton(), p.root_position, p.rotation))[0][head] for p in (truth, pose)]
    np.testing.assert_allclose(heads[0], heads[1], atol=0.05)
    while pose.time < 1.0:
        pose = client.pose()
    assert time.monotonic() - begun > 0.5
    client.send_message(Replay(playing=False, time=0.5))
    time.sleep(0.3)
    client.send_message(Replay(playing=True, speed=0.5))
    while not 0.5 <= pose.time < 0.9:
        pose = client.pose()


def test_a_doubt_about_the_world_reaches_its_client_and_whoever_watches_later(
    server: Address, connect: Connecting
) -> None:
    client = connect(server)
    for k in range(4):
        one = signal(k, 0.6 * k)
        client.answered(replace(one, position=one.position * 100))
    said = client.text("said")["text"]
    assert "unit='cm'" in said
    follow = Resume(client.welcome["session"], client.welcome["watch_token"])
    assert connect(server, points=(), follow=follow).text("said")["text"] == said


def test_an_input_that_the_server_lacks_cannot_be_watched(server: Address, connect: Connecting) -> None:
    with pytest.raises(AssertionError, match="it has none"):
        connect(server, points=(), watch="vmc")


def test_each_watcher_of_a_replay_has_its_own_settings(server_of: Serving, connect: Connecting) -> None:
    server = server_of(ServerSettings(playable=playable()))
    hidden = connect(server, points=(), watch="replay", settings=Settings(hidden=("left_wrist", "right_wrist")))
    whole = connect(server, points=(), watch="replay")
    wrist = default_skeleton().index("left_wrist")
    assert hidden.pose().hidden[wrist] > 0.5 > whole.pose().hidden[wrist]


def test_metrics(server: Address, connect: Connecting) -> None:
    stream(connect(server), 3)
    text = text_of(f"{server.http}/metrics")
    assert text_of(f"{server.http}/healthz") == "ok\n"
    for name in ("bodysense_sessions ", "bodysense_frames_total ", "bodysense_frame_seconds_bucket", "bodysense_drops"):
        assert name in text
    assert 'reason="slow client"' in text
