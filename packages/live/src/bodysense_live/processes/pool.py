"""Several processes that serve one port: the parent accepts connections, and passes each to the least busy worker.

If the workers shared the port, the system would distribute connections at random: of forty, one worker may get twice as
many as another, and all of its clients wait.
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
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bodysense.errors import BodysenseError
from bodysense_live.processes.kept_sessions import KeptSessions, ParentStore
from bodysense_live.server.launch import serve
from bodysense_live.server.settings import ServerSettings

_TAKE_TIMEOUT = 1.0  # s for a worker to take a connection
_TLS_TIMEOUT = 10.0  # s for a TLS handshake
_POLL_INTERVAL = 0.1  # s between checks of workers that load
_RESTART_DELAY = 2.0  # s before a worker is replaced, so that its clients resume before another one loads
_FAILURE_WINDOW, _MAX_FAILURES = 30.0, 8  # s, per worker: after more failures the server stops
_REPORT_INTERVAL = 0.1  # s between a worker's reports of ended connections
_BEAT_INTERVAL = 0.5  # s between the beats of a worker that answers its frames
_DOUBTED_AFTER = 0.8  # s of silence, after which a worker gets no connection if another one can
_SILENT_AFTER = 1.4  # s of silence, after which a worker that serves is replaced
_LONGEST_START = 120.0  # s for a worker to load
_LONGEST_TURN = 0.2  # s of silence that one turn of the parent's loop counts: a stopped machine has no silent workers
_BEAT, _ENDED = b"b", b"-"  # messages of a worker: it answers its frames; one of its connections has ended


@dataclass(eq=False)
class _Worker:
    """A worker process, the parent's end of its channel, its number of connections, and for how long it is silent."""

    process: Any
    channel: socket.socket
    ready: Any  # a semaphore that the worker releases once it serves
    serves: bool = False
    count: int = 0
    silence: float = 0.0  # s, of the parent's running time


class Workers:
    """The workers of one server: `count` that serve, and a loaded spare that replaces one that ends or is silent.

    The parent keeps their sessions, so that wearers resume in another worker.
    """

    def __init__(self, settings: ServerSettings, count: int, folder: str) -> None:
        self._settings, self._count, self._folder = settings, count, folder
        self._context = multiprocessing.get_context("spawn")
        self._ended: list[float] = []  # s, times at which workers ended
        self._due: list[float] = []  # s, times at which replacements start
        self._kept = KeptSessions(settings.limits.seconds_to_resume)
        self._turn_at = time.monotonic()  # s, last turn of the loop
        self.all = [self._start_worker() for _ in range(count + 1)]

    @property
    def serving(self) -> list[_Worker]:
        """The workers that get connections; others are spare, or load."""
        return [worker for worker in list(self.all) if worker.serves][: self._count]

    def wait(self) -> None:
        """Wait until `count` workers serve. Raises BodysenseError if one does not start."""
        while len(self.serving) < self._count:
            self.poll()
            if any(not worker.process.is_alive() for worker in self.all):
                raise BodysenseError("a worker did not start; see above for why")
            time.sleep(0.02)

    def poll(self) -> None:
        """Check which workers are ready or silent, and start replacements that are due."""
        if self._due and self._due[0] <= time.monotonic():
            self._due.pop(0)
            # Starting a process takes too long for the loop that distributes connections, so use a thread.
            threading.Thread(target=lambda: self.all.append(self._start_worker()), daemon=True).start()
        for worker in list(self.all):
            if not worker.serves and worker.ready.acquire(block=False):
                worker.serves, worker.silence = True, 0.0
        now = time.monotonic()
        turn, self._turn_at = min(now - self._turn_at, _LONGEST_TURN), now
        for worker in list(self.all):
            worker.silence += turn
            if worker.silence > (_SILENT_AFTER if worker.serves else _LONGEST_START):
                text = f"worker {worker.process.pid} has not answered for {worker.silence:.1f} s, and is replaced"
                print("bodysense:", text, file=sys.stderr, flush=True)
                worker.process.kill()
                self.replace(worker)

    def replace(self, worker: _Worker) -> None:
        """Replace a worker that ended. Raises BodysenseError if workers end repeatedly."""
        now = time.monotonic()
        self._ended = [*(moment for moment in self._ended if now - moment < _FAILURE_WINDOW), now]
        worker.channel.close()
        worker.process.join(_TAKE_TIMEOUT)
        if worker.process.pid is not None:
            with contextlib.suppress(Exception):  # the process has written no metrics
                from prometheus_client.multiprocess import mark_process_dead

                mark_process_dead(worker.process.pid, self._folder)
        self.all.remove(worker)
        if len(self._ended) > _MAX_FAILURES * self._count:
            raise BodysenseError("workers end again and again; the server was stopped: see above for why")
        self._due.append(now + (_RESTART_DELAY if len(self.serving) >= self._count else 0.0))

    def stop(self) -> None:
        """End all workers."""
        for worker in self.all:
            if worker.process.is_alive() and worker.process.pid is not None:
                os.kill(worker.process.pid, signal.SIGTERM)
        for worker in self.all:
            worker.process.join(5)
            worker.channel.close()

    def _start_worker(self) -> _Worker:
        here, there = socket.socketpair()
        here.settimeout(_TAKE_TIMEOUT)
        keeping, kept = socket.socketpair()
        ready = self._context.Semaphore(0)
        with there, kept:
            process: Any = self._context.Process(
                target=_run_worker, args=(self._settings, there, kept, self._folder, ready), daemon=True
            )
            process.start()
        self._kept.serve(keeping)
        return _Worker(process, here, ready)


