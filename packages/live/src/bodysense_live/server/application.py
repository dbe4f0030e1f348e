"""The web application: `/ws`, `/healthz`, `/readyz`, `/metrics` and the page.

Every HTTP response has security headers, and a request with a body is refused.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Sequence
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from bodysense.errors import missing_package
from bodysense.io.formats.protocol import SUBPROTOCOL
from bodysense_live.protocols.camera_link import CameraLink
from bodysense_live.protocols.datagrams import InputLink, MarkerInput, PoseSender, marker_points
from bodysense_live.protocols.links import DeviceInput, Link, UdpPort
from bodysense_live.protocols.markers.marker_link import MarkerLink
from bodysense_live.protocols.robots.robot_link import RobotLink
from bodysense_live.protocols.slimevr_link import SENSORS, SlimevrLink
from bodysense_live.protocols.solarxr.solarxr_input import InputReader
from bodysense_live.protocols.solarxr.solarxr_link import SolarxrLink
from bodysense_live.protocols.steamvr.vmt import VmtReader
from bodysense_live.protocols.steamvr.vmt_link import VmtLink
from bodysense_live.protocols.vrchat import VRCHAT_POINTS, VrchatReader
from bodysense_live.protocols.vrchat_link import VrchatLink
from bodysense_live.security.safety import AccessCheck
from bodysense_live.server.connection import serve_client
from bodysense_live.server.live import Live
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.page_files import library_routes
from bodysense_live.server.session_store import SessionKeeper, SessionStore
from bodysense_live.server.settings import ServerSettings
from bodysense_live.server.supervisor import Supervisor
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.tracked_devices import SIGNALS, DeviceReader

_NO_UPLOAD = "bodysense takes no uploads; avatars and recordings that are dropped on the page stay in the browser.\n"
_LINGER_S = 1.0  # s for which a refused upload is read on
_LINGER_BYTES = 1024 * 1024  # of a refused upload that are read
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Content-Security-Policy": "frame-ancestors 'none'",
}


def guarded(application: Any) -> Any:
    """Wrap an ASGI application: add security headers, and refuse requests with a body before they are read."""

    async def guard(scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] != "http":
            await application(scope, receive, send)
            return
        names = {name for name, value in scope["headers"] if (name, value) != (b"content-length", b"0")}
        if names & {b"content-length", b"transfer-encoding"}:
            await _refuse_upload(receive, send)
            return

        async def with_headers(message: Any) -> None:
            if message["type"] == "http.response.start":
                have = {name.lower() for name, _ in message["headers"]}
                more = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
                message["headers"] = [*message["headers"], *(row for row in more if row[0] not in have)]
            await send(message)

        await application(scope, receive, with_headers)

    return guard


async def _refuse_upload(receive: Any, send: Any) -> None:
    """Answer 413, and close after the sender has stopped or `_LINGER_S` have passed.

    Closing a connection with unread bytes resets it, and the sender would not receive the answer.
    """
    body = _NO_UPLOAD.encode()
    headers = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
        (b"connection", b"close"),
    ]
    await send({"type": "http.response.start", "status": 413, "headers": headers})
    await send({"type": "http.response.body", "body": body, "more_body": True})
    unread = _LINGER_BYTES
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(_LINGER_S):
            while unread > 0:
                message = await receive()
                if message["type"] == "http.disconnect" or not message.get("more_body", False):
                    break
                unread -= len(message.get("body", b""))
    await send({"type": "http.response.body", "body": b""})


def links_of(settings: ServerSettings, metrics: Metrics) -> list[Link]:
    """Return links to all other programs. Raises BodysenseError for ports and hosts that cannot be used.

    Inertial sensors join every input that tracks a headset; without such an input they are an input of their own.
    """
    host, links = settings.access.host, list[Link]()
    sensors: SlimevrLink | None = None

    def with_sensors(reader: DeviceReader, points: tuple[str, ...]) -> tuple[DeviceReader, tuple[str, ...]]:
        if sensors is None:
            return reader, points
        return replace(reader, sensors=sensors.observation), (*points, *SENSORS)

    try:
        if settings.slimevr is not None:
            headsets = settings.vmc_in, settings.vmt, settings.vrchat, settings.solarxr
            sensors = SlimevrLink(settings.slimevr, metrics, alone=all(one is None for one in headsets))
            links.append(sensors)
        if settings.vmc_in is not None:
            reader, points = with_sensors(settings.vmc_trackers, SIGNALS)
            protocol = partial(DeviceInput, metrics=metrics, reader=reader, points=points)
            links.append(InputLink("vmc", UdpPort("--vmc-in", host, settings.vmc_in), points, protocol))
        if settings.markers_in is not None:
            port = UdpPort("--markers-in", host, settings.markers_in)
            protocol = partial(MarkerInput, metrics=metrics, glove_set=settings.glove_set)
            links.append(InputLink("markers", port, marker_points(settings.glove_set), protocol))
        if settings.markers is not None:
            links.append(MarkerLink(settings.markers, metrics))
        if settings.receivers:
            links.append(PoseSender(settings.receivers, metrics))
        if settings.robot is not None:
            links.append(RobotLink(settings.robot, metrics))
        if settings.camera is not None:
            links.append(CameraLink(settings.camera, settings.person.skeleton))
        if settings.vmt is not None:
            links.append(VmtLink(settings.vmt, metrics, *with_sensors(VmtReader(settings.vmt.devices), SIGNALS)))
        if settings.vrchat is not None:
            links.append(VrchatLink(settings.vrchat, metrics, *with_sensors(VrchatReader(), VRCHAT_POINTS)))
        if settings.solarxr is not None:
            links.append(SolarxrLink(settings.solarxr, metrics, *with_sensors(InputReader(), SIGNALS)))
    except BaseException:
        for link in links:
            link.close()
        raise
    return links


def probe_routes(live: Live, supervisor: Supervisor) -> list[Any]:
    """Return the routes by which others watch the server's health."""
    from starlette.responses import PlainTextResponse, Response
    from starlette.routing import Route

    async def healthz(_: Any) -> Response:
        if not supervisor.is_stuck:
            return PlainTextResponse("ok\n", headers=HEADERS)
        return PlainTextResponse(f"a frame waits for {supervisor.longest_wait:.1f} s\n", 503, HEADERS)

    async def readyz(_: Any) -> Response:
        if supervisor.is_stuck:
            return PlainTextResponse("stuck\n", 503, HEADERS)
        text, status = ("full\n", 503) if live.is_full else ("ready\n", 200)
        return PlainTextResponse(text, status, HEADERS)

    return [Route("/healthz", healthz), Route("/readyz", readyz)]


