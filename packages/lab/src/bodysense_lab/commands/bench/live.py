"""`bodysense bench live`: sessions that a server sustains, measured with a real server and clients on loopback."""

from __future__ import annotations

import secrets
import selectors
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Annotated
from urllib.parse import urlsplit

import numpy as np
import psutil

from bodysense.errors import BodysenseError
from bodysense.ranges import Processes, Sessions, within
from bodysense_lab.core.options import Json, Rate, Seconds

_POINTS = ("head", "left_wrist", "right_wrist")
_MOTION_FRAMES = 240  # frames of motion that clients repeat
_WARM_UP = 2.0  # s before frames are counted
_SERVED_SHARE = 0.99  # share of answered frames at which a session counts as served
_SESSION_STEP, _MAX_SESSIONS = 4, 400  # sessions added at a time; largest number of sessions
_THROTTLE_PERIOD = 0.005  # s, shorter than a frame; a throttled server runs and pauses once in it
_UNMASKED = b"\0\0\0\0"  # a masking key that changes nothing (RFC 6455, section 5.3), so that frames are prebuilt


def bench_live(
    sessions: Sessions = 40,
    rate: Rate = 72.0,
    seconds: Seconds = 20.0,
    workers: Processes = 1,
    most: bool = False,
    share: Annotated[float, within(float, 0.01, 1)] = 1.0,
    json: Json = None,
) -> None:
    """Time live sessions of head and hands, with one or several server processes and their clients on this machine.

    p50 and p99 are from a frame's arrival in the server to its pose. Clients send each frame when it is due, with
    different phases, without waiting for answers. They also use a share of a core.

    Args:
        sessions: number of clients.
        rate: frames per second of each client.
        seconds: time in which answers are counted.
        workers: processes of the server.
        most: also measure the number of wearers of one process with 99 % of their frames answered, as most_sessions.
        share: share of the time in which the server may run, as on a slower machine.
    """
    from bodysense_lab.commands.bench.timing import report

    with _server(sessions, workers) as (address, process), _throttled(process, share):
        load = Load(address, rate)
        load.connect(1)
        load.run(_WARM_UP)
        first = _memory(process)
        load.connect(sessions - 1)
        load.run(_WARM_UP)
        load.reset_counts()
        before, begun = _processor_time(process), time.monotonic()
        load.run(seconds)
        spent, lasted = _processor_time(process) - before, time.monotonic() - begun
        rss = _memory(process)
        numbers = load.numbers() | {
            "sessions": sessions,
            "rate_hz": rate,
            "workers": workers,
            "share": share,
            "rss_mb": rss,
            "rss_per_session_mb": (rss - first) / max(sessions - 1, 1),
            "server_cores": spent / lasted,
            "lost_signal_ms": load.hand_loss_delay(),
        }
        load.close()
    if most:
        numbers["most_sessions"] = _max_sessions(rate, seconds, share)
    report("live", numbers, json)


def _max_sessions(rate: float, seconds: float, share: float) -> int:
    """Return the largest number of sessions, in steps, of which one process answers `_SERVED_SHARE` of the frames."""
    with _server(_MAX_SESSIONS, 1) as (address, process), _throttled(process, share):
        load, served = Load(address, rate), 0
        while served < _MAX_SESSIONS:
            load.connect(_SESSION_STEP)
            load.run(_WARM_UP)
            load.reset_counts()
            load.run(seconds)
            if load.numbers()["answered"] < _SERVED_SHARE:
                break
            served += _SESSION_STEP
        load.close()
    return served


@dataclass(eq=False)
class _LoadClient:
    """A client connection and its unread data."""

    socket: socket.socket
    due: float  # s, time of its next frame
    sequence: int = 0
    unread: bytearray = field(default_factory=bytearray)
    sent: dict[int, float] = field(default_factory=dict)  # s, time of unanswered frames, by sequence number
    sent_count: int = 0  # frames since `Load.reset_counts`
    answered: int = 0


