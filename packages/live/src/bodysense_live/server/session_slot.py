"""A slot of the server: one session with its connections and player.

`OutputSelector` selects the body that goes to avatars and runtimes. `WearerFile` writes the calibrated wearer of the
server's own inputs.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense_live.server.messages import Notice, ServerMessage, Source, Welcome
from bodysense_live.server.send_queue import SendQueue
from bodysense_live.server.session_store import StoredSession
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.replay import Player
from bodysense_live.sessions.session import Session, rounded
from bodysense_live.sessions.worn_trackers import save_wearer


@dataclass(eq=False)
class SessionSlot:
    """A session and its connections."""

    session_id: str
    token: str  # resumes the session
    watch_token: str  # watches the session
    name: str
    session: Session
    source: Source | None = None  # the server's own input that drives the session; None: a client
    queues: list[SendQueue] = field(default_factory=list)
    disconnected_at: float | None = None  # s, of the loop's clock; None: connected
    failing_since: float | None = None  # s, of `monotonic`: the first failed frame since the last answer or message
    player: Player | None = None
    player_task: asyncio.Task[None] | None = None
    sent_revision: int = 0  # revision of the session that was last sent to clients
    generation: int = 1  # number of processes that have owned the session
    serials: Callable[[], Mapping[str, str]] = dict  # serial → point of unassigned trackers of the server's own input
    known_serials: Mapping[str, str] = field(default_factory=dict)  # `serials()` when joints were last assigned
    _store_text: str = field(default="", init=False, repr=False)
    _stored_values: object = field(default=None, init=False, repr=False)  # the values in `_store_text`, for comparison

    def store_text(self) -> str:
        """Return the session as text, from which another process resumes it."""
        session = self.session
        now = session.revision, session.placement_message(), round(session.height, 2), dict(session.tracker_joints)
        if now != self._stored_values:
            state = session.resumable_state()
            stored = StoredSession(self.token, self.watch_token, self.name, session.settings, *state)
            self._store_text, self._stored_values = stored.to_json(), now
        return self._store_text

    def send(self, message: ServerMessage) -> None:
        """Send a message to all clients."""
        for queue in self.queues:
            queue.put_message(message)

    @property
    def is_driven(self) -> bool:
        """Whether a client is connected that is not only a watcher."""
        return any(not queue.is_watcher for queue in self.queues)

    def welcome(
        self, sources: tuple[Source, ...], recording: bool, resumed: bool = False, is_watcher: bool = False
    ) -> Welcome:
        """Return the welcome for a client. `sources` can be watched; `recording`: recordings are allowed."""
        session, skeleton = self.session, self.session.skeleton
        secret = self.source is not None or is_watcher
        return Welcome(
            session=self.session_id,
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


_SILENCE = 1.0  # s without a body, after which another session is selected


class OutputSelector:
    """The selection of the session whose body goes to avatars.

    The first session with a tracked body is selected until it is silent. The server's own inputs take precedence over
    clients. A page that watches a replay is never selected.
    """

    def __init__(self) -> None:
        self._slot: SessionSlot | None = None
        self._is_input = False
        self._last_output = 0.0  # s

    def selects(self, slot: SessionSlot, answer: Answer, is_input: bool, now: float) -> bool:
        """Return whether an answer goes to avatars. `is_input`: it is from one of the server's own inputs."""
        if not answer.is_tracked or (slot.source is not None and not is_input):
            return False
        if self._slot is not slot and self._slot is not None:
            is_silent, is_outranked = now - self._last_output > _SILENCE, is_input and not self._is_input
            if not is_silent and not is_outranked:
                return False
        self._slot, self._is_input, self._last_output = slot, is_input, now
        return True


class WearerFile:
    """The file of the wearer of the server's own inputs. No file is written if `path` is None.

    `trackers`: joints of unassigned trackers by serial, as the file has them at the start.
    """

    def __init__(self, path: Path | None, trackers: Mapping[str, str]) -> None:
        self._path, self._trackers = path, dict(trackers)

    def assign_known_trackers(self, slot: SessionSlot) -> None:
        """Assign joints to trackers whose serials the file has and that arrived since the last call."""
        serials = slot.serials()
        if serials is slot.known_serials:
            return
        slot.known_serials = serials
        slot.session.assign_trackers(
            {name: self._trackers[serial] for serial, name in serials.items() if serial in self._trackers}
        )

    def save_calibrated(self, slot: SessionSlot) -> None:
        """Write the wearer of a session if a calibration has finished since the last call."""
        wearer, slot.session.calibrated = slot.session.calibrated, None
        if wearer is None:
            return
        joints = slot.session.tracker_joints
        assigned = {serial: joints[name] for serial, name in slot.serials().items() if name in joints}
        others = {serial: joint for serial, joint in self._trackers.items() if joint not in assigned.values()}
        self._trackers = {**others, **assigned}
        if self._path is None:
            return
        try:
            save_wearer(wearer, self._trackers, self._path)
        except (OSError, BodysenseError) as error:
            slot.send(Notice(f"your file cannot be written: {error}"))
