"""All sessions of one process: they begin with a hello and are kept for a while after a broken connection."""

from __future__ import annotations

import asyncio
import hmac
import secrets
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from time import monotonic
from typing import TYPE_CHECKING

from bodysense.errors import BodysenseError
from bodysense.io.protocol import ProtocolError, SignalFrame, write_pose, write_signal, write_truth
from bodysense_live.answer import Answer
from bodysense_live.message_text import changed
from bodysense_live.messages import (
    Calibrate,
    Change,
    Hello,
    Recentre,
    RecordSwitch,
    Replay,
    Resume,
    ServerMessage,
    Settings,
    Source,
)
from bodysense_live.metrics import Metrics
from bodysense_live.outbox import Outbox
from bodysense_live.recordings import Recordings
from bodysense_live.replay import Playable, Player
from bodysense_live.scheduler import Scheduler
from bodysense_live.seat import Leader, Seat, WearerFile
from bodysense_live.session import Session
from bodysense_live.session_store import Kept, SessionStore

if TYPE_CHECKING:
    from bodysense_live.settings import ServerSettings

_SWEEP = 0.5  # s between looks for sessions that are over
_SHARE = 0.05  # s between two times that sessions are stored, however often they change
_ELSEWHERE = "the session was resumed by another connection"


class Live:
    """The sessions of a process. Used within its event loop only, between `start` and `stop`.

    Args:
        settings: those of the server.
        metrics: counters.
        show: called with each answer that goes to avatars (`Leader`).
    """

    def __init__(
        self, settings: ServerSettings, metrics: Metrics, show: Callable[[Answer], None] | None = None
    ) -> None:
        self._settings, self.metrics, self._show = settings, metrics, show
        self.limits = settings.limits
        shared = settings.shared
        self._store = None if shared is None else SessionStore(shared, self.limits.seconds_to_resume)
        self._wearers, self._leader = WearerFile(settings.save_person, settings.trackers), Leader()
        self._recordings = Recordings(settings.allow_record, self.limits.recording_seconds)
        self._seats: dict[str, Seat] = {}
        self._inputs: dict[Source, Seat] = {}
        self._tasks: list[asyncio.Task[None]] = []
        self._just_left: set[str] = set()  # sessions that were left since they were last stored
        self._changed = asyncio.Event()  # a session is to be stored

    def start(self) -> None:
        """Begin; needs a running loop."""
        self._loop = asyncio.get_running_loop()
        self._scheduler: Scheduler[Seat] = Scheduler(self._deliver, self._refuse, self.metrics.stepping.inc)
        self._tasks = [self._loop.create_task(self._scheduler.run()), self._loop.create_task(self._sweep())]
        if self._settings.playable is not None and self._show is not None:
            self._inputs["replay"] = self._play(self._settings.playable, "replay", Settings())

    async def stop(self) -> None:
        """End every session and finish its recording."""
        for seat in list(self._seats.values()):
            self._end(seat)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._store is not None:
            await self._store.close()

    @property
    def is_full(self) -> bool:
        """Whether all sessions are in use."""
        return len(self._seats) >= self.limits.sessions and all(seat.left is None for seat in self._seats.values())

    def own(self, source: Source, points: tuple[str, ...]) -> Seat:
        """A session for an input of the server's own."""
        session = Session(points, self._settings.person, self._settings.wearer, eased=True)
        seat = self._seated(source, session, source)
        if self._settings.recentre:
            seat.session.change(Recentre())
        self._inputs[source] = seat
        return seat

    @property
    def sources(self) -> tuple[Source, ...]:
        """Inputs that clients can watch."""
        replay: tuple[Source, ...] = ("replay",) if self._settings.playable is not None else ()
        return (*replay, *(source for source in self._inputs if source != "replay"))

    async def admit(self, hello: Hello, outbox: Outbox) -> Seat:
        """The session of a client, welcomed. Raises ProtocolError where it cannot have one."""
        outbox.watches = hello.follow is not None
        seat = await self._resumed(hello, hello.resume) if hello.resume is not None else None
        resumed = seat is not None
        if seat is None:
            seat = self._followed(hello.follow) if hello.follow is not None else self._new(hello)
        seat.outboxes.append(outbox)
        if not outbox.watches:
            seat.left = None
        outbox.tell(seat.welcome(self.sources, self._recordings.are_allowed, resumed, outbox.watches))
        outbox.tell(seat.session.placed())
        self._changed.set()
        return seat

    def leave(self, seat: Seat, outbox: Outbox) -> None:
        """A connection ended: the session is kept for a while."""
        if outbox in seat.outboxes:
            seat.outboxes.remove(outbox)
        if not seat.is_driven and seat.left is None:
            seat.left = self._loop.time()
            self._just_left.add(seat.identity)
            self._changed.set()

    async def may_read(self, seat: Seat) -> None:
        """Wait until another frame of a session is of use: at once, unless one waits while others are stepped."""
        if seat.session.has_waiting:
            await self._scheduler.reading.wait()

    def receive(self, seat: Seat, frame: SignalFrame | bytes, skipped: int = 0) -> None:
        """Take a frame of a session, before which a client's connection skipped some."""
        self._wearers.recognise(seat)
        self.metrics.frames.inc(1 + skipped)
        for _ in range(skipped):
            self.metrics.dropped("replaced")
        dropped = seat.session.receive(frame, monotonic())
        if dropped is not None:
            self.metrics.dropped(dropped)
        self._scheduler.ready(seat)

    def change(self, seat: Seat, message: Change | Recentre | Calibrate | RecordSwitch | Replay) -> None:
        """Apply a client's command. Raises ProtocolError if that is impossible."""
        if isinstance(message, RecordSwitch):
            self._recordings.switch(seat, message.on)
        elif isinstance(message, Replay):
            if seat.player is None:
                raise ProtocolError("replay: this session watches no replay; say 'watch' in the hello")
            try:
                seat.player.change(message)
            except BodysenseError as error:
                raise ProtocolError(str(error)) from None
        else:
            seat.session.change(message)
        self._tell(seat)

    def change_inputs(self, message: Recentre | Calibrate) -> None:
        """Apply a command to the wearers of the server's own inputs."""
        for source, seat in self._inputs.items():
            if source not in ("replay", "markers"):
                self.change(seat, message)

    def _new(self, hello: Hello) -> Seat:
        settings = hello.settings if hello.height is None else changed(hello.settings, {"height": hello.height})
        if hello.watch is not None:
            if hello.watch not in self.sources:
                have = ", ".join(self.sources) or "none"
                raise ProtocolError(f"the server has no input {hello.watch!r} to watch; it has {have}", 1008)
            if hello.watch != "replay":
                return self._inputs[hello.watch]
            assert self._settings.playable is not None
            self._make_room()
            return self._play(self._settings.playable, hello.name, settings)
        self._make_room()
        return self._seated(hello.name, Session(hello.points, self._settings.person, settings), None)

    def _make_room(self) -> None:
        """End the session without a connection that was left first, if the server is full."""
        if len(self._seats) < self.limits.sessions:
            return
        left = [seat for seat in self._seats.values() if seat.left is not None]
        if not left:
            raise ProtocolError(f"the server has its {self.limits.sessions} sessions already; try again later", 1013)
        self._end(min(left, key=lambda seat: seat.left or 0.0))

    def _followed(self, follow: Resume) -> Seat:
        """Another client's session, to be watched."""
        seat = self._seats.get(follow.session)
        if seat is None or not hmac.compare_digest(seat.watch_token.encode(), follow.token.encode()):
            raise ProtocolError("there is no such session to watch, or its token is another", 1008)
        return seat

    async def _resumed(self, hello: Hello, resume: Resume) -> Seat | None:
        """The session that a client had, here or in another process; None where it is over."""
        taken = None if self._store is None else await self._store.take(resume)
        seat = self._seats.get(resume.session)
        if taken is not None and (seat is None or taken[0] > seat.turn + 1):  # another process had it last
            if seat is not None:
                self._end(seat, _ELSEWHERE)
            return self._taken_on(hello, resume, *taken)
        if (
            seat is None
            or seat.source is not None
            or not hmac.compare_digest(seat.token.encode(), resume.token.encode())
        ):
            return None
        for outbox in [one for one in seat.outboxes if not one.watches]:  # broken, but not yet noticed
            outbox.end(_ELSEWHERE)
            seat.outboxes.remove(outbox)
        seat.turn = max(seat.turn, 0 if taken is None else taken[0])
        seat.session.open_door(hello.points)
        return seat

    def _taken_on(self, hello: Hello, resume: Resume, turn: int, kept: Kept) -> Seat:
        """A session that another process had."""
        self._make_room()
        session = Session(hello.points, kept.person, kept.settings, kept.placement, kept.worn)
        seat = Seat(resume.session, kept.token, kept.watch_token, kept.name, session, turn=turn)
        self._seats[seat.identity] = seat
        self.metrics.sessions.set(len(self._seats))
        return seat

    async def _share(self) -> None:
        """Store sessions for other processes, and end those that another one has taken on."""
        # One that was left is stored once more: its client may have left before the first time.
        driven = {
            one.identity: one
            for one in self._seats.values()
            if (one.is_driven or one.identity in self._just_left) and one.source is None
        }
        self._just_left.clear()
        if self._store is None or not driven:
            return
        lost = await self._store.put({identity: (seat.turn, seat.kept()) for identity, seat in driven.items()})
        if lost is None:
            self.metrics.unshared.inc()
        for identity in lost or ():
            if self._seats.get(identity) is driven[identity]:
                self._end(driven[identity], _ELSEWHERE)

    def _seated(self, name: str, session: Session, source: Source | None) -> Seat:
        token, watch_token = secrets.token_urlsafe(16), secrets.token_urlsafe(16)
        seat = Seat(secrets.token_hex(8), token, watch_token, name, session, source)
        self._seats[seat.identity] = seat
        self.metrics.sessions.set(len(self._seats))
        return seat

    def _play(self, playable: Playable, name: str, settings: Settings) -> Seat:
        seat = self._seated(name, Session(playable.observation.points, playable.person, settings), "replay")

        def play(frame: SignalFrame, afresh: bool) -> None:
            if afresh:
                seat.session.start_afresh()
            self.receive(seat, frame)

        seat.player = Player(playable, play)
        seat.playing = self._loop.create_task(seat.player.run())
        return seat

    def _tell(self, seat: Seat) -> None:
        """Send a session's new messages to its clients."""
        notes: list[ServerMessage] = seat.session.notes()
        if notes or seat.told != seat.session.revision:
            self._changed.set()
        if seat.told != seat.session.revision:
            seat.told = seat.session.revision
            for outbox in seat.outboxes:
                outbox.tell(seat.welcome(self.sources, self._recordings.are_allowed, watches=outbox.watches))
        for note in notes:
            seat.tell(note)

    def _deliver(self, seat: Seat, answer: Answer | None) -> None:
        if seat in self._inputs.values():
            self._wearers.keep(seat)
        self._tell(seat)
        if answer is None:
            self.metrics.dropped("failed")
            return
        spent = monotonic() - answer.received  # a loop may count in milliseconds
        frames = [write_pose(answer.frame, min(int(spent * 1e6), 2**32 - 1))]
        shown = frames
        if seat.source is not None or any(outbox.watches for outbox in seat.outboxes):
            shown = [write_signal(answer.signal), *self._truth(seat, answer), *frames]
        for outbox in seat.outboxes:
            if outbox.show(shown if seat.source is not None or outbox.watches else frames):
                self.metrics.dropped("slow client")
        self.metrics.latency.observe(spent)
        self._recordings.add(seat, answer)
        own = seat in self._inputs.values()
        if self._show is not None and self._leader.leads(seat, answer, own, self._loop.time()):
            self._show(answer)

    def _refuse(self, seat: Seat, error: ProtocolError) -> None:
        """Close the connection that sent a frame with an impossible value."""
        for outbox in seat.outboxes:
            if not outbox.watches:
                self.metrics.closed(error.code)
                outbox.end(str(error), error.code)

    def _truth(self, seat: Seat, answer: Answer) -> list[bytes]:
        truth = None if seat.player is None else seat.player.playable.truth
        if truth is None:
            return []
        index = answer.signal.sequence
        root, rotation = seat.session.truth(truth.root_position[index], truth.rotation[index])
        return [write_truth(replace(answer.frame, sequence=index, root_position=root, rotation=rotation))]

    def _end(self, seat: Seat, reason: str = "the session that was watched is over") -> None:
        self._recordings.stop(seat)
        if seat.playing is not None:
            seat.playing.cancel()
        for outbox in seat.outboxes:
            outbox.end(reason)
        del self._seats[seat.identity]
        self.metrics.sessions.set(len(self._seats))

    async def _sweep(self) -> None:
        """Store sessions, and end those that were not resumed, and replays without a watcher."""
        while True:
            await asyncio.sleep(_SHARE)
            with suppress(TimeoutError):  # `wait_for` of Python 3.11 may lose a cancellation
                async with asyncio.timeout(_SWEEP - _SHARE):
                    await self._changed.wait()
            self._changed.clear()
            await self._share()
            now = self._loop.time()
            for seat in list(self._seats.values()):
                keep = 0.0 if seat.source is not None else self.limits.seconds_to_resume
                if seat.left is not None and now - seat.left > keep and seat not in self._inputs.values():
                    self._end(seat)