_NO_PAGE = "This copy of bodysense was installed without the page. The WebSocket is at /ws.\n"


def application(settings: ServerSettings, supervisor: Supervisor, stores: Sequence[SessionKeeper] = ()) -> Any:
    """Return the ASGI application of one process, which keeps sessions in `stores` and those of the settings.

    Raises BodysenseError if a library of the server is missing.
    """
    try:
        from starlette.applications import Starlette
        from starlette.responses import PlainTextResponse, Response
        from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
        from starlette.staticfiles import StaticFiles
        from starlette.websockets import WebSocket
    except ImportError as error:
        raise missing_package(error) from None
    metrics = Metrics()
    links = links_of(settings, metrics)

    def send_body(answer: Answer) -> None:
        for link in links:
            link.send_body(answer)

    if settings.shared is not None:
        stores = (*stores, SessionStore(settings.shared, settings.limits.seconds_to_resume))
    live = Live(settings, metrics, supervisor, send_body if links else None, stores)
    access_check = AccessCheck(settings.access)

    async def websocket(client: WebSocket) -> None:
        offered = client.scope.get("subprotocols", [])
        tokens = [name.removeprefix("token.") for name in offered if name.startswith("token.")]
        tokens += client.query_params.getlist("token")
        reason, status = await access_check.refusal_reason(client, client.headers.get("origin"), tokens), 403
        if reason is None and offered and SUBPROTOCOL not in offered:
            reason, status = f"the subprotocol is {SUBPROTOCOL!r}, not {offered[0][:40]!r}; update the client", 400
        if reason is not None:
            metrics.closed(status)
            await client.send_denial_response(PlainTextResponse(f"{reason}\n", status, HEADERS))
            return
        await client.accept(SUBPROTOCOL if offered else None)
        await serve_client(client, live)

    async def metrics_text(request: Any) -> Response:
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        tokens = [bearer, *request.query_params.getlist("token")]
        reason = await access_check.refusal_reason(request, None, tokens)
        if reason is not None:
            return PlainTextResponse(f"{reason}\n", 403, HEADERS)
        text, kind = metrics.text()
        return Response(text, media_type=kind, headers=HEADERS)

    async def no_page(_: Any) -> Response:
        return PlainTextResponse(_NO_PAGE, headers=HEADERS)

    @contextlib.asynccontextmanager
    async def lifespan(_: Any) -> AsyncIterator[None]:
        live.start()
        try:
            for link in links:
                await link.open(live)
            yield
        finally:
            for link in links:
                link.close()
            await live.stop()

    page = Path(str(files("bodysense_live").joinpath("page")))
    routes: list[BaseRoute] = [
        WebSocketRoute("/ws", websocket),
        *probe_routes(live, supervisor),
        Route("/metrics", metrics_text),
        *library_routes(),
    ]
    has_page = (page / "index.html").is_file()
    routes.append(Mount("/", StaticFiles(directory=page, html=True)) if has_page else Route("/", no_page))
    return guarded(Starlette(routes=routes, lifespan=lifespan))
