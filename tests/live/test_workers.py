"""Distribution of connections to workers, and workers that serve them."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import pytest
from websockets import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from bodysense.io.formats.protocol import SUBPROTOCOL
from bodysense_live.protocols.links import listen_tcp
from bodysense_live.server.launch import make_server
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Hello, Resume, Settings
from bodysense_live.server.settings import ServerSettings
from bodysense_live.server.workers import Workers, _take_connections, _Worker, distribute

from .conftest import DEVICES

pytestmark = pytest.mark.skipif(not hasattr(socket, "send_fds"), reason="this system hands no connection over")


class Ended(Exception):
    """A worker ended."""


class Pool(Workers):
    """Two workers without processes; the test has the other ends of their channels."""

    def __init__(self, channels: list[socket.socket]) -> None:
        self.all = [_Worker(None, channel, None, serves=True) for channel in channels]
        self._count = len(channels)

    def poll(self) -> None:
        """All workers serve from the beginning."""

    def replace(self, worker: _Worker) -> None:
        raise Ended


@pytest.fixture
def handing() -> Iterator[tuple[int, list[socket.socket]]]:
    """The port of a distributor, and the workers' ends of two channels; a channel closes at the end."""
    bound = listen_tcp("--port", "127.0.0.1", 0)
    pairs = [socket.socketpair() for _ in range(2)]

    def hand() -> None:
        with suppress(Ended):
            distribute(bound, Pool([here for here, _ in pairs]))

    thread = threading.Thread(target=hand)
    thread.start()
    with bound, ExitStack() as stack:
        for pair in pairs:
            for end in pair:
                stack.enter_context(end)
        yield bound.getsockname()[1], [there for _, there in pairs]
        pairs[0][1].close()
        thread.join(10)
        assert not thread.is_alive()


def test_the_worker_with_the_fewest_connections_gets_the_next(handing: tuple[int, list[socket.socket]]) -> None:
    port, workers = handing
    with ExitStack() as clients:

        def connected(k: int) -> None:
            clients.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5))
            data, handles, *_ = socket.recv_fds(workers[k], 1, 1)
            assert data == b"+" and len(handles) == 1
            clients.enter_context(socket.socket(fileno=handles[0])).sendall(b"served")

        for worker in workers:
            worker.settimeout(5)
        for k in (0, 1, 0, 1):
            connected(k)
        workers[1].sendall(b"--")
        time.sleep(0.2)  # until the report is read
        clients.enter_context(socket.create_connection(("127.0.0.1", port), timeout=5))
        _, handles, *_ = socket.recv_fds(workers[1], 1, 1)  # it has no connections now
        clients.enter_context(socket.socket(fileno=handles[0]))
        connected(1)


def test_a_worker_serves_passed_connections_and_ends_with_its_parent(handing: tuple[int, list[socket.socket]]) -> None:
    port, workers = handing
    ready, tasks = threading.Event(), []

    def started(server: object) -> None:
        import asyncio

        tasks.append(asyncio.get_running_loop().create_task(_take_connections(server, workers[0])))
        ready.set()

    server = make_server(ServerSettings(), started)
    thread = threading.Thread(target=server.run, args=([],))
    thread.start()
    assert ready.wait(20)
    with connect(f"ws://127.0.0.1:{port}/ws", subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None) as client:
        client.send(write_message(Hello(1, DEVICES)))
        assert json.loads(client.recv(timeout=10))["type"] == "welcome"
    workers[0].shutdown(socket.SHUT_RD)  # as if the parent were gone
    thread.join(20)
    assert not thread.is_alive()


def resumed(address: str, resume: Resume | None) -> dict[str, Any] | None:
    """Return the welcome of a server, or None without a server."""
    try:
        with connect(address, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None, open_timeout=5) as client:
            client.send(write_message(Hello(1, DEVICES, resume=resume, settings=Settings(height=1.5))))
            return json.loads(client.recv(timeout=10))
    except (OSError, WebSocketException):
        return None


@pytest.mark.alone
@pytest.mark.slow
def test_a_killed_worker_is_replaced_and_its_wearers_resume(shared: str) -> None:
    command = [sys.executable, "-m", "bodysense", "serve", "--port", "0", "--workers", "2", "--shared", shared]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            address = server.stdout.readline().split()[-1].replace("http", "ws") + "ws"
            first = resumed(address, None)
            assert first is not None
            time.sleep(3)  # until the spare worker has loaded
            serving = first_child(server.pid, "spawn_main")
            if serving is None:
                pytest.skip("this system does not list child processes")
            os.kill(serving, signal.SIGKILL)
            killed, second = time.monotonic(), None
            while second is None and time.monotonic() - killed < 20:
                second = resumed(address, Resume(first["session"], first["token"]))
            assert second is not None and time.monotonic() - killed < 5.0  # about 1 s on an idle machine
            assert second["resumed"] and second["session"] == first["session"]
            assert second["settings"]["height"] == 1.5
        finally:
            server.terminate()


def first_child(parent: int, word: str) -> int | None:
    """Return the first child of a process with a word in its command."""
    for one in sorted(int(path.name) for path in Path("/proc").glob("[0-9]*")):
        with suppress(OSError):  # the process has ended meanwhile
            is_child = f"PPid:\t{parent}\n" in Path(f"/proc/{one}/status").read_text()
            if is_child and word in Path(f"/proc/{one}/cmdline").read_text(errors="replace"):
                return one
    return None
