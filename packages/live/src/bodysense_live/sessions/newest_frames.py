"""A WebSocket protocol for uvicorn in which a newer frame replaces one that the application has not read.

uvicorn reads a socket in chunks of up to 256 KiB and queues every message of a chunk. A late server would decode old
signals. In this queue the next signal replaces a queued one. Texts and their order are kept.
"""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Any

SKIPPED = "bodysense.skipped"  # key of a message: the number of frames that it replaced


class NewestFrames(asyncio.Queue[Any]):
    """A queue of ASGI messages in which a binary message replaces the one before it."""

    def _init(self, maxsize: int) -> None:
        self._queue: deque[dict[str, Any]] = deque()

    def _put(self, item: dict[str, Any]) -> None:
        before = self._queue[-1] if self._queue else {}
        if item.get("bytes") is not None and before.get("bytes") is not None:
            self._queue.pop()
            item = {**item, SKIPPED: before.get(SKIPPED, 0) + 1}
        self._queue.append(item)


def websocket_protocol() -> type[asyncio.Protocol]:
    """Return uvicorn's WebSocket protocol with a queue of `NewestFrames`."""
    from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

    class NewestFramesProtocol(WebSocketsSansIOProtocol):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            self.queue = NewestFrames()

    return NewestFramesProtocol
