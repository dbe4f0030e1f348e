"""A real server on loopback, in a thread, and its clients."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from bodysense.io.formats.protocol import POSE, SUBPROTOCOL, PoseFrame, SignalFrame, read_pose, write_signal
from bodysense_live.protocols.links import listen_tcp
from bodysense_live.server.launch import make_server
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import ClientMessage, Hello
from bodysense_live.server.settings import ServerSettings

DEVICES = ("headset", "left_controller", "right_controller")


def signal(sequence: int, time: float, points: int = 3) -> SignalFrame:
    """Return a frame of a person of 1.70 m who faces −Z, as WebXR's viewer does, and swings both hands slowly."""
    swing = 0.1 * np.sin(2 * np.pi * 0.5 * time)
    places = np.array([[0, 1.6, 0], [-0.25, 1.1 + swing, -0.3], [0.25, 1.1 - swing, -0.3]], dtype=np.float32)
    turned = np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (3, 1))
    every = np.arange(points, dtype=np.uint8)
    return SignalFrame(sequence, time, every, np.full(points, 3, dtype=np.uint8), places[:points], turned[:points])


@dataclass
class Client:
    """A WebSocket client that has said hello."""

    socket: Any
    welcome: dict[str, Any]
    texts: list[dict[str, Any]] = field(default_factory=list)  # received, not yet read

    def send_message(self, message: ClientMessage) -> None:
        self.socket.send(write_message(message))

    def send(self, frame: SignalFrame) -> None:
        self.socket.send(write_signal(frame))

    def frame(self, kind: int = POSE, seconds: float = 10.0) -> bytes:
        """Return the next frame of a kind; texts are kept for `text`."""
        until = time.monotonic() + seconds
        while True:
            received = self.socket.recv(timeout=max(until - time.monotonic(), 0))
            if isinstance(received, str):
                self.texts.append(json.loads(received))
            elif received[0] == kind:
                return received

    def pose(self) -> PoseFrame:
        return read_pose(self.frame(), len(self.welcome["points"]))

    def text(self, kind: str, seconds: float = 10.0) -> dict[str, Any]:
        """Return the next text of a type; other texts are kept, frames dropped."""
        until = time.monotonic() + seconds
        while True:
            for text in self.texts:
                if text["type"] == kind:
                    self.texts.remove(text)
                    return text
            received = self.socket.recv(timeout=max(until - time.monotonic(), 0))
            if isinstance(received, str):
                self.texts.append(json.loads(received))

    def answered(self, frame: SignalFrame) -> PoseFrame:
        """Send a frame and return its answer."""
        self.send(frame)
        pose = self.pose()
        while pose.sequence != frame.sequence:
            pose = self.pose()
        return pose


@dataclass(frozen=True)
class Address:
    """The address of a server."""

    port: int

    @property
    def http(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def websocket(self) -> str:
        return f"ws://127.0.0.1:{self.port}/ws"


Serving = Callable[..., Address]
Connecting = Callable[..., Client]


@contextmanager
def serving(settings: ServerSettings) -> Iterator[Address]:
    """Run a server within the block."""
    bound = listen_tcp("--port", "127.0.0.1", 0)
    ready = threading.Event()
    server = make_server(settings, lambda server: ready.set())
    thread = threading.Thread(target=server.run, args=([bound],), daemon=True)
    thread.start()
    try:
        assert ready.wait(30)
        yield Address(bound.getsockname()[1])
    finally:
        server.should_exit = True
        thread.join(30)
        bound.close()
        assert not thread.is_alive()


@contextmanager
def storing(port: int, host: str = "127.0.0.1") -> Iterator[str]:
    """Run Debian's Valkey or Redis within the block; skip the test without one."""
    pytest.importorskip("redis", reason="needs packages/live[shared]")
    program = shutil.which("valkey-server") or shutil.which("redis-server")
    if program is None:
        pytest.skip("needs Debian's valkey-server or redis-server")
    command = [program, "--port", str(port), "--bind", host, "--save", "", "--appendonly", "no", "--requirepass", "pw"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as server:
        try:
            until = time.monotonic() + 10
            while time.monotonic() < until:
                try:
                    socket.create_connection((host, port), timeout=1).close()
                    break
                except ConnectionRefusedError:
                    time.sleep(0.02)
            yield f"redis://:pw@{host}:{port}"
        finally:
            server.terminate()


def free_port() -> int:
    """Return a free TCP port."""
    with socket.create_server(("127.0.0.1", 0)) as found:
        return found.getsockname()[1]


@pytest.fixture(scope="session")
def store() -> Iterator[str]:
    """The address of a Valkey or Redis for many tests."""
    with storing(free_port()) as address:
        yield address


@pytest.fixture
def shared(store: str) -> str:
    """The address of an empty Valkey or Redis."""
    from redis import Redis

    with Redis.from_url(store) as client:
        client.flushall()
    return store


@pytest.fixture
def server_of() -> Iterator[Serving]:
    """Start a server: `server_of(settings)` returns its address."""
    pytest.importorskip("uvicorn", reason="needs packages/live")
    with ExitStack() as stack:
        yield lambda settings=ServerSettings(): stack.enter_context(serving(settings))


@pytest.fixture(scope="session")
def server() -> Iterator[Address]:
    """A server with default settings, for many tests."""
    pytest.importorskip("uvicorn", reason="needs packages/live")
    with serving(ServerSettings()) as address:
        yield address


@pytest.fixture
def connect() -> Iterator[Connecting]:
    """Connect to a server and say hello: `connect(address, points=…)`."""
    from websockets.sync.client import connect as open_socket
    from websockets.typing import Subprotocol

    with ExitStack() as stack:

        def call(address: Address, hello: Hello | None = None, **fields: Any) -> Client:
            opening = open_socket(address.websocket, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None)
            socket = stack.enter_context(opening)
            socket.send(write_message(hello or Hello(1, **{"points": DEVICES, **fields})))
            welcome = json.loads(socket.recv(timeout=10))
            assert welcome["type"] == "welcome", welcome
            return Client(socket, welcome)

        yield call