def serve_in_workers(
    settings: ServerSettings, bound: socket.socket, workers: int, started: Callable[[], None] = lambda: None
) -> None:
    """Serve on a port in `workers` processes until this one is interrupted; replace workers that end.

    Raises BodysenseError if a worker does not start, or if the system cannot pass a connection to another process.
    """
    if not hasattr(socket, "send_fds"):
        raise BodysenseError("--workers: this system cannot share a port between processes; leave --workers out")
    for ending in (signal.SIGTERM, signal.SIGINT):  # interrupt even if a shell ignores them, so that workers end, too
        signal.signal(ending, signal.default_int_handler)
    with tempfile.TemporaryDirectory(prefix="bodysense-") as folder:
        pool = Workers(settings, workers, folder)
        try:
            pool.wait()
            started()
            with bound:
                distribute(bound, pool)
        except KeyboardInterrupt:
            return
        finally:
            pool.stop()


def distribute(bound: socket.socket, pool: Workers) -> None:
    """Pass connections to workers and replace workers that end, without end."""
    bound.setblocking(False)
    while True:
        _serve_once(bound, pool)


def _serve_once(bound: socket.socket, pool: Workers) -> None:
    """Handle pending connections and messages, or wait for them for `_POLL_INTERVAL`."""
    pool.poll()
    serving = pool.serving
    with selectors.DefaultSelector() as selector:
        if serving:
            selector.register(bound, selectors.EVENT_READ, None)
        for worker in list(pool.all):
            selector.register(worker.channel, selectors.EVENT_READ, worker)
        for key, _ in selector.select(_POLL_INTERVAL):
            if key.data is None:
                fewest = min(serving, key=lambda worker: (worker.silence > _DOUBTED_AFTER, worker.count))
                fewest.count += _hand_over(bound, fewest.channel)
                continue
            try:
                messages = key.data.channel.recv(4096)  # one byte each; none if the worker has ended
            except OSError:
                messages = b""
            key.data.count -= messages.count(_ENDED)
            key.data.silence = 0.0
            if not messages:
                pool.replace(key.data)
                return  # the serving workers have changed


def _hand_over(bound: socket.socket, channel: socket.socket) -> bool:
    """Accept a connection and pass it to a worker. Return whether the worker took one."""
    try:
        connection, _ = bound.accept()
    except (BlockingIOError, ConnectionError):  # the client is gone already
        return False
    except OSError:  # too many open files: others must close first
        time.sleep(_REPORT_INTERVAL)
        return False
    with connection:
        try:
            socket.send_fds(channel, [b"+"], [connection.fileno()])
        except OSError:  # the worker is busy
            return False
    return True


def _run_worker(settings: ServerSettings, channel: socket.socket, kept: socket.socket, folder: str, ready: Any) -> None:
    """Run one worker process."""
    os.environ["PROMETHEUS_MULTIPROC_DIR"] = folder  # read by prometheus_client when it is imported
    tasks: set[asyncio.Task[None]] = set()

    def started(server: Any) -> None:
        tasks.add(asyncio.get_running_loop().create_task(_take_connections(server, channel)))
        ready.release()

    try:
        serve(settings, [], started, [ParentStore(kept)])
    except BodysenseError as error:
        print("bodysense:", error, file=sys.stderr)
        sys.exit(2)


async def _take_connections(server: Any, channel: socket.socket) -> None:
    """Serve the connections that the parent passes, until it ends."""
    loop = asyncio.get_running_loop()
    opening: set[asyncio.Task[None]] = set()
    taken = reported = 0

    def protocol() -> Any:
        kind = server.config.http_protocol_class
        return kind(config=server.config, server_state=server.server_state, app_state=server.lifespan.state)

    async def begin(connection: socket.socket) -> None:
        with contextlib.suppress(OSError):  # the client is gone already
            tls = server.config.ssl
            limit = None if tls is None else _TLS_TIMEOUT
            await loop.connect_accepted_socket(protocol, connection, ssl=tls, ssl_handshake_timeout=limit)

    def take() -> None:
        nonlocal taken
        try:
            data, handles, *_ = socket.recv_fds(channel, 1, 1)
        except ConnectionError:  # the parent ended before it read our reports
            data, handles = b"", []
        if not data:
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
    parent = multiprocessing.parent_process()
    beaten = -_BEAT_INTERVAL  # s
    while not server.should_exit:
        if loop.time() - beaten >= _BEAT_INTERVAL and not server.supervisor.is_stuck and _report(channel, _BEAT):
            beaten = loop.time()
        await asyncio.sleep(_REPORT_INTERVAL)
        if parent is not None and not parent.is_alive():  # uvloop does not call `take` for a channel that was reset
            server.should_exit = True
        ended = taken - len(opening) - len(server.server_state.connections) - reported
        if ended > 0 and _report(channel, _ENDED * ended):
            reported += ended


def _report(channel: socket.socket, messages: bytes) -> bool:
    """Send messages to the parent. Return False if it has ended, or does not read them."""
    try:
        return channel.send(messages, socket.MSG_DONTWAIT) == len(messages)
    except OSError:
        return False
