"""Refusals of a server: one line each, with no effect on other clients."""

from __future__ import annotations

import http.client
import json
import socket
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SUBPROTOCOL, write_signal
from bodysense_live.protocols.links import listen_tcp
from bodysense_live.security.safety import Access, Limits, RateLimit, refusal_reason
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Hello
from bodysense_live.server.settings import ServerSettings

from ..conftest import DEVICES, Address, Connecting, Serving, signal

FRAME = signal(0, 0.0)


def closed(client: Any) -> tuple[int, str]:
    """Return the code with which a server closes a connection, and the reason of its error message."""
    from websockets import ConnectionClosed

    reason = ""
    with pytest.raises(ConnectionClosed) as caught:
        while True:
            received = client.recv(timeout=10)
            if isinstance(received, str) and json.loads(received)["type"] == "error":
                reason = json.loads(received)["reason"]
    assert caught.value.rcvd is not None
    return caught.value.rcvd.code, reason or caught.value.rcvd.reason


@pytest.mark.parametrize(
    ("message", "code", "expected"),
    [
        (b"", 1007, "0 bytes"),
        (b"\x02" + write_signal(FRAME)[1:], 1007, "kind 2"),
        (write_signal(FRAME)[:-1], 1007, "bytes"),
        (write_signal(replace(FRAME, position=FRAME.position * np.float32(1e6))), 1007, "beyond 1000 m"),
        ("{", 1007, "not JSON"),
        ('{"type":"quit"}', 1007, "type 'quit'"),
        ('{"type":"replay","time":1}', 1007, "watches no replay"),
        (write_message(Hello(1)), 1007, "a second hello"),
        (b"\x01" * 10_000, 1009, ""),
    ],
)
def test_an_invalid_message_closes_only_its_own_connection(
    server: Address, connect: Connecting, message: str | bytes, code: int, expected: str
) -> None:
    good, bad = connect(server), connect(server)
    good.answered(signal(0, 0.0))
    bad.socket.send(message)
    found, reason = closed(bad.socket)
    assert found == code and expected in reason and "\n" not in reason
    assert good.answered(signal(1, 0.1)).sequence == 1


@pytest.mark.parametrize(
    ("hello", "expected"),
    [
        ('{"type":"hello","version":7}', "messages of version 7; this server speaks version 1"),
        ('{"type":"hello","version":1,"points":["elbow"]}', "'elbow' is unknown"),
        ('{"type":"ping","time":1}', "the first message is a hello"),
        (b"\x01", "the first message is a hello"),
    ],
)
def test_an_invalid_hello_is_refused(server: Address, hello: str | bytes, expected: str) -> None:
    from websockets.sync.client import connect

    with connect(server.websocket, compression=None) as client:
        client.send(hello)
        assert expected in closed(client)[1]


def test_a_silent_client_is_closed(server_of: Serving) -> None:
    from websockets.sync.client import connect

    server = server_of(ServerSettings(limits=Limits(seconds_to_hello=0.2)))
    with connect(server.websocket, compression=None) as client:
        assert closed(client) == (1008, "no hello within 0.2 s; send it first")


def test_too_many_messages_close_the_connection(server_of: Serving, connect: Connecting) -> None:
    from websockets import ConnectionClosed

    server = server_of(ServerSettings(limits=Limits(messages_a_second=20)))
    client = connect(server)
    with suppress(ConnectionClosed):  # the connection closes with the refusal
        for k in range(60):
            client.send(signal(k, k / 1000))
    code, reason = closed(client.socket)
    assert code == 1008 and "more than 20 messages a second" in reason


def test_too_many_sessions_are_refused(server_of: Serving, connect: Connecting) -> None:
    server = server_of(ServerSettings(limits=Limits(sessions=2)))
    first, second = connect(server), connect(server)
    with pytest.raises(AssertionError, match="2 sessions already"):
        connect(server)
    second.socket.close()  # a session without a client may be replaced
    third = None
    for _ in range(50):
        try:
            third = connect(server)
            break
        except AssertionError:
            continue
    assert third is not None and third.answered(signal(0, 0.0)).sequence == 0
    assert first.answered(signal(0, 0.0)).sequence == 0


def test_an_upload_is_refused_before_it_is_read(server: Address) -> None:
    for sent in (0, 1_000, 200_000, 200_000):  # repeated, because a reset loses the answer only sometimes
        connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=10)
        connection.putrequest("POST", "/")
        connection.putheader("Content-Length", str(2 * 1024**3))
        connection.endheaders()
        connection.send(b"x" * sent)
        response = connection.getresponse()
        assert response.status == 413 and b"takes no uploads" in response.read()
        connection.close()


