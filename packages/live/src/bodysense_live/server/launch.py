"""Start the server in this process, after a warm-up, so that the first client does not wait."""

from __future__ import annotations

import contextlib
import gc
import logging
import os
import socket
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bodysense.body.person import Person
from bodysense.errors import missing_package
from bodysense.io.formats.protocol import SignalFrame, write_pose
from bodysense_live.security.certificate import follow_certificate
from bodysense_live.server.application import application
from bodysense_live.server.session_slot import SessionSlot
from bodysense_live.server.session_store import SessionKeeper
from bodysense_live.server.settings import ServerSettings
from bodysense_live.server.supervisor import Supervisor
from bodysense_live.sessions.estimation import load
from bodysense_live.sessions.newest_frames import websocket_protocol
from bodysense_live.sessions.session import Session

_POINTS = ("headset", "left_controller", "right_controller")


def warm_up() -> None:
    """Run everything once that would delay a first client: the network, a few frames, reading a person."""
    load()
    session = Session(_POINTS, Person())
    places = np.array([[0, 1.6, 0], [-0.3, 1.0, -0.3], [0.3, 1.0, -0.3]], dtype=np.float32)
    upright = np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (3, 1))
    for k in range(3):
        session.receive(SignalFrame(k, k / 72, np.arange(3), np.full(3, 3), places, upright), 0.0)
        answer = session.step()
        if answer is not None:
            write_pose(answer.frame, 0)
    SessionSlot(16 * "0", "", "", "", session).welcome((), recording=False)
    Person.from_json(Person().to_json())


_SWITCH_INTERVAL = 0.0005  # s; a short switch interval lets the event loop run while a thread computes


def make_server(
    settings: ServerSettings, started: Callable[[Any], None] = lambda server: None, stores: Sequence[SessionKeeper] = ()
) -> Any:
    """Return a uvicorn server. `run([socket])` serves until `should_exit` is set, and calls `started` with the server.

    If one of its tasks ends, it closes its connections and stops; `supervisor.failure` is then the reason.
    `stores`: where sessions are kept, besides the store of the settings.

    Raises BodysenseError if a library is missing, or a UDP port or an avatar's address cannot be used.
    """
    try:
        import uvicorn
        import websockets  # noqa: F401
    except ImportError as error:
        raise missing_package(error) from None

    class Server(uvicorn.Server):
        supervisor: Supervisor

        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            if access.certificate is not None and access.key is not None:
                supervisor.start(follow_certificate(self.config.ssl, access.certificate, access.key))
            started(self)

    from uvicorn.protocols.http.auto import AutoHTTPProtocol

    def end(failure: BaseException) -> None:
        server.should_exit = True

    limits, access, supervisor = settings.limits, settings.access, Supervisor(end)
    config = uvicorn.Config(
        application(settings, supervisor, stores),
        http=with_request_timeout(AutoHTTPProtocol, limits.seconds_to_request),
        ssl_certfile=access.certificate,
        ssl_keyfile=access.key,
        ws=websocket_protocol(),
        ws_max_size=limits.message_bytes,
        ws_per_message_deflate=False,
        ws_ping_interval=20.0,
        ws_ping_timeout=20.0,
        limit_concurrency=2 * limits.sessions + 64,
        timeout_keep_alive=5,
        timeout_graceful_shutdown=3,
        server_header=False,
        proxy_headers=bool(access.trusted_proxies),
        forwarded_allow_ips=list(access.trusted_proxies),
        log_config=None,
        log_level="error",
        access_log=False,
    )
    # A refused WebSocket is not an error of the server.
    logging.getLogger("uvicorn.error").addFilter(lambda record: "completing handshake" not in record.getMessage())
    server = Server(config)
    server.supervisor = supervisor
    return server


def with_request_timeout(kind: Any, seconds: float) -> Any:
    """Return an HTTP protocol that closes a connection if its first request has no complete head within `seconds`."""

    class WithRequestTimeout(kind):
        def connection_made(self, transport: Any) -> None:
            super().connection_made(transport)
            self._timeout = self.loop.call_later(seconds, self._end)

        def connection_lost(self, exc: Exception | None) -> None:
            self._timeout.cancel()
            super().connection_lost(exc)

        def _end(self) -> None:
            is_http = self.transport.get_protocol() is self  # false for a WebSocket
            if is_http and self.cycle is None and not self.transport.is_closing():
                self.transport.close()

    return WithRequestTimeout


def serve(
    settings: ServerSettings,
    bound: Sequence[socket.socket],
    started: Callable[[Any], None] = lambda server: None,
    stores: Sequence[SessionKeeper] = (),
) -> None:
    """Serve on sockets until the process is interrupted. If a task of the server fails, the process ends (status 1)."""
    with contextlib.ExitStack() as opened, contextlib.suppress(KeyboardInterrupt):
        for one in bound:
            opened.enter_context(one)
        server = make_server(settings, started, stores)
        warm_up()
        gc.collect()
        gc.freeze()  # otherwise collections of the loaded objects delay frames by 20 ms
        sys.setswitchinterval(_SWITCH_INTERVAL)
        server.run(list(bound))
        if server.supervisor.failure is not None:
            print("bodysense: the server failed, and has ended: see above for why", file=sys.stderr, flush=True)
            os._exit(1)  # a regular exit would wait for a thread that hangs
