"""The web application: `/ws`, `/healthz`, `/metrics` and the page."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from importlib.resources import files
from pathlib import Path
from typing import Any

from bodysense.serve.answer import Answer
from bodysense.serve.connection import converse
from bodysense.serve.live import Live
from bodysense.serve.metrics import Metrics, missing
from bodysense.serve.protocol import SUBPROTOCOL
from bodysense.serve.runtimes import links_of
from bodysense.serve.safety import why_refused
from bodysense.serve.settings import ServerSettings

_NO_PAGE = "bodysense serves no page here: this copy was installed without it. The WebSocket is at /ws.\n"
_NO_UPLOAD = "bodysense takes no uploads; avatars and recordings that are dropped on the page stay in the browser.\n"
_LINGER_S = 1.0
_LINGER_BYTES = 1024 * 1024
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Content-Security-Policy": "frame-ancestors 'none'",
}


def application(settings: ServerSettings) -> Any:
    """The ASGI application of one process. Raises BodysenseError where the libraries of the server are missing."""
    try:
        from starlette.applications import Starlette
        from starlette.responses import PlainTextResponse, Response
        from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
        from starlette.staticfiles import StaticFiles
        from starlette.websockets import WebSocket
    except ImportError:
        raise missing("starlette") from None
    metrics = Metrics()
    links = links_of(settings, metrics)

    def show(answer: Answer) -> None:
        for link in links:
            link.show(answer)

    live = Live(
        settings.limits, metrics, settings.allow_record, settings.playable, show if links else None, settings.person
    )
    access = settings.access

    async def websocket(client: WebSocket) -> None:
        offered = client.scope.get("subprotocols", [])
        tokens = [name.removeprefix("token.") for name in offered if name.startswith("token.")]
        tokens += client.query_params.getlist("token")
        reason = why_refused(access, client.headers.get("host"), client.headers.get("origin"), tokens)
        status = 403
        if reason is None and offered and SUBPROTOCOL not in offered:
            reason, status = f"the subprotocol is {SUBPROTOCOL!r}, not {offered[0][:40]!r}; update the client", 400
        if reason is not None:
            metrics.closed(status)
            await client.send_denial_response(PlainTextResponse(f"{reason}\n", status, _HEADERS))
            return
        await client.accept(SUBPROTOCOL if offered else None)
        await converse(client, live)

    async def healthz(_: Any) -> Response:
        return PlainTextResponse("ok\n", headers=_HEADERS)

    async def metrics_text(request: Any) -> Response:
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        tokens = [bearer, *request.query_params.getlist("token")]
        reason = why_refused(access, request.headers.get("host"), None, tokens)
        if reason is not None:
            return PlainTextResponse(f"{reason}\n", 403, _HEADERS)
        text, kind = metrics.text()
        return Response(text, media_type=kind, headers=_HEADERS)

    async def no_page(_: Any) -> Response:
        return PlainTextResponse(_NO_PAGE, headers=_HEADERS)

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

    page = Path(str(files("bodysense.serve").joinpath("page")))
    routes: list[BaseRoute] = [
        WebSocketRoute("/ws", websocket),
        Route("/healthz", healthz),
        Route("/metrics", metrics_text),
    ]
    has_page = (page / "index.html").is_file()
    routes.append(Mount("/", StaticFiles(directory=page, html=True)) if has_page else Route("/", no_page))
    return guarded(Starlette(routes=routes, lifespan=lifespan))


def guarded(application: Any) -> Any:
    """The application, with safe headers, and without bodies: an upload is refused before it is read."""

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
                more = [(name.lower().encode(), value.encode()) for name, value in _HEADERS.items()]
                message["headers"] = [*message["headers"], *(row for row in more if row[0] not in have)]
            await send(message)

        await application(scope, receive, with_headers)

    return guard


async def _refuse_upload(receive: Any, send: Any) -> None:
    """Answer 413, then let go only when the sender has stopped, or has had its time.

    A connection closed over unread bytes is reset, and a reset takes the answer with it.
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