class Load:
    """Clients of one server, all in one thread."""

    def __init__(self, address: str, rate: float) -> None:
        from bodysense.body.pose import forward_kinematics
        from bodysense.body.skeleton import default_skeleton
        from bodysense.demo import packaged_performance
        from bodysense.io.formats.protocol import SignalFrame, write_signal

        self._address, self._rate = urlsplit(address), rate
        skeleton = default_skeleton()
        self._points, self._wrists = len(skeleton.points), skeleton.indices(_POINTS[1:])
        self._clients: list[_LoadClient] = []
        self._selector = selectors.DefaultSelector()
        clip = packaged_performance()
        places = clip.pose.skeleton.indices(_POINTS)
        position, rotation = (np.asarray(values)[:, places] for values in forward_kinematics(clip.pose))
        every, has = np.arange(3, dtype=np.uint8), np.full(3, 3, dtype=np.uint8)
        # Forward and backward, so that the motion has no jump when it repeats.
        order = [*range(_MOTION_FRAMES), *range(_MOTION_FRAMES, 0, -1)]
        self._signals = [write_signal(SignalFrame(0, 0.0, every, has, position[t], rotation[t]))[16:] for t in order]
        self.reset_counts()

    def reset_counts(self) -> None:
        """Discard all counts."""
        self._spent: list[int] = []  # µs in the server
        self._round_trips: list[float] = []  # s
        for one in self._clients:
            one.sent_count = one.answered = 0
        self.has_hands = True  # whether the last pose of the first client has measured wrists

    def connect(self, count: int) -> None:
        """Open more connections and start their sessions."""
        from bodysense_live.server.message_text import write_message
        from bodysense_live.server.messages import Hello

        hello = write_message(Hello(1, points=_POINTS)).encode()
        for _ in range(count):
            client = socket.create_connection((self._address.hostname or "", self._address.port or 0), timeout=10)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client.sendall(_handshake(self._address.netloc))
            answer = b""
            while b"\r\n\r\n" not in answer:
                part = client.recv(4096)
                if not part:
                    raise BodysenseError(f"the server at {self._address.geturl()} closed the connection")
                answer += part
            if not answer.startswith(b"HTTP/1.1 101"):
                raise BodysenseError(f"the server refused a session: {answer.splitlines()[0].decode()}")
            client.sendall(_framed(1, hello))
            client.setblocking(False)
            # The golden ratio spreads the phases of any number of clients over the interval.
            phase = (len(self._clients) * 0.618034) % 1.0
            one = _LoadClient(client, time.monotonic() + phase / self._rate)
            one.unread += answer.partition(b"\r\n\r\n")[2]
            self._selector.register(client, selectors.EVENT_READ, one)
            self._clients.append(one)

    def run(self, seconds: float, points: int = 3) -> None:
        """Send frames of `points` points when due, and read the answers, for a time in s."""
        end = time.monotonic() + seconds
        for one in self._clients:
            one.due = max(one.due, time.monotonic())
        while (now := time.monotonic()) < end:
            for one in self._clients:
                if one.due <= now:
                    self._send(one, now, points)
            wait = min(one.due for one in self._clients) - time.monotonic()
            for key, _ in self._selector.select(min(max(wait, 0.0), 0.01)):
                self._read(key.data)

    def hand_loss_delay(self) -> float:
        """Return the time from a frame without hands to a pose without measured hands, for the first client, ms."""
        begun = time.monotonic()
        while time.monotonic() - begun < 5 and self.has_hands:
            self.run(1 / self._rate, points=1)
        return 1000 * (time.monotonic() - begun)

    def numbers(self) -> dict[str, float]:
        """Return the figures of all answers since `reset_counts`."""
        if not self._spent:
            raise BodysenseError("the server answered no frame in time; give fewer --sessions or more --seconds")
        spent, trips = np.array(self._spent) / 1000, np.array(self._round_trips) * 1000
        shares = [one.answered / max(one.sent_count, 1) for one in self._clients]
        answered = len(spent) / max(sum(one.sent_count for one in self._clients), 1)
        return {
            "p50_ms": float(np.percentile(spent, 50)),
            "p99_ms": float(np.percentile(spent, 99)),
            "round_trip_p50_ms": float(np.percentile(trips, 50)),
            "round_trip_p99_ms": float(np.percentile(trips, 99)),
            "answered": answered,
            "answered_least": min(shares),  # of one wearer
            "answered_most": max(shares),
            "answers_hz": answered * self._rate,
        }

    def close(self) -> None:
        """Close all connections."""
        for one in self._clients:
            one.socket.close()
        self._selector.close()

    def _send(self, one: _LoadClient, now: float, points: int) -> None:
        from bodysense.io.formats.protocol import POINT, SIGNAL, SIGNAL_HEAD

        one.sequence += 1
        signal = self._signals[one.sequence % len(self._signals)][: points * POINT.itemsize]
        frame = SIGNAL_HEAD.pack(SIGNAL, 0, points, one.sequence, one.due) + signal
        one.due += 1 / self._rate
        if one.due < now - 0.1:  # this process was delayed: skip missed frames
            one.due = now
        try:
            one.socket.send(_framed(2, frame))
        except BlockingIOError:
            return
        one.sent[one.sequence] = now
        one.sent_count += 1

    def _read(self, one: _LoadClient) -> None:
        from bodysense.io.formats.protocol import POSE, POSE_HEAD, read_pose

        try:
            received = one.socket.recv(1 << 16)
        except BlockingIOError:
            return
        if not received:
            raise BodysenseError("the server closed a session; see its output above")
        one.unread += received
        now = time.monotonic()
        for opcode, payload in _messages(one.unread):
            if opcode == 8:
                raise BodysenseError(f"the server closed a session: {payload[2:].decode(errors='replace')}")
            if opcode == 9:  # a ping; the server closes connections that do not answer
                one.socket.send(_framed(10, payload))
            if opcode != 2 or payload[0] != POSE:
                continue
            *_, sequence, _ = POSE_HEAD.unpack_from(payload)
            sent = one.sent.pop(sequence, None)
            if one is self._clients[0]:
                self.has_hands = bool((read_pose(payload, self._points).hidden[self._wrists] < 0.5).any())
            if sent is not None:
                one.answered += 1
                self._spent.append(int.from_bytes(payload[-4:], "little"))
                self._round_trips.append(now - sent)


