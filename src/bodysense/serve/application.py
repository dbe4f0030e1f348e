"""The web application: `/ws`, `/healthz`, `/metrics` and the page."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from importlib.resources import files
from pathlib import Path
from typing import Any

from bodysense.errors import missing_package
from bodysense.serve.answer import Answer
from bodysense.serve.connection import converse
from bodysense.serve.headers import HEADERS, guarded
from bodysense.serve.live import Live
from bodysense.serve.metrics import Metrics
from bodysense.serve.page_files import library_routes
from bodysense.serve.protocol import SUBPROTOCOL
from bodysense.serve.runtimes import links_of
from bodysense.serve.safety import Doorkeeper
from bodysense.serve.session_store import SessionStore
from bodysense.serve.settings import ServerSettings

_NO_PAGE = "bodysense serves no page here: this copy was installed without it. The WebSocket is at /ws.\n"


def application(settings: ServerSettings) -> Any:
    """The ASGI application of one process. Raises BodysenseError where the libraries of the server are missing."""
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

    def show(answer: Answer) -> None:
        for link in links:
            link.show(answer)

    live = Live(
        settings.limits,
        metrics,
        settings.allow_record,
        settings.playable,
        show if links else None,
        settings.person,
        settings.wearer,
        settings.recentre,
        None if settings.shared is None else SessionStore(settings.shared, settings.limits.seconds_to_resume),
        settings.save_person,
    )
    keeper = Doorkeeper(settings.access)

    async def websocket(client: WebSocket) -> None:
        offered = client.scope.get("subprotocols", [])
        tokens = [name.removeprefix("token.") for name in offered if name.startswith("token.")]
        tokens += client.query_params.getlist("token")
        reason, status = await keeper.why_refused(client, client.headers.get("origin"), tokens), 403
        if reason is None and offered and SUBPROTOCOL not in offered:
            reason, status = f"the subprotocol is {SUBPROTOCOL!r}, not {offered[0][:40]!r}; update the client", 400
        if reason is not None:
            metrics.closed(status)
            await client.send_denial_response(PlainTextResponse(f"{reason}\n", status, HEADERS))
            return
        await client.accept(SUBPROTOCOL if offered else None)
        await converse(client, live)

    async def healthz(_: Any) -> Response:
        return PlainTextResponse("ok\n", headers=HEADERS)

    async def metrics_text(request: Any) -> Response:
        bearer = request.headers.get("authorization", "").removeprefix("Bearer ")
        tokens = [bearer, *request.query_params.getlist("token")]
        reason = await keeper.why_refused(request, None, tokens)
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

    page = Path(str(files("bodysense.serve").joinpath("page")))
    routes: list[BaseRoute] = [
        WebSocketRoute("/ws", websocket),
        Route("/healthz", healthz),
        Route("/metrics", metrics_text),
        *library_routes(),
    ]
    has_page = (page / "index.html").is_file()
    routes.append(Mount("/", StaticFiles(directory=page, html=True)) if has_page else Route("/", no_page))
    return guarded(Starlette(routes=routes, lifespan=lifespan))
