"""What waits to be sent to one client: every text in order, and of the frames the newest only."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

from bodysense_live.message_text import write_message
from bodysense_live.messages import ServerMessage


class Outbox:
    """Never holds more than one answer and `most` texts; beyond, `is_full`, and the client is to be closed.

    `watches`: its client is shown a session that another one drives, and changes nothing.
    """

    def __init__(self, most: int) -> None:
        self.watches = False
        self._texts: deque[str] = deque()
        self._frames: Sequence[bytes] = ()
        self._most = most
        self._filled = asyncio.Event()
        self.is_full = False
        self.ended: str | None = None  # why the connection is to be closed

    def tell(self, message: ServerMessage) -> None:
        """Send a text."""
        if len(self._texts) >= self._most:
            self.is_full = True
        else:
            self._texts.append(write_message(message))
        self._filled.set()

    def show(self, frames: Sequence[bytes]) -> bool:
        """Send the frames of one answer, in place of those that wait; whether any waited."""
        shed, self._frames = bool(self._frames), frames
        self._filled.set()
        return shed

    def end(self, reason: str) -> None:
        """The session goes on without this connection, or not at all."""
        self.ended = reason
        self._filled.set()

    async def take(self) -> tuple[Sequence[str], Sequence[bytes]]:
        """What is to be sent next, waited for."""
        await self._filled.wait()
        self._filled.clear()
        texts, frames = list(self._texts), self._frames
        self._texts.clear()
        self._frames = ()
        return texts, frames
