"""The send queue of one client: every text in order, and only the newest frame."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

from bodysense.io.formats.protocol import ProtocolError
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import ServerMessage


class SendQueue:
    """A queue of at most one answer and `most` texts; further texts set `is_full`, and the connection must be closed.

    `is_watcher`: the client watches another client's session and may not change it.
    """

    def __init__(self, most: int) -> None:
        self.is_watcher = False
        self._texts: deque[str] = deque()
        self._frames: Sequence[bytes] = ()
        self._most = most
        self._filled = asyncio.Event()
        self.is_full = False
        self.closing: ProtocolError | None = None  # set to close the connection, with the reason

    def put_message(self, message: ServerMessage) -> None:
        """Queue a message."""
        if len(self._texts) >= self._most:
            self.is_full = True
        else:
            self._texts.append(write_message(message))
        self._filled.set()

    def put_frames(self, frames: Sequence[bytes]) -> bool:
        """Queue the frames of one answer, and drop those of an earlier one. Return whether any were dropped."""
        has_replaced, self._frames = bool(self._frames), frames
        self._filled.set()
        return has_replaced

    def close(self, reason: str, code: int = 1008) -> None:
        """Close the connection; the session may continue without it. `code` is the WebSocket close code."""
        self.closing = ProtocolError(reason, code)
        self._filled.set()

    async def take(self) -> tuple[Sequence[str], Sequence[bytes]]:
        """Wait until there is something to send. Return texts and frames, and empty the queue."""
        await self._filled.wait()
        self._filled.clear()
        texts, frames = list(self._texts), self._frames
        self._texts.clear()
        self._frames = ()
        return texts, frames
