"""A session in the server: its connections, its player and its recorder.

`Leader` chooses the body that goes to avatars and runtimes. `WearerFile` writes the calibrated wearer of the server's
own inputs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense_live.answer import Answer
from bodysense_live.messages import Notice, ServerMessage, Source, Welcome
from bodysense_live.outbox import Outbox
from bodysense_live.recorder import Recorder
from bodysense_live.replay import Player
from bodysense_live.session import Session, rounded
from bodysense_live.session_store import Kept
from bodysense_live.worn_trackers import save_wearer


@dataclass(eq=False)
class Seat:
    """A session and its connections."""

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
    turn: int = 1  # in the store: how many processes have had the session
    state: str = ""  # in the form of the store
    stored: object = None  # the session's values in it, for comparison
    serials: Callable[[], Mapping[str, str]] = dict  # of nameless trackers of the server's own input, to their names
    known_serials: Mapping[str, str] = field(default_factory=dict)  # those whose joints the session knows

    def kept(self) -> str:
        """Return what another process needs to go on with the session."""
        session = self.session
        now = session.revision, session.placed(), round(session.height, 2), dict(session.worn)
        if now != self.stored:
            kept = Kept(self.token, self.watch_token, self.name, session.settings, *session.kept())
            self.state, self.stored = kept.to_json(), now
        return self.state

    def tell(self, message: ServerMessage) -> None:
        """Send a message to all its clients."""
        for outbox in self.outboxes:
            outbox.tell(message)

    @property
    def is_driven(self) -> bool:
        """Whether a client is connected that does more than watch."""
        return any(not outbox.watches for outbox in self.outboxes)

    def welcome(
        self, sources: tuple[Source, ...], recording: bool, resumed: bool = False, watches: bool = False
    ) -> Welcome:
        """Return the welcome of a client. `sources` can be watched; `recording`: whether the server records at all."""
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
    """The choice of the session whose body goes to avatars.

    The first that sends a body leads until it is silent; the server's own inputs come before clients. A page that only
    watches never leads, even if it has a replay of its own.
    """

    def __init__(self) -> None:
        self._seat: Seat | None = None
        self._own = False
        self._at = 0.0  # s, when it last led

    def leads(self, seat: Seat, answer: Answer, own: bool, now: float) -> bool:
        """Whether this answer, of one of the server's `own` inputs or of a client, goes to avatars."""
        if not answer.is_tracked or (seat.source is not None and not own):
            return False
        if self._seat is not seat and self._seat is not None:
            is_silent, is_outranked = now - self._at > _SILENCE, own and not self._own
            if not is_silent and not is_outranked:
                return False
        self._seat, self._own, self._at = seat, own, now
        return True


class WearerFile:
    """The file of the wearer of the server's own inputs; `path` None: no file is written.

    `trackers`: joints of nameless trackers by serial, as the file had them at the start.
    """

    def __init__(self, path: Path | None, trackers: Mapping[str, str]) -> None:
        self._path, self._trackers = path, dict(trackers)

    def recognise(self, seat: Seat) -> None:
        """Give a session the joints of nameless trackers that came in since the last call."""
        serials = seat.serials()
        if serials is seat.known_serials:
            return
        seat.known_serials = serials
        seat.session.wear(
            {name: self._trackers[serial] for serial, name in serials.items() if serial in self._trackers}
        )

    def keep(self, seat: Seat) -> None:
        """Write the wearer of a session if they were calibrated since the last call."""
        wearer, seat.session.calibrated = seat.session.calibrated, None
        if wearer is None:
            return
        worn = {serial: seat.session.worn[name] for serial, name in seat.serials().items() if name in seat.session.worn}
        before = {serial: joint for serial, joint in self._trackers.items() if joint not in worn.values()}
        self._trackers = {**before, **worn}
        if self._path is None:
            return
        try:
            save_wearer(wearer, self._trackers, self._path)
        except (OSError, BodysenseError) as error:
            seat.tell(Notice(f"your file cannot be written: {error}"))
