"""All sessions of one process. A session begins with a hello, and outlives a broken connection for a while."""

from __future__ import annotations

import asyncio
import hmac
import secrets
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from time import monotonic
from typing import TYPE_CHECKING

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import ProtocolError, SignalFrame, write_pose, write_signal, write_truth
from bodysense_live.security.safety import TOO_MANY_WRONG, TokenThrottle
from bodysense_live.server.message_text import changed
from bodysense_live.server.messages import (
    Calibrate,
    Hello,
    Notice,
    Recentre,
    RecordSwitch,
    Replay,
    Resume,
    ServerMessage,
    Settings,
    Source,
    UpdateSettings,
)
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.scheduler import Scheduler
from bodysense_live.server.send_queue import SendQueue
from bodysense_live.server.session_slot import OutputSelector, SessionSlot, WearerFile
from bodysense_live.server.session_store import SessionKeeper, StoredSession
from bodysense_live.server.supervisor import HOPELESS_AFTER, Supervisor
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.recordings import Recordings
from bodysense_live.sessions.replay import Playable, Player
from bodysense_live.sessions.session import Session

if TYPE_CHECKING:
    from bodysense_live.server.settings import ServerSettings

_SWEEP_INTERVAL = 0.5  # s between checks for expired sessions
_STORE_INTERVAL = 0.05  # s, shortest interval between two stores of sessions
_FAILING = 1.0  # s of failed frames after which a wearer gets a message
_ELSEWHERE = "the session was resumed by another connection"