def test_an_upload_that_does_not_stop_is_cut_off(server: Address) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=10) as connection:
        connection.sendall(b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2147483648\r\n\r\n")
        with pytest.raises(OSError, match=r"reset|pipe"):
            for _ in range(2 * 1024):
                connection.sendall(bytes(1024 * 1024))


@pytest.mark.parametrize(
    ("settings", "query", "headers", "protocols", "status", "expected"),
    [
        (ServerSettings(), "", {"Origin": "http://evil.example"}, [SUBPROTOCOL], 403, "--origin 'http://evil.example'"),
        (ServerSettings(), "", {}, ["bodysense.9"], 400, "'bodysense.1', not 'bodysense.9'"),
        (ServerSettings(Access(token="secret-token")), "?token=wrong", {}, [SUBPROTOCOL], 403, "missing or wrong"),
        (ServerSettings(Access(token="secret-token")), "", {}, [SUBPROTOCOL, "token.secret-token"], 101, ""),
        (
            ServerSettings(Access(origins=("http://localhost:5173",))),
            *("", {"Origin": "http://localhost:5173"}, [SUBPROTOCOL], 101, ""),
        ),
    ],
)
def test_only_admitted_clients_connect(
    server_of: Serving,
    settings: ServerSettings,
    query: str,
    headers: dict[str, str],
    protocols: list[Any],
    status: int,
    expected: str,
) -> None:
    from websockets import InvalidStatus
    from websockets.sync.client import connect

    address = server_of(settings).websocket + query
    if status == 101:
        with connect(address, subprotocols=protocols, additional_headers=headers, compression=None) as client:
            assert client.subprotocol == SUBPROTOCOL
            client.send(write_message(Hello(1, DEVICES)))
            assert json.loads(client.recv(timeout=10))["type"] == "welcome"
        return
    with (
        pytest.raises(InvalidStatus) as caught,
        connect(address, subprotocols=protocols, additional_headers=headers, compression=None),
    ):
        pass
    assert caught.value.response.status_code == status
    assert expected in (caught.value.response.body or b"").decode()


@pytest.mark.parametrize(
    ("access", "host", "origin", "tokens", "refused"),
    [
        (Access(), "127.0.0.1:8765", None, [], False),
        (Access(), "localhost:8765", "http://localhost:8765", [], False),
        (Access(), "[::1]:8765", "http://[::1]:8765", [], False),
        (Access(), "attacker.example:8765", "http://attacker.example:8765", [], True),  # a name that points here
        (Access(), "localhost:8765", "http://localhost:9999", [], True),
        (Access(), "localhost:8765", "null", [], True),
        (Access(), "localhost:8765", "http://[", [], True),
        (Access(), None, None, [], True),
        (Access(), "127.0.0.1:8850, evil.com", None, [], True),
        (Access(), "evil.com@127.0.0.1", None, [], True),
        (Access(), "127.0.0.1/evil.com", None, [], True),
        (Access(), "127.0.0.1:", None, [], True),
        (Access("0.0.0.0", "a-long-token"), "192.168.0.7:8765", "http://192.168.0.7:8765", ["a-long-token"], False),
        (Access("0.0.0.0", "a-long-token"), "192.168.0.7:8765", "http://evil.example", ["a-long-token"], True),
        (Access("0.0.0.0", "a-long-token"), "192.168.0.7:8765", None, ["", "ä"], True),
    ],
)
def test_hosts_origins_and_tokens(
    access: Access, host: str | None, origin: str | None, tokens: list[str], refused: bool
) -> None:
    assert (refusal_reason(access, host, origin, tokens) is not None) == refused


def test_the_rate_is_an_average() -> None:
    rate, now, allowed = RateLimit(100, 0.0), 0.0, 0
    for _ in range(1000):
        now += 1 / 1000
        allowed += rate.allows(now)
    assert allowed == pytest.approx(300, abs=2)  # two hundred at once, then a hundred a second


def test_the_burst_after_a_long_silence_is_limited() -> None:
    rate = RateLimit(100, 0.0)
    assert sum(rate.allows(60.0) for _ in range(1000)) == 200


def test_ports_that_cannot_be_bound() -> None:
    for host, port, expected in (
        ("127.0.0.1", 70000, "ports are 0"),
        ("203.0.113.1", 0, "no address of this machine"),
        ("no such host", 0, "no such host"),
    ):
        with pytest.raises(BodysenseError, match=expected):
            listen_tcp("--port", host, port)
