"""Whose body goes to avatars and runtimes."""

from __future__ import annotations

from bodysense.serve.answer import Answer
from bodysense.serve.seat import Seat

_SILENCE = 1.0  # s after which another one leads


class Leader:
    """The first session that sends a body, until it is silent; the server's own inputs come before clients.

    Who only looks (a page that was opened) sends none, and never leads.
    """

    def __init__(self) -> None:
        self._seat: Seat | None = None
        self._own = False
        self._at = 0.0  # s, when it last led

    def leads(self, seat: Seat, answer: Answer, own: bool, now: float) -> bool:
        """Whether this answer, of one of the server's `own` inputs or of a client, goes to avatars."""
        if not answer.is_tracked:
            return False
        if self._seat is not seat and self._seat is not None:
            is_silent, is_outranked = now - self._at > _SILENCE, own and not self._own
            if not is_silent and not is_outranked:
                return False
        self._seat, self._own, self._at = seat, own, now
        return True
