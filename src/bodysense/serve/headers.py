"""What every answer by HTTP has: safe headers; and no request has a body."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

_NO_UPLOAD = "bodysense takes no uploads; avatars and recordings that are dropped on the page stay in the browser.\n"
_LINGER_S = 1.0
_LINGER_BYTES = 1024 * 1024
HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address holds the token
    "Content-Security-Policy": "frame-ancestors 'none'",
}


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
                more = [(name.lower().encode(), value.encode()) for name, value in HEADERS.items()]
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
