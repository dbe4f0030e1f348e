"""The link to a server of markers: connects, learns the layout of the markers, and drives a session with the person.

It connects again after a loss, says what it receives, and can record the markers.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal
from urllib.parse import urlsplit

from bodysense.body.hands.hand import Side
from bodysense.errors import BodysenseError
from bodysense.io.markers.raw_markers import MarkerFormat
from bodysense.io.markers.stream import learn_layout
from bodysense_live.protocols.links import host_address, signal_of
from bodysense_live.protocols.markers import natnet, qtm, vicon
from bodysense_live.protocols.markers.live_markers import LiveMarkers
from bodysense_live.protocols.markers.marker_log import MarkerLog
from bodysense_live.protocols.markers.natnet_client import NatnetClient
from bodysense_live.protocols.markers.stream_frame import Conversation, MarkerServerError, StreamFrame, raw_of
from bodysense_live.server.live import Live
from bodysense_live.server.messages import Notice
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.answer import Answer

MarkerProtocol = Literal["natnet", "qtm", "vicon"]
PORTS: dict[MarkerProtocol, int] = {"natnet": natnet.PORT, "qtm": qtm.PORT, "vicon": vicon.PORT}
_PROGRAMS = {"natnet": "Motive", "qtm": "QTM", "vicon": "Nexus, Tracker or Shogun"}
RETRY = 0.5  # s between attempts to connect
SILENCE = 3.0  # s without a byte, after which the connection is made anew
_WAIT = 0.002  # s until the session is asked again whether it takes a frame
_CHUNK = 1 << 20  # bytes that are read at once: all frames that wait, of which the newest is used


@dataclass(frozen=True)
class MarkerServer:
    """The server of markers, and facts about its markers that it omits."""

    protocol: MarkerProtocol
    host: str
    port: int
    form: MarkerFormat = MarkerFormat()
    unlabelled: tuple[Side, ...] = ()  # gloves to find among points without a name
    record: Path | None = None  # a CSV file

    @property
    def name(self) -> str:
        """The address, as in `--markers`."""
        return f"{self.protocol}://{self.host}:{self.port}"


def parsed_address(text: str) -> tuple[MarkerProtocol, str, int]:
    """Return protocol, host and port of an address such as 'qtm://192.168.1.5'. Raises BodysenseError for others."""
    try:
        parts = urlsplit(text)
        port, host = parts.port, parts.hostname
    except ValueError:
        port = host = parts = None
    for protocol, usual in PORTS.items():
        if parts is not None and host and parts.scheme == protocol and not parts.path.strip("/") and port != 0:
            return protocol, host, port or usual
    raise BodysenseError(
        f"--markers {text}: give natnet://HOST (OptiTrack), qtm://HOST (Qualisys) or vicon://HOST, with :PORT if it is "
        "not the usual one"
    )


class MarkerLink:
    """A client of a server of markers (`links.Link`). Raises BodysenseError for unknown hosts."""

    def __init__(self, server: MarkerServer, metrics: Metrics) -> None:
        self._server, self._metrics = server, metrics
        self._address = host_address("--markers", server.host, _PROGRAMS[server.protocol])
        self._log = None if server.record is None else MarkerLog(server.record, bool(server.unlabelled))
        self._markers = LiveMarkers(server.form, server.unlabelled)
        self._task: asyncio.Task[None] | None = None
        self._learning: asyncio.Task[None] | None = None
        self._points: tuple[str, ...] = ()  # of the session
        self._sequence = 0
        self._newest: StreamFrame | None = None  # until the session takes a frame
        self._timer: asyncio.TimerHandle | None = None
        self._frame_at: float | None = None  # s of the loop's clock, when a frame last arrived; None: lost
        self._said = ""  # the last line that was printed

    async def open(self, live: Live) -> None:
        """Start to connect."""
        self._slot = live.add_input("markers", ())
        self._receive_frame = partial(live.receive, self._slot)
        self._task = live.supervisor.start(self._run())

    def send_body(self, answer: Answer) -> None:
        """Do nothing: the server takes no bodies."""

    def close(self) -> None:
        """Disconnect, and close the recording."""
        for task in (self._task, self._learning):
            if task is not None:
                task.cancel()
        if self._timer is not None:
            self._timer.cancel()
        if self._log is not None:
            with contextlib.suppress(OSError):
                self._log.close()

    async def _run(self) -> None:
        """Connect, and again after each loss, until cancelled."""
        converse = self._by_datagrams if self._server.protocol == "natnet" else self._by_stream
        while True:
            try:
                await converse()
            except MarkerServerError as error:
                self._metrics.dropped("malformed packet")
                self._lose(str(error))
            except (OSError, EOFError, TimeoutError) as error:
                reason = getattr(error, "strerror", None) or str(error) or "no answer"
                self._lose(f"not connected ({reason})")
            await asyncio.sleep(RETRY)

    async def _by_stream(self) -> None:
        """Converse by TCP until the connection is lost."""
        async with asyncio.timeout(SILENCE):
            reader, writer = await asyncio.open_connection(self._address, self._server.port, limit=_CHUNK)
        try:
            writer.get_extra_info("socket").setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            conversation: Conversation = _STREAMS[self._server.protocol]()
            writer.writelines(conversation.begin())
            while True:
                async with asyncio.timeout(SILENCE):
                    data = await reader.read(_CHUNK)
                if not data:
                    raise EOFError("the server closed the connection")
                received = conversation.receive(data)
                writer.writelines(received.replies)
                self._take(received.frames)
        finally:
            writer.close()

    async def _by_datagrams(self) -> None:
        """Receive from NatNet until cancelled."""
        loop = asyncio.get_running_loop()
        waiting: list[StreamFrame] = []  # of the thread; the loop takes all at once

        def take(frames: Sequence[StreamFrame]) -> None:
            waiting.extend(frames)
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(drain)

        def drain() -> None:
            frames = waiting[:]
            del waiting[: len(frames)]
            self._take(frames)

        def lose(reason: str) -> None:
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(self._lose, reason)

        client = NatnetClient(self._address, self._server.port, take, lose)
        try:
            await asyncio.Event().wait()
        finally:
            client.close()

    def _lose(self, reason: str) -> None:
        """Report that no frames arrive, and start a new motion with the next one."""
        if self._frame_at is not None:
            self._slot.session.reset_clock()
            self._frame_at = None
        self._say(f"{reason}; is {_PROGRAMS[self._server.protocol]} running, with streaming on? It is tried again")

    def _take(self, frames: Sequence[StreamFrame]) -> None:
        """Record all frames, and use the newest."""
        if not frames:
            return
        if self._frame_at is None:
            self._say(f"receives {len(frames[-1].names)} markers and bodies, {len(frames[-1].unnamed)} without a name")
        self._frame_at = asyncio.get_running_loop().time()
        self._record(frames)
        for frame in frames:
            text = self._markers.add(frame)
            if text is not None:
                self._say(text)
        for _ in frames[1:] if self._newest is None else frames:
            self._metrics.dropped("replaced")
        self._newest = frames[-1]
        if self._markers.is_due and (self._learning is None or self._learning.done()):
            self._learning = asyncio.get_running_loop().create_task(self._learn())
        self._forward()

    def _forward(self) -> None:
        """Convert the newest frame for the session, as soon as it takes one: a busy machine converts no others."""
        frame = self._newest
        if frame is None:
            return
        if self._slot.session.has_pending:
            if self._timer is None:
                self._timer = asyncio.get_running_loop().call_later(_WAIT, self._forward_later)
            return
        self._newest = None
        observation = self._markers.observe(frame)
        if observation is None:
            return
        if observation.points != self._points and not self._set_points(observation.points):
            return
        self._sequence = (self._sequence + 1) % 2**32
        self._receive_frame(signal_of(observation, self._points, self._sequence, frame.time))

    def _forward_later(self) -> None:
        self._timer = None
        self._forward()

    def _set_points(self, points: tuple[str, ...]) -> bool:
        """Give the session other points. Return whether it takes them."""
        try:
            self._slot.session.set_points(points)
        except BodysenseError as error:  # gloves of a hand that is not calibrated
            self._say(str(error))
            self._markers.drop_gloves()
            return False
        self._points = points
        self._slot.session.revision += 1
        return True

    async def _learn(self) -> None:
        """Learn the layout in a thread, so that frames do not wait."""
        frames = self._markers.window()
        try:
            layout = await asyncio.to_thread(learn_layout, raw_of(frames), self._server.form, self._server.name)
        except BodysenseError as error:
            self._markers.fail()
            self._say(str(error).removeprefix(f"{self._server.name}: "))
            return
        for text in self._markers.adopt(layout):
            self._say(text)

    def _record(self, frames: Sequence[StreamFrame]) -> None:
        if self._log is None:
            return
        try:
            for frame in frames:
                begun = self._log.write(frame)
                if begun is not None:
                    self._say(f"recording to {begun}")
        except OSError as error:
            self._say(f"the recording ends: {error.strerror or error}")
            with contextlib.suppress(OSError):
                self._log.close()
            self._log = None

    def _say(self, text: str) -> None:
        """Print a line, and send it to the pages that watch, unless it was the last one."""
        if text == self._said:
            return
        self._said = text
        print(f"{self._server.name}: {text}", flush=True)
        self._slot.send(Notice(text))


_STREAMS: dict[str, Callable[[], Conversation]] = {"qtm": qtm.QtmConversation, "vicon": vicon.ViconConversation}
