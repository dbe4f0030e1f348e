"""The send queue of one client: every text in order, and only the newest frame."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Sequence

from bodysense.io.protocol import ProtocolError
from bodysense_live.message_text import write_message
from bodysense_live.messages import ServerMessage


class Outbox:
    """Holds at most one answer and `most` texts; if there are more, `is_full`, and the connection is to be closed.

    `watches`: the client watches a session that another one drives, and changes nothing.
    """

    def __init__(self, most: int) -> None:
        self.watches = False
        self._texts: deque[str] = deque()
        self._frames: Sequence[bytes] = ()
        self._most = most
        self._filled = asyncio.Event()
        self.is_full = False
        self.ended: ProtocolError | None = None  # why the connection is to be closed

    def tell(self, message: ServerMessage) -> None:
        """Send a text."""
        if len(self._texts) >= self._most:
            self.is_full = True
        else:
            self._texts.append(write_message(message))
        self._filled.set()

    def show(self, frames: Sequence[bytes]) -> bool:
        """Send the frames of one answer in place of those that wait. Returns whether any waited."""
        shed, self._frames = bool(self._frames), frames
        self._filled.set()
        return shed

    def end(self, reason: str, code: int = 1008) -> None:
        """Close the connection; the session may go on without it. `code` is that of the closing frame."""
        self.ended = ProtocolError(reason, code)
        self._filled.set()

    async def take(self) -> tuple[Sequence[str], Sequence[bytes]]:
        """Wait for texts and frames to send, and return them."""
        await self._filled.wait()
        self._filled.clear()
        texts, frames = list(self._texts), self._frames
        self._texts.clear()
        self._frames = ()
        return texts, frames
