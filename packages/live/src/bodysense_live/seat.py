"""A session's place in the server: who is connected to it, what plays it, what records it.

Whose body goes to avatars and runtimes.

The file of whoever the server's own inputs track: written when they are calibrated, read by the next start.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense_live.answer import Answer
from bodysense_live.messages import Notice, ServerMessage, Source, Welcome
from bodysense_live.outbox import Outbox
from bodysense_live.recorder import Recorder
from bodysense_live.replay import Player
from bodysense_live.session import Session, rounded


@dataclass(eq=False)
class Seat:
    """A session and everybody who is shown it."""

    identity: str
    token: str  # to resume it
    watch_token: str
    name: str
    session: Session
    source: Source | None = None  # where the server plays its signal itself
    outboxes: list[Outbox] = field(default_factory=list)
    left: float | None = None  # s, of the loop's clock: when the last connection broke
    player: Player | None = None
    playing: asyncio.Task[None] | None = None
    recorder: Recorder | None = None
    told: int = 0  # the revision of the session that its clients know
    kept: object = None  # what the store has of the session, as `Live` compares it

    def tell(self, message: ServerMessage) -> None:
        """Tell all its clients."""
        for outbox in self.outboxes:
            outbox.tell(message)

    @property
    def is_driven(self) -> bool:
        """Whether anybody is connected to it who does not only watch."""
        return any(not outbox.watches for outbox in self.outboxes)

    def welcome(
        self, sources: tuple[Source, ...], recording: bool, resumed: bool = False, watches: bool = False
    ) -> Welcome:
        """What a client is told of it. `sources` can be watched; `recording`: whether the server records at all."""
        session, skeleton = self.session, self.session.skeleton
        secret = self.source is not None or watches
        return Welcome(
            session=self.identity,
            token="" if secret else self.token,
            watch_token="" if secret else self.watch_token,
            name=self.name,
            joints=skeleton.joints,
            points=skeleton.points,
            parents=skeleton.parents,
            rest_offset=rounded(skeleton),
            height=round(session.height, 4),
            signal=session.points,
            settings=session.settings,
            sources=sources,
            recording=recording,
            length=None if self.player is None else self.player.playable.length,
            resumed=resumed,
        )


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


class WearerFile:
    """A person's file; `path` None: none is kept."""

    def __init__(self, path: Path | None) -> None:
        self._path = path

    def keep(self, seat: Seat) -> None:
        """Write the wearer of a session, where they were calibrated since the last call."""
        wearer, seat.session.calibrated = seat.session.calibrated, None
        if wearer is None or self._path is None:
            return
        try:
            wearer.save(self._path)
        except (OSError, BodysenseError) as error:
            seat.tell(Notice(f"your file cannot be written: {error}"))
