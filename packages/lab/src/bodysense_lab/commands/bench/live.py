"""`bodysense bench live`: how many sessions a server sustains, with a real server and light clients on loopback."""

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
from bodysense_lab.options import Json, Rate, Seconds

_POINTS = ("head", "left_wrist", "right_wrist")
_BEAT = 240  # frames of motion that clients repeat
_WARM_UP = 2.0  # s before anything is counted
_SERVED, _STEP, _LARGEST = 0.99, 4, 400  # share of frames that counts as served; sessions added at a time; the most
_PERIOD = 0.005  # s, less than between two frames, in which a slowed server runs and stands still once
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
    """Time live sessions of head and hands: a server process, or several, and clients of it on this machine.

    p50 and p99 are from a frame's arrival in the server to its pose. Clients send when their frame is due, each at a
    moment of its own, whether or not they were answered. They take a share of a core themselves.

    Args:
        sessions: Clients at a time.
        rate: Hz; frames of each client.
        seconds: For which answers are counted.
        workers: Processes of the server.
        most: Find also how many wearers one process serves with 99 % of their frames answered, as most_sessions.
        share: Share of the time in which the server may run, as on a slower machine.
    """
    from bodysense_lab.commands.bench.timing import report

    with _server(sessions, workers) as (address, process), _slowed(process, share):
        load = Load(address, rate)
        load.connect(1)
        load.run(_WARM_UP)
        first = _memory(process)
        load.connect(sessions - 1)
        load.run(_WARM_UP)
        load.forget()
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
            "lost_signal_ms": load.until_head_alone(),
        }
        load.close()
    if most:
        numbers["most_sessions"] = _most_sessions(rate, seconds, share)
    report("live", numbers, json)


def _most_sessions(rate: float, seconds: float, share: float) -> int:
    """The largest number of sessions of which one process answers `_SERVED` of the frames, in steps of `_STEP`."""
    with _server(_LARGEST, 1) as (address, process), _slowed(process, share):
        load, served = Load(address, rate), 0
        while served < _LARGEST:
            load.connect(_STEP)
            load.run(_WARM_UP)
            load.forget()
            load.run(seconds)
            if load.numbers()["answered"] < _SERVED:
                break
            served += _STEP
        load.close()
    return served


@dataclass(eq=False)
class _LoadClient:
    """A connection, and what was read of it."""

    socket: socket.socket
    due: float  # s: when its next frame is
    sequence: int = 0
    unread: bytearray = field(default_factory=bytearray)
    sent: dict[int, float] = field(default_factory=dict)  # s, by sequence, of frames that are not answered
    asked: int = 0  # frames that were sent since `Load.forget`
    answered: int = 0


class Load:
    """Clients of one server, in one thread."""

    def __init__(self, address: str, rate: float) -> None:
        from bodysense.body.pose import forward_kinematics
        from bodysense.body.skeleton import default_skeleton
        from bodysense.demo import packaged_performance
        from bodysense.io.protocol import SignalFrame, write_signal

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
        order = [*range(_BEAT), *range(_BEAT, 0, -1)]
        self._signals = [write_signal(SignalFrame(0, 0.0, every, has, position[t], rotation[t]))[16:] for t in order]
        self.forget()

    def forget(self) -> None:
        """Count from now on."""
        self._spent: list[int] = []  # µs in the server
        self._round_trips: list[float] = []  # s
        for one in self._clients:
            one.asked = one.answered = 0
        self.has_hands = True  # whether the last pose of the first client has measured wrists

    def connect(self, count: int) -> None:
        """Open more connections and say hello."""
        from bodysense_live.message_text import write_message
        from bodysense_live.messages import Hello

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
            # Golden ratio: however many there are, their moments are spread over the interval.
            phase = (len(self._clients) * 0.618034) % 1.0
            one = _LoadClient(client, time.monotonic() + phase / self._rate)
            one.unread += answer.partition(b"\r\n\r\n")[2]
            self._selector.register(client, selectors.EVENT_READ, one)
            self._clients.append(one)

    def run(self, seconds: float, points: int = 3) -> None:
        """Send frames of `points` points when due, and read the answers, for `seconds`."""
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

    def until_head_alone(self) -> float:
        """ms from a frame without hands to a pose that is of the head alone, as the first client sees it."""
        begun = time.monotonic()
        while time.monotonic() - begun < 5 and self.has_hands:
            self.run(1 / self._rate, points=1)
        return 1000 * (time.monotonic() - begun)

    def numbers(self) -> dict[str, float]:
        """Return the figures of all answers since `forget`."""
        if not self._spent:
            raise BodysenseError("the server answered no frame in time; give fewer --sessions or more --seconds")
        spent, trips = np.array(self._spent) / 1000, np.array(self._round_trips) * 1000
        shares = [one.answered / max(one.asked, 1) for one in self._clients]
        answered = len(spent) / max(sum(one.asked for one in self._clients), 1)
        return {
            "p50_ms": float(np.percentile(spent, 50)),
            "p99_ms": float(np.percentile(spent, 99)),
            "round_trip_p50_ms": float(np.percentile(trips, 50)),
            "round_trip_p99_ms": float(np.percentile(trips, 99)),
            "answered": answered,
            "answered_least": min(shares),  # of the wearers
            "answered_most": max(shares),
            "answers_hz": answered * self._rate,
        }

    def close(self) -> None:
        """Hang up."""
        for one in self._clients:
            one.socket.close()
        self._selector.close()

    def _send(self, one: _LoadClient, now: float, points: int) -> None:
        from bodysense.io.protocol import POINT, SIGNAL, SIGNAL_HEAD

        one.sequence += 1
        signal = self._signals[one.sequence % len(self._signals)][: points * POINT.itemsize]
        frame = SIGNAL_HEAD.pack(SIGNAL, 0, points, one.sequence, one.due) + signal
        one.due += 1 / self._rate
        if one.due < now - 0.1:  # this process was held up: what it missed is not made up for at once
            one.due = now
        try:
            one.socket.send(_framed(2, frame))
        except BlockingIOError:
            return
        one.sent[one.sequence] = now
        one.asked += 1

    def _read(self, one: _LoadClient) -> None:
        from bodysense.io.protocol import POSE, POSE_HEAD, read_pose

        try:
            received = one.socket.recv(1 << 16)
        except BlockingIOError:
            return
        if not received:
            raise BodysenseError("the server closed a session; see its own words above")
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

    from bodysense.io.protocol import SUBPROTOCOL

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
    """A server that computes with one thread: its address and process number."""
    from bodysense_lab.serving.server import running_server

    options = ("--sessions", str(max(sessions, 2)), "--workers", str(workers))
    with running_server(*options, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1") as (address, process):
        yield address, process.pid


@contextmanager
def _slowed(process: int, share: float) -> Iterator[None]:
    """Let a process and its children run for a share of the time only."""
    is_over = threading.Event()

    def slow() -> None:
        family = _family(process)
        while not is_over.wait(share * _PERIOD):
            for one in family:
                one.suspend()
            time.sleep((1 - share) * _PERIOD)
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


def _family(process: int) -> list[psutil.Process]:
    """A process and its children."""
    return [psutil.Process(process), *psutil.Process(process).children()]


def _memory(process: int) -> float:
    """MB that a process and its children hold."""
    return sum(one.memory_info().rss for one in _family(process)) / 1e6


def _processor_time(process: int) -> float:
    """s that a process and its children computed."""
    times = [one.cpu_times() for one in _family(process)]
    return sum(one.user + one.system for one in times)