class Live:
    """The sessions of a process. Use it within the event loop only, between `start` and `stop`.

    Args:
        settings: settings of the server.
        metrics: counters.
        supervisor: of the tasks; it ends the server if one ends.
        send_body: called with each answer that goes to avatars (`OutputSelector`).
        stores: where sessions are kept for other processes.
    """

    def __init__(
        self,
        settings: ServerSettings,
        metrics: Metrics,
        supervisor: Supervisor,
        send_body: Callable[[Answer], None] | None = None,
        stores: Sequence[SessionKeeper] = (),
    ) -> None:
        self._settings, self.metrics, self._send_body = settings, metrics, send_body
        self.limits, self.supervisor, self._stores = settings.limits, supervisor, tuple(stores)
        self._wearers, self._output_selector = WearerFile(settings.save_person, settings.trackers), OutputSelector()
        self._recordings = Recordings(settings.allow_record, self.limits.recording)
        self._slots: dict[str, SessionSlot] = {}
        self._inputs: dict[Source, SessionSlot] = {}
        self._just_disconnected: set[str] = set()  # session ids of clients that left since the last store
        self._changed = asyncio.Event()  # set if a session must be stored
        self._throttle = TokenThrottle()  # of sessions' tokens
        self._output_failed = False  # an error was printed

    def start(self) -> None:
        """Start the tasks, in a running event loop."""
        self._loop = asyncio.get_running_loop()
        self._recordings.start()
        self._scheduler: Scheduler[SessionSlot] = Scheduler(self._deliver, self._refuse, self.metrics.stepping.inc)
        self.supervisor.start(self._scheduler.run())
        self.supervisor.start(self._sweep())
        self.supervisor.watch(lambda: self._scheduler.waiting_since, self._report_waiting)
        if self._settings.playable is not None and self._send_body is not None:
            self._inputs["replay"] = self._add_replay(self._settings.playable, "replay", Settings())

    async def stop(self) -> None:
        """Close every session and its recording."""
        for slot in list(self._slots.values()):
            self._close(slot)
        await self.supervisor.stop()
        await self._recordings.finish()
        for store in self._stores:
            await store.close()

    @property
    def is_full(self) -> bool:
        """Whether all sessions are in use."""
        return len(self._slots) >= self.limits.sessions and all(
            slot.disconnected_at is None for slot in self._slots.values()
        )

    def add_input(self, source: Source, points: tuple[str, ...]) -> SessionSlot:
        """Add and return a session for one of the server's own inputs."""
        session = Session(points, self._settings.person, self._settings.wearer, eased=True)
        slot = self._add_slot(source, session, source)
        if self._settings.recentre:
            slot.session.apply(Recentre())
        self._inputs[source] = slot
        return slot

    @property
    def sources(self) -> tuple[Source, ...]:
        """Inputs that clients can watch."""
        replay: tuple[Source, ...] = ("replay",) if self._settings.playable is not None else ()
        return (*replay, *(source for source in self._inputs if source != "replay"))

    async def admit(self, hello: Hello, queue: SendQueue, address: str = "") -> SessionSlot:
        """Return a session for a client at an address, and welcome the client.

        Raises ProtocolError if no session is available. A wrong token of a session is answered after a delay.
        """
        queue.is_watcher = hello.follow is not None
        slot = await self._resume(hello, hello.resume, address) if hello.resume is not None else None
        resumed = slot is not None
        if slot is None:
            slot = await self._watched_slot(hello.follow, address) if hello.follow else self._new_slot(hello)
        slot.queues.append(queue)
        if not queue.is_watcher:
            slot.disconnected_at = None
        queue.put_message(slot.welcome(self.sources, self._recordings.are_allowed, resumed, queue.is_watcher))
        queue.put_message(slot.session.placement_message())
        for text in slot.session.doubts:
            queue.put_message(Notice(text))
        self._changed.set()
        return slot

    def disconnect(self, slot: SessionSlot, queue: SendQueue) -> None:
        """Remove a closed connection. The session can be resumed for a while."""
        if queue in slot.queues:
            slot.queues.remove(queue)
        if not slot.is_driven and slot.disconnected_at is None:
            slot.disconnected_at = self._loop.time()
            self._just_disconnected.add(slot.session_id)
            self._changed.set()

    async def wait_to_read(self, slot: SessionSlot) -> None:
        """Wait while sessions are stepped and a frame of this session is pending."""
        if slot.session.has_pending:
            await self._scheduler.reading.wait()

    def receive(self, slot: SessionSlot, frame: SignalFrame | bytes, skipped: int = 0) -> None:
        """Take a frame of a session. `skipped`: number of frames that the connection dropped before it."""
        self._wearers.assign_known_trackers(slot)
        self.metrics.frames.inc(1 + skipped)
        for _ in range(skipped):
            self.metrics.dropped("replaced")
        dropped = slot.session.receive(frame, monotonic())
        if dropped is not None:
            self.metrics.dropped(dropped)
        self._scheduler.ready(slot)

    def apply(self, slot: SessionSlot, message: UpdateSettings | Recentre | Calibrate | RecordSwitch | Replay) -> None:
        """Apply a client's command. Raises ProtocolError if the session does not allow it."""
        if isinstance(message, RecordSwitch):
            self._recordings.switch(slot, message.on)
        elif isinstance(message, Replay):
            if slot.player is None:
                raise ProtocolError("replay: this session watches no replay; set 'watch' in the hello")
            try:
                slot.player.apply(message)
            except BodysenseError as error:
                raise ProtocolError(str(error)) from None
        else:
            slot.session.apply(message)
        self._send_messages(slot)

    def apply_to_inputs(self, message: Recentre | Calibrate) -> None:
        """Apply a command to the wearers of the server's own inputs."""
        for source, slot in self._inputs.items():
            if source not in ("replay", "markers"):
                self.apply(slot, message)

    def _new_slot(self, hello: Hello) -> SessionSlot:
        settings = hello.settings if hello.height is None else changed(hello.settings, {"height": hello.height})
        if hello.watch is not None:
            if hello.watch not in self.sources:
                have = ", ".join(self.sources) or "none"
                raise ProtocolError(f"the server has no input {hello.watch!r} to watch; it has {have}", 1008)
            if hello.watch != "replay":
                return self._inputs[hello.watch]
            assert self._settings.playable is not None
            self._make_room()
            return self._add_replay(self._settings.playable, hello.name, settings)
        self._make_room()
        return self._add_slot(hello.name, Session(hello.points, self._settings.person, settings), None)

    def _make_room(self) -> None:
        """If the server is full, close the session that has been disconnected for the longest time."""
        if len(self._slots) < self.limits.sessions:
            return
        disconnected = [slot for slot in self._slots.values() if slot.disconnected_at is not None]
        if not disconnected:
            raise ProtocolError(f"the server has its {self.limits.sessions} sessions already; try again later", 1013)
        self._close(min(disconnected, key=lambda slot: slot.disconnected_at or 0.0))

    async def _watched_slot(self, follow: Resume, address: str) -> SessionSlot:
        """Return another client's session, to watch it."""
        slot = self._slots.get(follow.session)
        if slot is None or not await self._is_token(slot.watch_token, follow, address):
            raise ProtocolError("there is no such session to watch, or its token is wrong", 1008)
        return slot

    async def _is_token(self, token: str, given: Resume, address: str) -> bool:
        """Return whether a client gave a session's token. A wrong one takes time; too many of them are refused."""
        if hmac.compare_digest(token.encode(), given.token.encode()):
            return True
        if not await self._throttle.delay(f"{address} {given.session}", self._loop.time()):
            raise ProtocolError(TOO_MANY_WRONG, 1008)
        return False

    async def _resume(self, hello: Hello, resume: Resume, address: str) -> SessionSlot | None:
        """Return the session that a client had, here or in another process; None if it has expired."""
        found = await asyncio.gather(*(store.take(resume) for store in self._stores))
        stored = max((one for one in found if one is not None), key=lambda one: one[0], default=None)
        slot = self._slots.get(resume.session)
        if stored is not None and (slot is None or stored[0] > slot.generation + 1):  # another process owned it later
            if slot is not None:
                self._close(slot, _ELSEWHERE)
            return self._restore(hello, resume, *stored)
        if slot is None or slot.source is not None or not await self._is_token(slot.token, resume, address):
            return None
        for queue in [one for one in slot.queues if not one.is_watcher]:  # a broken connection that is not detected yet
            queue.close(_ELSEWHERE)
            slot.queues.remove(queue)
        slot.generation = max(slot.generation, 0 if stored is None else stored[0])
        slot.session.set_points(hello.points)
        return slot

    def _restore(self, hello: Hello, resume: Resume, generation: int, stored: StoredSession) -> SessionSlot:
        """Return a slot with a session of another process."""
        self._make_room()
        session = Session(hello.points, stored.person, stored.settings, stored.placement)
        slot = SessionSlot(
            resume.session, stored.token, stored.watch_token, stored.name, session, generation=generation
        )
        self._slots[slot.session_id] = slot
        self.metrics.sessions.set(len(self._slots))
        return slot

    async def _store_sessions(self) -> None:
        """Store sessions for other processes, and close those that another process has resumed."""
        # A disconnected session is stored once more, because its client may have left before it was stored.
        to_store = {
            one.session_id: one
            for one in self._slots.values()
            if (one.is_driven or one.session_id in self._just_disconnected) and one.source is None
        }
        self._just_disconnected.clear()
        if not self._stores or not to_store:
            return
        states = {session_id: (slot.generation, slot.store_text()) for session_id, slot in to_store.items()}
        for lost in await asyncio.gather(*(store.put(states) for store in self._stores)):
            if lost is None:
                self.metrics.store_failures.inc()
            for session_id in lost or ():
                if self._slots.get(session_id) is to_store[session_id]:
                    self._close(to_store[session_id], _ELSEWHERE)

    def _add_slot(self, name: str, session: Session, source: Source | None) -> SessionSlot:
        token, watch_token = secrets.token_urlsafe(16), secrets.token_urlsafe(16)
        slot = SessionSlot(secrets.token_hex(8), token, watch_token, name, session, source)
        self._slots[slot.session_id] = slot
        self.metrics.sessions.set(len(self._slots))
        return slot

    def _add_replay(self, playable: Playable, name: str, settings: Settings) -> SessionSlot:
        slot = self._add_slot(name, Session(playable.observation.points, playable.person, settings), "replay")

        def play(frame: SignalFrame, is_new_motion: bool) -> None:
            if is_new_motion:
                slot.session.reset_clock()
            self.receive(slot, frame)

        slot.player = Player(playable, play)
        slot.player_task = self._loop.create_task(self._play(slot, slot.player))
        return slot

    async def _play(self, slot: SessionSlot, player: Player) -> None:
        """Play until cancelled. If that fails, close the session."""
        try:
            await player.run()
        except Exception:  # other sessions continue
            traceback.print_exc()
            self._close(slot, "the server failed to play this replay; connect again")

    def _send_messages(self, slot: SessionSlot) -> None:
        """Send a session's new messages to its clients."""
        messages: list[ServerMessage] = slot.session.take_messages()
        if messages or slot.sent_revision != slot.session.revision:
            self._changed.set()
        if slot.sent_revision != slot.session.revision:
            slot.sent_revision = slot.session.revision
            for queue in slot.queues:
                queue.put_message(slot.welcome(self.sources, self._recordings.are_allowed, is_watcher=queue.is_watcher))
        for message in messages:
            slot.send(message)
            if slot in self._inputs.values() and isinstance(message, Notice) and message.text in slot.session.doubts:
                print(f"{slot.source}: {message.text}", flush=True)  # senders of packets read no messages

    def _deliver(self, slot: SessionSlot, answer: Answer | None) -> None:
        if slot in self._inputs.values():
            self._wearers.save_calibrated(slot)
        self._send_messages(slot)
        if answer is None:
            self.metrics.dropped("failed")
            self._report_failing(slot)
            return
        slot.failing_since = None
        spent = monotonic() - answer.received  # not the loop's clock, which may count in milliseconds
        frames = [write_pose(answer.frame, min(int(spent * 1e6), 2**32 - 1))]
        watched = frames
        if slot.source is not None or any(queue.is_watcher for queue in slot.queues):
            watched = [write_signal(answer.signal), *self._truth(slot, answer), *frames]
        for queue in slot.queues:
            if queue.put_frames(watched if slot.source is not None or queue.is_watcher else frames):
                self.metrics.dropped("slow client")
        self.metrics.latency.observe(spent)
        self._recordings.add(slot, answer)
        is_input = slot in self._inputs.values()
        if self._send_body is not None and self._output_selector.selects(slot, answer, is_input, self._loop.time()):
            self._send_to_avatars(answer)

    def _report_failing(self, slot: SessionSlot) -> None:
        """Send a message to a wearer whose frames all fail, every `_FAILING` seconds."""
        now = monotonic()
        if slot.failing_since is None:
            slot.failing_since = now
        elif now - slot.failing_since >= _FAILING:
            slot.failing_since = now
            slot.send(Notice("your body could not be completed in the last second; the server's log has the reason"))

    def _report_waiting(self, seconds: float) -> None:
        """Send a message to the wearers whose frames wait."""
        for slot in self._scheduler.waiting:
            slot.send(
                Notice(f"the server has answered no frame for {seconds:.0f} s; it ends after {HOPELESS_AFTER:g} s")
            )

    def _send_to_avatars(self, answer: Answer) -> None:
        """Send a body to avatars. If that fails, the session continues."""
        assert self._send_body is not None
        try:
            self._send_body(answer)
        except Exception:  # of one protocol
            self.metrics.dropped("output")
            if not self._output_failed:
                traceback.print_exc()
            self._output_failed = True

    def _refuse(self, slot: SessionSlot, error: ProtocolError) -> None:
        """Close the connection of a client whose frame is invalid, or whose answer cannot be delivered."""
        for queue in slot.queues:
            if not queue.is_watcher:
                self.metrics.closed(error.code)
                queue.close(str(error), error.code)

    def _truth(self, slot: SessionSlot, answer: Answer) -> list[bytes]:
        truth = None if slot.player is None else slot.player.playable.truth
        if truth is None:
            return []
        index = answer.signal.sequence
        root, rotation = slot.session.truth(truth.root_position[index], truth.rotation[index])
        return [write_truth(replace(answer.frame, sequence=index, root_position=root, rotation=rotation))]

    def _close(self, slot: SessionSlot, reason: str = "the session that was watched is over") -> None:
        self._recordings.stop(slot)
        if slot.player_task is not None:
            slot.player_task.cancel()
        for queue in slot.queues:
            queue.close(reason)
        del self._slots[slot.session_id]
        self.metrics.sessions.set(len(self._slots))

    async def _sweep(self) -> None:
        """Store sessions; close those that were not resumed in time, and replays without a watcher."""
        while True:
            await asyncio.sleep(_STORE_INTERVAL)
            with suppress(TimeoutError):  # `wait_for` of Python 3.11 may lose a cancellation
                async with asyncio.timeout(_SWEEP_INTERVAL - _STORE_INTERVAL):
                    await self._changed.wait()
            self._changed.clear()
            await self._store_sessions()
            now = self._loop.time()
            for slot in list(self._slots.values()):
                keep = 0.0 if slot.source is not None else self.limits.seconds_to_resume
                if (
                    slot.disconnected_at is not None
                    and now - slot.disconnected_at > keep
                    and slot not in self._inputs.values()
                ):
                    self._close(slot)
