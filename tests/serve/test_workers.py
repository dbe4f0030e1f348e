"""Connections are handed to the worker that has the fewest, and a worker serves what it is handed."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack

import pytest

from bodysense.serve.launch import listen, prepared
from bodysense.serve.messages import Hello, write_message
from bodysense.serve.protocol import SUBPROTOCOL
from bodysense.serve.settings import ServerSettings
from bodysense.serve.workers import _hand_out, _take

from .conftest import DEVICES

pytestmark = pytest.mark.skipif(not hasattr(socket, "send_fds"), reason="this system hands no connection over")


@pytest.fixture
def handing() -> Iterator[tuple[int, list[socket.socket]]]:
    """The port of something that hands connections out, and two workers' ends; theirs is closed first."""
    bound = listen("127.0.0.1", 0)
    pairs = [socket.socketpair() for _ in range(2)]
    thread = threading.Thread(target=_hand_out, args=(bound, [here for here, _ in pairs], []))
    thread.start()
    with bound, ExitStack() as stack:
        for pair in pairs:
            for end in pair:
                stack.enter_context(end)
        yield bound.getsockname()[1], [there for _, there in pairs]
        pairs[0][1].close()
        thread.join(10)
        assert not thread.is_alive()


def test_the_worker_that_has_the_fewest_gets_the_next(handing: tuple[int, list[socket.socket]]) -> None:
    port, workers = handing
    with ExitStack() as clients:

        def connected(k: int) -> None:
            clients.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5))
            said, handles, *_ = socket.recv_fds(workers[k], 1, 1)
            assert said == b"+" and len(handles) == 1
            clients.enter_context(socket.socket(fileno=handles[0])).sendall(b"served")

        for worker in workers:
            worker.settimeout(5)
        for k in (0, 1, 0, 1):
            connected(k)
        workers[1].sendall(b"--")
        time.sleep(0.2)  # heard before the next connection
        clients.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5))
        _, handles, *_ = socket.recv_fds(workers[1], 1, 1)  # it has none now
        clients.enter_context(socket.socket(fileno=handles[0]))
        connected(1)


def test_a_worker_serves_what_it_is_handed_and_ends_with_who_hands(handing: tuple[int, list[socket.socket]]) -> None:
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    port, workers = handing
    ready, tasks = threading.Event(), []

    def started(server: object) -> None:
        import asyncio

        tasks.append(asyncio.get_running_loop().create_task(_take(server, workers[0])))
        ready.set()

    server = prepared(ServerSettings(), started)
    thread = threading.Thread(target=server.run, args=([],))
    thread.start()
    assert ready.wait(20)
    with connect(f"ws://127.0.0.1:{port}/ws", subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None) as client:
        client.send(write_message(Hello(1, DEVICES)))
        assert json.loads(client.recv(timeout=10))["type"] == "welcome"
    workers[0].shutdown(socket.SHUT_RD)  # as if the other end were gone
    thread.join(20)
    assert not thread.is_alive()
