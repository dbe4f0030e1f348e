"""Distribution of connections to workers, and workers that serve them."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import SUBPROTOCOL
from bodysense_live.processes import pool as pool_module
from bodysense_live.processes.pool import Workers, _take_connections, _Worker, distribute
from bodysense_live.protocols.links import listen_tcp
from bodysense_live.server.launch import make_server
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Hello, Settings
from bodysense_live.server.settings import ServerSettings

from ..conftest import DEVICES
from .wearers import Wearer, until, worn

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


class EndedProcess:
    """A process that has ended."""

    pid = None

    def join(self, seconds: float) -> None:
        """Return at once."""


def test_the_server_stops_when_workers_end_more_often_than_eight_times_each() -> None:
    """Exactly as many ends as are allowed are replaced, at once if too few workers serve."""
    pool = Pool([])
    pool._count, pool._ended, pool._due = 2, [], []
    for k in range(17):
        here, there = socket.socketpair()
        with here, there:
            worker = _Worker(EndedProcess(), here, None, serves=True)
            pool.all = [worker]
            if k == 16:
                with pytest.raises(BodysenseError, match="workers end again and again"):
                    Workers.replace(pool, worker)
            else:
                Workers.replace(pool, worker)
    assert len(pool._due) == 16 and not pool.all
    assert all(due <= time.monotonic() for due in pool._due), "too few workers serve"


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


def test_a_worker_serves_passed_connections_reports_their_ends_and_ends_with_its_parent() -> None:
    parent, channel = socket.socketpair()
    ready, tasks = threading.Event(), []

    def started(server: object) -> None:
        import asyncio

        tasks.append(asyncio.get_running_loop().create_task(_take_connections(server, channel)))
        ready.set()

    server = make_server(ServerSettings(), started)
    thread = threading.Thread(target=server.run, args=([],))
    thread.start()
    assert ready.wait(20)
    with parent, channel, listen_tcp("--port", "127.0.0.1", 0) as bound, ExitStack() as clients:
        parent.settimeout(5)
        host, port = bound.getsockname()
        first, *others = (clients.enter_context(socket.create_connection((host, port), timeout=5)) for _ in range(3))
        for _ in range(3):
            with bound.accept()[0] as connection:
                socket.send_fds(parent, [b"+"], [connection.fileno()])
        options = {"subprotocols": [Subprotocol(SUBPROTOCOL)], "compression": None}
        with connect(f"ws://{host}:{port}/ws", sock=first, **options) as client:
            client.send(write_message(Hello(1, DEVICES)))
            assert json.loads(client.recv(timeout=10))["type"] == "welcome"
        for other in others:
            other.close()
        reports = b""
        while reports.count(pool_module._ENDED) < 3:
            reports += parent.recv(64)
        time.sleep(3 * pool_module._REPORT_INTERVAL)
        reports += parent.recv(64, socket.MSG_DONTWAIT) if select.select([parent], [], [], 0)[0] else b""
        assert reports.count(pool_module._ENDED) == 3
        parent.shutdown(socket.SHUT_RDWR)
        thread.join(20)
        assert not thread.is_alive()


@contextmanager
def serving_workers(*options: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a server of two workers within the block. Yield it and its WebSocket's address."""
    command = [sys.executable, "-m", "bodysense", "serve", "--port", "0", "--workers", "2", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            assert server.stdout is not None
            yield server, server.stdout.readline().split()[-1].replace("http", "ws") + "ws"
        finally:
            for worker in children(server.pid, "spawn_main"):
                with suppress(ProcessLookupError):
                    os.kill(worker, signal.SIGCONT)
            server.terminate()


@pytest.mark.alone
@pytest.mark.slow
@pytest.mark.parametrize(("end", "is_shared"), [(signal.SIGSTOP, True), (signal.SIGKILL, False)])
def test_wearers_of_a_worker_that_hangs_or_ends_resume_in_another(
    end: signal.Signals, is_shared: bool, request: pytest.FixtureRequest
) -> None:
    options = ("--shared", request.getfixturevalue("shared")) if is_shared else ()
    with serving_workers(*options) as (server, address):
        wearers = [Wearer(Settings(height=1.7 + 0.05 * k, mirror=True)) for k in range(4)]
        with worn(wearers, address):
            until(lambda: len(children(server.pid, "spawn_main")) >= 3)
            until(lambda: all(one.answered and one.placed for one in wearers))
            time.sleep(4.0)  # until the spare worker has loaded
            before = [one.placed for one in wearers]
            for one in wearers:
                one.longest = 0.0
            port = int(address.rpartition(":")[2].partition("/")[0])
            # Any two of the three workers may have loaded first.
            wearers_of = {worker: connection_count(worker, port) for worker in children(server.pid, "spawn_main")}
            assert sum(wearers_of.values()) == len(wearers) and max(wearers_of.values()) <= 2, wearers_of
            victim = max(wearers_of, key=lambda worker: wearers_of[worker])
            os.kill(victim, end)
            time.sleep(5.0)
            now = time.monotonic()
            assert all(now - one.answered < 0.5 for one in wearers)
            reconnected = [one for one in wearers if len(one.welcomes) > 1]
            assert len(reconnected) == wearers_of[victim] > 0
            assert max(one.longest for one in wearers) < 2.0, [one.longest for one in wearers]
            print(f"{end.name}: longest silence {max(one.longest for one in reconnected):.2f} s")
            assert victim not in children(server.pid, "spawn_main")
            for one, placed in zip(wearers, before, strict=True):
                back = one.welcomes[-1]
                assert back["resumed"] == (one in reconnected) and one.placed == placed
                assert back["session"] == one.welcomes[0]["session"]
                assert back["settings"]["height"] == one.settings.height and back["settings"]["mirror"]


def test_a_stopped_machine_has_no_silent_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Silence counts only the time in which the parent itself runs."""
    clock, replaced = [0.0], list[_Worker]()
    monkeypatch.setattr(pool_module.time, "monotonic", lambda: clock[0])
    pool = Workers.__new__(Workers)
    ready = threading.Semaphore(0)
    worker = _Worker(MagicMock(), socket.socket(), ready, serves=True)
    pool.all, pool._count, pool._due, pool._turn_at = [worker], 1, [], 0.0
    monkeypatch.setattr(pool, "replace", replaced.append)
    clock[0] = 60.0  # the machine slept
    pool.poll()
    assert not replaced and worker.silence <= 0.2
    for _ in range(10):
        clock[0] += 0.1
        pool.poll()
    assert not replaced
    for _ in range(10):
        clock[0] += 0.1
        pool.poll()
    assert worker in replaced and worker.process.kill.called
    worker.channel.close()


def children(parent: int, word: str) -> list[int]:
    """Return children of a process with a word in their command."""
    found = []
    for one in sorted(int(path.name) for path in Path("/proc").glob("[0-9]*")):
        with suppress(OSError):  # the process has ended meanwhile
            is_child = f"PPid:\t{parent}\n" in Path(f"/proc/{one}/status").read_text()
            if is_child and word in Path(f"/proc/{one}/cmdline").read_text(errors="replace"):
                found.append(one)
    return found


def connection_count(process: int, port: int) -> int:
    """Return how many established connections to a local TCP port a process has."""
    rows = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    inodes = {row[9] for row in rows if row[1].endswith(f":{port:04X}") and row[3] == "01"}
    found = set()
    for handle in Path(f"/proc/{process}/fd").iterdir():
        with suppress(OSError):
            found.add(os.readlink(handle))
    return len(found & {f"socket:[{inode}]" for inode in inodes})
