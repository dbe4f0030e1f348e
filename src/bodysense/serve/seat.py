"""A session's place in the server: who is connected to it, what plays it, what records it."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field

from bodysense.serve.messages import ServerMessage, Source, Welcome
from bodysense.serve.outbox import Outbox
from bodysense.serve.recorder import Recorder
from bodysense.serve.replay import Player
from bodysense.serve.session import Session, rounded


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
