"""Several processes serve one port: the first takes connections, and hands each to the worker that has the fewest.

Sharing the port among them would let the system spread connections by chance: of forty, one may get twice as many as
another, and all of its wearers wait.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import selectors
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from typing import Any

from bodysense.errors import BodysenseError
from bodysense.serve.launch import serve
from bodysense.serve.settings import ServerSettings

_TO_TAKE = 1.0  # s in which a worker has to take a connection
_TOLD_EVERY = 0.1  # s between words of a worker on connections that ended


def serve_in_workers(
    settings: ServerSettings, bound: socket.socket, workers: int, started: Callable[[], None] = lambda: None
) -> None:
    """Serve on a port in `workers` processes until this one is interrupted; when one dies all are ended.

    Raises BodysenseError where a worker died, and on systems that cannot hand a connection to another process.
    """
    if not hasattr(socket, "send_fds"):
        raise BodysenseError("--workers: this system cannot share a port between processes; leave --workers out")
    for ending in (signal.SIGTERM, signal.SIGINT):  # so that workers are ended, too; a shell may have it ignored
        signal.signal(ending, signal.default_int_handler)
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="bodysense-metrics-") as folder, contextlib.ExitStack() as channels:
        ready, ours, processes = context.Semaphore(0), list[socket.socket](), list[Any]()
        try:
            for _ in range(workers):
                here, there = socket.socketpair()
                ours.append(channels.enter_context(here))
                with there:
                    process: Any = context.Process(target=_work, args=(settings, there, folder, ready), daemon=True)
                    process.start()
                processes.append(process)
            _wait(processes, ready)
            started()
            with bound:
                _hand_out(bound, ours, [process.sentinel for process in processes])
        except KeyboardInterrupt:
            return
        finally:
            for process in processes:
                if process.is_alive() and process.pid is not None:
                    os.kill(process.pid, signal.SIGTERM)
            for process in processes:
                process.join(5)
        raise BodysenseError("a worker ended; the server was stopped: see above for why, and start it again")


def _wait(processes: Sequence[Any], ready: Any) -> None:
    """Until every worker serves."""
    count = 0
    while count < len(processes):
        if ready.acquire(timeout=0.2):
            count += 1
        elif not all(process.is_alive() for process in processes):
            raise BodysenseError("a worker did not start; see above for why")


def _hand_out(bound: socket.socket, channels: Sequence[socket.socket], sentinels: Sequence[int]) -> None:
    """Hand connections to workers until one of them ends. Each says a byte for a connection that ended."""
    count = [0] * len(channels)
    bound.setblocking(False)
    with selectors.DefaultSelector() as selector:
        selector.register(bound, selectors.EVENT_READ, -1)
        for k, channel in enumerate(channels):
            channel.settimeout(_TO_TAKE)
            selector.register(channel, selectors.EVENT_READ, k)
        for sentinel in sentinels:
            selector.register(sentinel, selectors.EVENT_READ, None)
        while True:
            for key, _ in selector.select():
                if key.data is None:
                    return
                if key.data >= 0:
                    ended = len(channels[key.data].recv(4096))
                    count[key.data] -= ended
                    if not ended:
                        return
                else:
                    fewest = min(range(len(count)), key=count.__getitem__)
                    count[fewest] += _handed(bound, channels[fewest])


def _handed(bound: socket.socket, channel: socket.socket) -> bool:
    """Whether there was a connection, and the worker took it."""
    try:
        connection, _ = bound.accept()
    except (BlockingIOError, ConnectionError):  # it was gone again
        return False
    except OSError:  # too many open files: others must close first
        time.sleep(_TOLD_EVERY)
        return False
    with connection:
        try:
            socket.send_fds(channel, [b"+"], [connection.fileno()])
        except OSError:  # a worker that is held up
            return False
    return True


def _work(settings: ServerSettings, channel: socket.socket, folder: str, ready: Any) -> None:
    """One worker."""
    os.environ["PROMETHEUS_MULTIPROC_DIR"] = folder  # read by prometheus_client when it is imported
    tasks: set[asyncio.Task[None]] = set()

    def started(server: Any) -> None:
        tasks.add(asyncio.get_running_loop().create_task(_take(server, channel)))
        ready.release()

    try:
        serve(settings, [], started)
    except BodysenseError as error:
        print("bodysense:", error, file=sys.stderr)
        sys.exit(2)


async def _take(server: Any, channel: socket.socket) -> None:
    """Serve the connections that are handed over, until the process that does so is gone."""
    loop = asyncio.get_running_loop()
    opening: set[asyncio.Task[None]] = set()
    taken = told = 0

    def protocol() -> Any:
        kind = server.config.http_protocol_class
        return kind(config=server.config, server_state=server.server_state, app_state=server.lifespan.state)

    async def begin(connection: socket.socket) -> None:
        with contextlib.suppress(OSError):  # it is gone again
            await loop.connect_accepted_socket(protocol, connection)

    def take() -> None:
        nonlocal taken
        said, handles, *_ = socket.recv_fds(channel, 1, 1)
        if not said:
            loop.remove_reader(channel)
            server.should_exit = True
        for handle in handles:
            taken += 1
            connection = socket.socket(fileno=handle)
            connection.setblocking(False)
            task = loop.create_task(begin(connection))
            opening.add(task)
            task.add_done_callback(opening.discard)

    loop.add_reader(channel, take)
    while not server.should_exit:
        await asyncio.sleep(_TOLD_EVERY)
        ended = taken - len(opening) - len(server.server_state.connections) - told
        if ended > 0:
            with contextlib.suppress(OSError):  # `take` is told as well that nobody is there
                channel.send(b"-" * ended)
            told += ended
