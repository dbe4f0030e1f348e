"""`bench live`: its clients use WebSocket, and its numbers are measured on a real server."""

from __future__ import annotations

import json
import socket
from pathlib import Path

import pytest

from bodysense_lab.commands.bench.live import Load, _framed, _LoadClient, _messages, bench_live


@pytest.mark.parametrize("size", [0, 125, 126, 5000])
def test_messages_are_complete_for_any_size_of_chunks(size: int) -> None:
    """The frames are written by the library that the server uses."""
    pytest.importorskip("websockets", reason="needs packages/live")
    from websockets.frames import Frame, Opcode

    payloads = [bytes([k]) * size for k in range(3)]
    stream = b"".join(Frame(Opcode.BINARY, payload).serialize(mask=False) for payload in payloads)
    unread, got = bytearray(), []
    for k in range(0, len(stream), 7):
        unread += stream[k : k + 7]
        got += _messages(unread)
    assert got == [(2, payload) for payload in payloads] and not unread


def test_clients_send_masked_frames() -> None:
    pytest.importorskip("websockets", reason="needs packages/live")
    from websockets.frames import Frame, Opcode
    from websockets.protocol import SERVER, Protocol, State

    for size in (10, 125, 126, 3000):
        reader = Protocol(SERVER, state=State.OPEN)
        reader.receive_data(_framed(2, b"x" * size))
        (frame,) = reader.events_received()
        assert isinstance(frame, Frame)
        assert (frame.opcode, bytes(frame.data), frame.fin) == (Opcode.BINARY, b"x" * size, True)


def test_a_ping_is_answered() -> None:
    """A server closes connections that do not answer its pings, and the largest load takes longer than that."""
    pytest.importorskip("websockets", reason="needs packages/live")
    from websockets.frames import Frame, Opcode
    from websockets.protocol import SERVER, Protocol, State

    load, (ours, theirs) = Load("http://127.0.0.1:1", 72.0), socket.socketpair()
    with ours, theirs:
        theirs.sendall(Frame(Opcode.PING, b"beat").serialize(mask=False))
        load._read(_LoadClient(ours, due=0.0))
        reader = Protocol(SERVER, state=State.OPEN)
        reader.receive_data(theirs.recv(4096))
    (frame,) = reader.events_received()
    assert isinstance(frame, Frame) and (frame.opcode, bytes(frame.data)) == (Opcode.PONG, b"beat")


@pytest.mark.slow
def test_numbers_of_a_real_server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("uvicorn", reason="needs packages/live")
    out = tmp_path / "live.json"
    monkeypatch.setattr("bodysense_lab.commands.bench.live._MAX_SESSIONS", 8)
    bench_live(sessions=3, rate=20.0, seconds=2.0, most=True, json=out)
    numbers = json.loads(out.read_text())
    assert {"sessions", "rate_hz", "p50_ms", "p99_ms", "rss_mb", "rss_per_session_mb"} <= numbers.keys()
    assert numbers["sessions"] == 3 and numbers["rate_hz"] == 20
    assert 0 < numbers["p50_ms"] <= numbers["p99_ms"] and 0 < numbers["answered"] <= 1
    assert 20 < numbers["rss_mb"] < 2000
    assert numbers["answered_least"] <= numbers["answered"] <= numbers["answered_most"]
    assert numbers["most_sessions"] in (0, 4, 8)


@pytest.mark.alone
@pytest.mark.slow
def test_a_throttled_server_runs_for_its_share_of_the_time(tmp_path: Path) -> None:
    pytest.importorskip("uvicorn", reason="needs packages/live")
    out = tmp_path / "slowed.json"
    bench_live(sessions=20, seconds=4.0, share=0.2, json=out)
    numbers = json.loads(out.read_text())
    assert numbers["share"] == 0.2
    assert 0.02 < numbers["server_cores"] < 0.5  # 20 wearers need more