def _handshake(host: str) -> bytes:
    import base64

    from bodysense.io.formats.protocol import SUBPROTOCOL

    key = base64.b64encode(secrets.token_bytes(16)).decode()
    lines = (
        *("GET /ws HTTP/1.1", f"Host: {host}", "Upgrade: websocket", "Connection: Upgrade"),
        *(f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Protocol: {SUBPROTOCOL}"),
    )
    return ("\r\n".join(lines) + "\r\n\r\n").encode()


def _framed(opcode: int, payload: bytes) -> bytes:
    """A whole WebSocket message of a client, below 64 KiB."""
    if len(payload) < 126:
        return bytes((0x80 | opcode, 0x80 | len(payload))) + _UNMASKED + payload
    return bytes((0x80 | opcode, 0x80 | 126)) + len(payload).to_bytes(2, "big") + _UNMASKED + payload


def _messages(unread: bytearray) -> Iterator[tuple[int, bytes]]:
    """Opcode and payload of the server's messages that are complete; takes them away."""
    while len(unread) >= 2:
        length, start = unread[1] & 127, 2
        if length >= 126:
            start = 4 if length == 126 else 10
            if len(unread) < start:
                return
            length = int.from_bytes(unread[2:start], "big")
        if len(unread) < start + length:
            return
        message = unread[0] & 15, bytes(unread[start : start + length])
        del unread[: start + length]
        yield message


@contextmanager
def _server(sessions: int, workers: int) -> Iterator[tuple[str, int]]:
    """Run a server that computes with one thread; yields its address and process id."""
    from bodysense_lab.serving.server import running_server

    options = ("--sessions", str(max(sessions, 2)), "--workers", str(workers))
    with running_server(*options, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1") as (address, process):
        yield address, process.pid


@contextmanager
def _throttled(process: int, share: float) -> Iterator[None]:
    """Let a process and its children run for only a share of the time."""
    is_over = threading.Event()

    def slow() -> None:
        family = _process_tree(process)
        while not is_over.wait(share * _THROTTLE_PERIOD):
            for one in family:
                one.suspend()
            time.sleep((1 - share) * _THROTTLE_PERIOD)
            for one in family:
                one.resume()

    thread = threading.Thread(target=slow)
    if share < 1:
        thread.start()
    try:
        yield
    finally:
        is_over.set()
        if share < 1:
            thread.join()


def _process_tree(process: int) -> list[psutil.Process]:
    """Return a process and its children."""
    return [psutil.Process(process), *psutil.Process(process).children()]


def _memory(process: int) -> float:
    """Return the memory of a process and its children, MB."""
    return sum(one.memory_info().rss for one in _process_tree(process)) / 1e6


def _processor_time(process: int) -> float:
    """Return the processor time of a process and its children, s."""
    times = [one.cpu_times() for one in _process_tree(process)]
    return sum(one.user + one.system for one in times)
