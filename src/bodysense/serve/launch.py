"""Open the port and serve, in this process or in several."""

from __future__ import annotations

import contextlib
import errno
import logging
import multiprocessing.connection
import os
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Callable
from typing import Any

from bodysense.errors import BodysenseError
from bodysense.serve.application import ServerSettings, application
from bodysense.serve.metrics import missing

_SWITCH = 0.0005  # s after which a thread that computes lets the event loop go on


def listen(host: str, port: int, shared: bool = False) -> socket.socket:
    """A TCP socket to serve on; `shared` by several processes. Raises BodysenseError, with the fix, without one."""
    if not 0 <= port <= 65535:
        raise BodysenseError(f"--port {port}: ports are 0 (any that is free) to 65535")
    if shared and not hasattr(socket, "SO_REUSEPORT"):
        raise BodysenseError("--workers: this system cannot share a port between processes; leave --workers out")
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError:
        raise BodysenseError(f"--host {host}: no such host; give an address of this machine") from None
    found = socket.socket(family, kind)
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if shared:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        found.bind(address)
        found.listen(128)
    except OSError as error:
        found.close()
        raise BodysenseError(_why(error, host, port)) from None
    return found


def _why(error: OSError, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"--port {port} is in use by another program; stop it or choose another --port (0 takes any)"
    if error.errno == errno.EACCES:
        return f"--port {port}: no permission to listen there; choose a --port of 1024 or more"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"--host {host} is no address of this machine; give one of its own, or 0.0.0.0 for all"
    return f"{host}:{port} cannot be listened on ({error.strerror}); choose another --port"


def prepared(settings: ServerSettings, started: Callable[[], None] = lambda: None) -> Any:
    """A uvicorn server that calls `started` when clients may come; `run([socket])` until its `should_exit` is set.

    Raises BodysenseError where a library is missing, and where a UDP port or an avatar's address cannot be had.
    """
    try:
        import uvicorn
        import websockets  # noqa: F401
    except ImportError as error:
        raise missing(error.name or "uvicorn") from None

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            started()

    limits = settings.limits
    config = uvicorn.Config(
        application(settings),
        ws="websockets-sansio",
        ws_max_size=limits.message_bytes,
        ws_per_message_deflate=False,
        ws_ping_interval=20.0,
        ws_ping_timeout=20.0,
        limit_concurrency=2 * limits.sessions + 64,
        timeout_keep_alive=5,
        timeout_graceful_shutdown=3,
        server_header=False,
        log_config=None,
        log_level="error",
        access_log=False,
    )
    # A WebSocket that was refused is no error of ours.
    logging.getLogger("uvicorn.error").addFilter(lambda record: "completing handshake" not in record.getMessage())
    return Server(config)


def serve(settings: ServerSettings, bound: socket.socket, started: Callable[[], None] = lambda: None) -> None:
    """Serve on a socket until the process is interrupted."""
    with bound, contextlib.suppress(KeyboardInterrupt):
        server = prepared(settings, started)
        sys.setswitchinterval(_SWITCH)
        server.run([bound])


def serve_in_workers(
    settings: ServerSettings, bound: socket.socket, workers: int, started: Callable[[], None] = lambda: None
) -> None:
    """Serve on a shared port in `workers` processes until this one is interrupted; when one dies all are ended.

    Raises BodysenseError where a worker died.
    """
    host, port = bound.getsockname()[:2]
    for ending in (
        signal.SIGTERM,
        signal.SIGINT,
    ):  # so that workers are ended, too; a shell may have ignored the second
        signal.signal(ending, signal.default_int_handler)
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="bodysense-metrics-") as folder:
        ready = context.Semaphore(0)
        processes: list[Any] = [
            context.Process(target=_work, args=(settings, host, port, folder, ready), daemon=True)
            for _ in range(workers)
        ]
        for process in processes:
            process.start()
        bound.close()  # so that nobody is sent to this process, which does not answer
        try:
            _started(processes, ready)
            started()
            multiprocessing.connection.wait([process.sentinel for process in processes])
        except KeyboardInterrupt:
            return
        finally:
            for process in processes:
                if process.is_alive() and process.pid is not None:
                    os.kill(process.pid, signal.SIGTERM)
            for process in processes:
                process.join(5)
        raise BodysenseError("a worker ended; the server was stopped: see above for why, and start it again")


def _started(processes: list[Any], ready: Any) -> None:
    """Wait until every worker serves."""
    count = 0
    while count < len(processes):
        if ready.acquire(timeout=0.2):
            count += 1
        elif not all(process.is_alive() for process in processes):
            raise BodysenseError("a worker did not start; see above for why")


def _work(settings: ServerSettings, host: str, port: int, folder: str, ready: Any) -> None:
    """One worker."""
    os.environ["PROMETHEUS_MULTIPROC_DIR"] = folder  # read by prometheus_client when it is imported
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        serve(settings, listen(host, port, shared=True), ready.release)
    except BodysenseError as error:
        print("bodysense:", error, file=sys.stderr)
        sys.exit(2)


def _end_with_parent() -> None:
    """No worker stays when the process that started it was killed."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os.kill(os.getpid(), signal.SIGTERM)
