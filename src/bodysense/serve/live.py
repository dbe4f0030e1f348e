"""All sessions of one process: who comes, stays for a while after a broken connection, and goes."""

from __future__ import annotations

import asyncio
import hmac
import secrets
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from time import monotonic

from bodysense.body.person import Person
from bodysense.errors import BodysenseError
from bodysense.serve.answer import Answer
from bodysense.serve.messages import (
    Calibrate,
    Change,
    Hello,
    Recentre,
    RecordSwitch,
    Replay,
    Resume,
    Said,
    ServerMessage,
    Settings,
    Source,
    changed,
)
from bodysense.serve.metrics import Metrics
from bodysense.serve.outbox import Outbox
from bodysense.serve.protocol import (
    ProtocolError,
    SignalFrame,
    write_pose,
    write_signal,
    write_truth,
)
from bodysense.serve.recorder import Recorder
from bodysense.serve.replay import Playable, Player
from bodysense.serve.safety import Limits
from bodysense.serve.scheduler import Scheduler
from bodysense.serve.seat import Seat
from bodysense.serve.session import Session

_SWEEP = 0.5  # s between looks for sessions that are over


class Live:
    """The sessions of a process. Used within its event loop only, between `start` and `stop`.

    `person` is what is known of wearers who do not tell their height. `show(answer)` is called with what goes to
    avatars: the server's own session, or else the one that came first.
    """

    def __init__(
        self,
        limits: Limits,
        metrics: Metrics,
        allow_record: Path | None = None,
        playable: Playable | None = None,
        show: Callable[[Answer], None] | None = None,
        person: Person = Person(),
    ) -> None:
        self.limits, self.metrics = limits, metrics
        self._allow_record, self._playable, self._show = allow_record, playable, show
        self._person = person
        self._seats: dict[str, Seat] = {}
        self._inputs: dict[Source, Seat] = {}
        self._tasks: list[asyncio.Task[None]] = []

    def start(self) -> None:
        """Begin; needs a running loop."""
        self._loop = asyncio.get_running_loop()
        self._scheduler: Scheduler[Seat] = Scheduler(self._deliver)
        self._tasks = [self._loop.create_task(self._scheduler.run()), self._loop.create_task(self._sweep())]
        if self._playable is not None and self._show is not None:
            self._inputs["replay"] = self._play(self._playable, "replay", Settings())

    async def stop(self) -> None:
        """End every session and finish its recording."""
        for seat in list(self._seats.values()):
            self._end(seat)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def own(self, source: Source, points: tuple[str, ...]) -> Seat:
        """A session for an input of the server's own."""
        seat = self._seated(source, Session(points, self._person), source)
        self._inputs[source] = seat
        return seat

    @property
    def sources(self) -> tuple[Source, ...]:
        """What can be watched."""
        replay: tuple[Source, ...] = ("replay",) if self._playable is not None else ()
        return (*replay, *(source for source in self._inputs if source != "replay"))

    def admit(self, hello: Hello, outbox: Outbox) -> Seat:
        """The session of a client, welcomed. Raises ProtocolError where it cannot have one."""
        seat = self._resumed(hello) if hello.resume is not None else None
        resumed = seat is not None
        if seat is None:
            seat = self._new(hello)
        seat.outboxes.append(outbox)
        seat.left = None
        outbox.tell(seat.welcome(self.sources, self._allow_record is not None, resumed))
        outbox.tell(seat.session.placed())
        return seat

    def leave(self, seat: Seat, outbox: Outbox) -> None:
        """A connection ended: the session is kept for a while."""
        if outbox in seat.outboxes:
            seat.outboxes.remove(outbox)
        if not seat.outboxes:
            seat.left = self._loop.time()

    def receive(self, seat: Seat, frame: SignalFrame) -> None:
        """A frame of a session came in."""
        self.metrics.frames.inc()
        dropped = seat.session.receive(frame, monotonic())
        if dropped is not None:
            self.metrics.dropped(dropped)
        self._scheduler.ready(seat)

    def change(self, seat: Seat, message: Change | Recentre | Calibrate | RecordSwitch | Replay) -> None:
        """Do what a client asks for. Raises ProtocolError where it is nothing that can be done."""
        if isinstance(message, RecordSwitch):
            self._record(seat, message.on)
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

    def _new(self, hello: Hello) -> Seat:
        settings = hello.settings if hello.height is None else changed(hello.settings, {"height": hello.height})
        if hello.watch is not None:
            if hello.watch not in self.sources:
                have = ", ".join(self.sources) or "none"
                raise ProtocolError(f"the server has no input {hello.watch!r} to watch; it has {have}", 1008)
            if hello.watch != "replay":
                return self._inputs[hello.watch]
            assert self._playable is not None
            self._make_room()
            return self._play(self._playable, hello.name, settings)
        self._make_room()
        return self._seated(hello.name, Session(hello.points, self._person, settings), None)

    def _make_room(self) -> None:
        """Sessions that nobody is connected to go first."""
        if len(self._seats) < self.limits.sessions:
            return
        left = [seat for seat in self._seats.values() if seat.left is not None]
        if not left:
            raise ProtocolError(f"the server has its {self.limits.sessions} sessions already; try again later", 1013)
        self._end(min(left, key=lambda seat: seat.left or 0.0))

    def _resumed(self, hello: Hello) -> Seat | None:
        """The session that a client had, None where it is over."""
        assert isinstance(hello.resume, Resume)
        seat = self._seats.get(hello.resume.session)
        if seat is None or seat.source is not None:
            return None
        if not hmac.compare_digest(seat.token.encode(), hello.resume.token.encode()):
            return None
        for outbox in seat.outboxes:  # a connection that is broken without anybody having noticed
            outbox.supersede()
        seat.outboxes.clear()
        seat.session.open_door(hello.points)
        return seat

    def _seated(self, name: str, session: Session, source: Source | None) -> Seat:
        seat = Seat(secrets.token_hex(8), secrets.token_urlsafe(16), name, session, source)
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
        """Tell the clients of a session what they do not know yet."""
        notes: list[ServerMessage] = seat.session.notes()
        if seat.told != seat.session.revision:
            seat.told = seat.session.revision
            notes.insert(0, seat.welcome(self.sources, self._allow_record is not None))
        for note in notes:
            for outbox in seat.outboxes:
                outbox.tell(note)

    def _deliver(self, seat: Seat, answer: Answer | None) -> None:
        self._tell(seat)
        if answer is None:
            self.metrics.dropped("failed")
            return
        spent = monotonic() - answer.received  # a loop may count in milliseconds
        frames = [write_pose(answer.frame, min(int(spent * 1e6), 2**32 - 1))]
        if seat.source is not None and seat.outboxes:
            frames = [write_signal(answer.signal), *self._truth(seat, answer), *frames]
        for outbox in seat.outboxes:
            if outbox.show(frames):
                self.metrics.dropped("slow client")
        self.metrics.latency.observe(spent)
        if seat.recorder is not None and not seat.recorder.add(answer):
            self._stop_recording(seat)
            seat.tell(Said("the recording ended: it was as long as it may be"))
        if self._show is not None and seat is self._leader():
            self._show(answer)

    def _truth(self, seat: Seat, answer: Answer) -> list[bytes]:
        truth = None if seat.player is None else seat.player.playable.truth
        if truth is None:
            return []
        index = answer.signal.sequence
        root, rotation = seat.session.truth(truth.root_position[index], truth.rotation[index])
        return [write_truth(replace(answer.frame, sequence=index, root_position=root, rotation=rotation))]

    def _leader(self) -> Seat | None:
        """Whose pose goes to avatars."""
        own = next(iter(self._inputs.values()), None)
        if own is not None:
            return own
        return next((seat for seat in self._seats.values() if seat.outboxes), None)

    def _record(self, seat: Seat, on: bool) -> None:
        if self._allow_record is None:
            seat.tell(Said("the server does not record; start it with --allow-record and a folder"))
            return
        if not on:
            self._stop_recording(seat)
        elif seat.recorder is None:
            try:
                seat.recorder = Recorder(
                    self._allow_record, seat.identity, seat.session.skeleton, self.limits.recording_seconds
                )
            except BodysenseError:
                seat.tell(Said("the server's folder for recordings cannot be written to"))
                return
            seat.tell(Said(f"recording to {seat.recorder.path.name}"))

    def _stop_recording(self, seat: Seat) -> None:
        if seat.recorder is None:
            return
        recorder, seat.recorder = seat.recorder, None
        try:
            frames = recorder.close()
        except BodysenseError as error:
            seat.tell(Said(str(error).replace(f"{recorder.path.parent}/", "")))
            return
        seat.tell(Said(f"recorded {frames} frames to {recorder.path.name}" if frames else "nothing to record"))

    def _end(self, seat: Seat) -> None:
        self._stop_recording(seat)
        if seat.playing is not None:
            seat.playing.cancel()
        del self._seats[seat.identity]
        self.metrics.sessions.set(len(self._seats))

    async def _sweep(self) -> None:
        """End sessions to which nobody came back, and replays that nobody watches."""
        while True:
            await asyncio.sleep(_SWEEP)
            now = self._loop.time()
            for seat in list(self._seats.values()):
                keep = 0.0 if seat.source is not None else self.limits.seconds_to_resume
                if seat.left is not None and now - seat.left > keep and seat not in self._inputs.values():
                    self._end(seat)
