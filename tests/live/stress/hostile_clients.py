"""Hostile clients without a network: random and corrupted messages for the code behind the WebSocket.

A frame is one message of a client. Messages are valid, corrupted (bytes changed, cut or doubled) or random. A client
sends messages until it is refused; then another one connects. No exception except `ProtocolError` may be raised, the
session of a monitor must still be answered, and its body must be finite.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.io.formats.protocol import POSE, SignalFrame, read_pose, write_signal
from bodysense_live.security.safety import Limits
from bodysense_live.server.connection import serve_client
from bodysense_live.server.live import Live
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Hello, UpdateSettings
from bodysense_live.server.metrics import Metrics
from bodysense_live.server.settings import ServerSettings
from bodysense_live.server.supervisor import Supervisor

_POINTS = ("headset", "left_controller", "right_controller", "left:wrist", "left:index-finger-tip", "hip")
_MONITOR_INTERVAL = 1000  # messages between two checks of the monitor
_LIMITS = Limits(messages_a_second=1e9, sessions=8, seconds_to_resume=0.1)
# Pieces of random texts.
_TEXT_PIECES = (
    *('{"type":"hello","version":1', ',"points":["head"]', ',"settings":{"height":1.7}', "}", "[", "]", "{", '"', ","),
    *('{"type":"settings","mirror":true}', '{"type":"ping","time":1}', '{"type":"recentre"}', '{"type":"calibrate"}'),
    *(
        '{"type":"record","on":true}',
        '{"type":"replay","time":0}',
        "NaN",
        "1e999",
        "null",
        "-0",
        "\\ud800",
        "é",
        "\x00",
    ),
    *(':"', '"resume":{"session":"x","token":"é"}', '{"type":"settings","regions":[]}', '"hidden":["head"]'),
)


@dataclass
class FuzzCounts:
    """Counts of messages by outcome."""

    frames: int = 0
    connections: int = 0
    refused: int = 0  # connections that the server closed
    answered: int = 0  # poses sent to clients
    watched: int = 0  # checks of the monitor that were answered
    errors: list[str] = field(default_factory=list)  # failures of the server


class FakeSocket:
    """Both ends of a connection: the server reads messages from `put`, and writes here."""

    def __init__(self) -> None:
        self.incoming: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self.client = None  # the address, which this transport lacks
        self.poses = 0
        self.last: bytes = b""
        self.code: int | None = None
        self.pose_sent = asyncio.Event()

    async def receive(self) -> dict[str, Any]:
        """Return the next message of the client."""
        return await self.incoming.get()

    async def send_text(self, text: str) -> None:
        """Check that a text for the client is JSON."""
        json.loads(text)

    async def send_bytes(self, data: bytes) -> None:
        """Count a pose for the client."""
        if data[0] == POSE:
            self.poses += 1
            self.last = data
            self.pose_sent.set()

    async def close(self, code: int, reason: str) -> None:
        """Store the code with which the server closes the connection."""
        assert len(reason.encode()) <= 123 and (code == 1009 or 1000 <= code <= 1015)
        self.code = code

    def put(self, message: str | bytes) -> None:
        """Send a message as the client."""
        kind = "text" if isinstance(message, str) else "bytes"
        self.incoming.put_nowait({"type": "websocket.receive", kind: message})

    def leave(self) -> None:
        """Disconnect without a message."""
        self.incoming.put_nowait({"type": "websocket.disconnect", "code": 1006})


async def fuzz(frames: int, rng: np.random.Generator, counts: FuzzCounts) -> None:
    """Send `frames` messages and update `counts`."""
    live = Live(ServerSettings(limits=_LIMITS), Metrics(), Supervisor(lambda failure: None))
    live.start()
    monitor = FakeSocket()
    monitor_task = asyncio.create_task(serve_client(monitor, live))  # type: ignore[arg-type]
    monitor.put(write_message(Hello(1, _POINTS[:3])))
    moment, looked = 0.0, 0
    try:
        while counts.frames < frames:
            await _client(live, rng, frames, counts)
            if counts.frames - looked >= _MONITOR_INTERVAL:
                looked, moment = counts.frames, moment + 1 / 72
                await _check_monitor(monitor, moment, counts)
            if monitor_task.done():
                counts.errors.append("the watchman's session ended")
                return
        await _check_monitor(monitor, moment + 1 / 72, counts)
    finally:
        monitor.leave()
        await asyncio.gather(monitor_task, return_exceptions=True)
        await live.stop()


async def _check_monitor(monitor: FakeSocket, moment: float, counts: FuzzCounts) -> None:
    """Check that an ordinary frame of another client is answered with a body of finite numbers."""
    monitor.pose_sent.clear()
    monitor.put(write_signal(_standing_signal(0, moment)))
    try:
        await asyncio.wait_for(monitor.pose_sent.wait(), 30)
    except TimeoutError:
        counts.errors.append(f"no answer to another client after {counts.frames} messages")
        return
    pose = read_pose(monitor.last, 65)
    if not (np.isfinite(pose.rotation).all() and np.isfinite(pose.root_position).all()):
        counts.errors.append(f"a body with NaN after {counts.frames} messages")
    counts.watched += 1


async def _client(live: Live, rng: np.random.Generator, frames: int, counts: FuzzCounts) -> None:
    """Run one client: mostly a valid hello, then messages until it is refused or leaves."""
    socket = FakeSocket()
    conversation = asyncio.create_task(serve_client(socket, live))  # type: ignore[arg-type]
    counts.connections += 1
    socket.put(write_message(Hello(1, _POINTS, name="fuzz")) if rng.random() < 0.98 else message_of(rng, 0))
    counts.frames += 1
    for k in range(int(rng.integers(1, 400))):
        socket.put(message_of(rng, k))
        counts.frames += 1
        if k % 16 == 0:  # sometimes wait for an answer
            socket.pose_sent.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(socket.pose_sent.wait(), 0.05 if rng.random() < 0.5 else 0.0001)
        if conversation.done() or counts.frames >= frames:
            break
    socket.leave()
    done = await asyncio.gather(conversation, return_exceptions=True)
    if isinstance(done[0], BaseException):
        counts.errors.append(f"{type(done[0]).__name__}: {done[0]}")
    counts.refused += socket.code is not None
    counts.answered += socket.poses


def message_of(rng: np.random.Generator, k: int) -> str | bytes:
    """Return the k-th message of a client, mostly a valid one, so that later stages are also tested."""
    choice = rng.random()
    if choice < 0.975:
        return write_signal(_random_signal(rng, k))
    if choice < 0.98:
        values = {
            "mirror": bool(rng.random() < 0.5),
            "smoothing": float(rng.choice([0, 0.1, 0.5])),
            "height": float(rng.uniform(1, 2.3)) if rng.random() < 0.5 else None,
            "floor": float(rng.uniform(-10, 10)),
            "hold_feet": bool(rng.random() < 0.5),
        }
        return write_message(UpdateSettings(values))
    if choice < 0.985:
        return str(rng.choice(['{"type":"recentre"}', '{"type":"calibrate"}', '{"type":"record","on":true}']))
    if choice < 0.99:
        return corrupted(write_signal(_random_signal(rng, k)), rng)
    if choice < 0.993:
        return rng.bytes(int(rng.integers(0, 300)))
    if choice < 0.996:
        text = (
            write_message(Hello(1, _POINTS)) if rng.random() < 0.5 else write_message(UpdateSettings({"height": 1.8}))
        )
        return corrupted(text.encode(), rng).decode(errors="replace")
    return "".join(rng.choice(_TEXT_PIECES, int(rng.integers(1, 12))))


def corrupted(data: bytes, rng: np.random.Generator) -> bytes:
    """Return the data with some bytes changed, and sometimes cut or doubled."""
    found = bytearray(data)
    count = int(rng.integers(1, 8))
    places, kinds = rng.integers(0, len(found), count).tolist(), rng.integers(0, 5, count).tolist()
    for place, kind, byte in zip(places, kinds, rng.bytes(count), strict=True):
        found[place] = (0, 0x7F, 0x80, 0xFF, byte)[kind]
    if rng.random() < 0.2:
        found = found[: int(rng.integers(len(found)))]
    return bytes(found * 2 if rng.random() < 0.05 else found)


def _standing_signal(sequence: int, time: float) -> SignalFrame:
    places = np.array([[0, 1.6, 0], [-0.25, 1.1, -0.3], [0.25, 1.1, -0.3]], dtype=np.float32)
    turned = np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (3, 1))
    return SignalFrame(sequence, time, np.arange(3), np.full(3, 3), places, turned)


def _random_signal(rng: np.random.Generator, k: int) -> SignalFrame:
    """Return a well-formed frame, possibly with impossible positions, times or points."""
    count = int(rng.integers(0, len(_POINTS) + 1))
    wild = rng.random() < 0.1
    rotation = rng.normal(size=(count, 4)) if wild else np.tile([1.0, 0, 0, 0], (count, 1))
    places = rng.uniform(-999, 999, (count, 3)) if wild else rng.normal([0, 1.2, 0], 0.5, (count, 3))
    time = float(rng.choice([rng.uniform(-1e8, 1e8), 0.0, k / 72])) if rng.random() < 0.05 else k / 72
    return SignalFrame(
        int(rng.integers(2**32)),
        time,
        rng.permutation(len(_POINTS))[:count],
        rng.integers(0, 4, count),
        places,
        rotation / np.linalg.norm(rotation, axis=1, keepdims=True),
    )


def run_fuzz(frames: int, seed: int, counts: FuzzCounts) -> None:
    """Run `fuzz` in its own event loop. Raises BodysenseError for failures of the server."""
    asyncio.run(fuzz(frames, np.random.default_rng(seed), counts))
    if counts.errors:
        raise BodysenseError(f"the server failed {len(counts.errors)} times, first: {counts.errors[0]}")
