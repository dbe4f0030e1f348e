"""Wearers in threads, who send frames to a server, and reconnect and resume whenever a connection breaks."""

from __future__ import annotations

import itertools
import json
import ssl
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from websockets import ConnectionClosed, WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from bodysense.io.formats.protocol import POSE, SUBPROTOCOL, SignalFrame, write_signal
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Calibrate, Hello, Recentre, Resume, Settings

from ..conftest import DEVICES, signal

RATE = 30


@dataclass
class Wearer:
    """A wearer of a headset and controllers away from the origin of the sensors, who recentres at first."""

    settings: Settings
    welcomes: list[dict[str, Any]] = field(default_factory=list)  # one per connection
    placed: dict[str, Any] = field(default_factory=dict)
    answered: float = 0.0  # s, time of the last answer, or of the last reason
    longest: float = 0.0  # s between two of them
    told: list[str] = field(default_factory=list)  # reasons: notices, errors, closing frames
    frames: Callable[[SignalFrame], list[SignalFrame]] = lambda frame: [frame]  # what is sent for each frame
    do: Callable[[Any], None] = lambda client: None  # called with the connection before each frame
    devices: tuple[Any, ...] = DEVICES
    first: Recentre | Calibrate = Recentre()  # sent to the first connection
    protocols: tuple[str, ...] = (SUBPROTOCOL,)
    pose: bytes = b""  # the last answer
    secure: ssl.SSLContext | None = None  # of an encrypted connection

    def wear(self, addresses: Sequence[str], over: threading.Event) -> None:
        """Connect to each address in turn."""
        resume, sequence, turns = None, 0, itertools.cycle(addresses)
        protocols = [Subprotocol(name) for name in self.protocols]
        while not over.is_set():
            with (
                suppress(OSError, WebSocketException, TimeoutError),
                self.reasons(),
                connect(
                    next(turns), subprotocols=protocols, compression=None, open_timeout=1, ssl=self.secure
                ) as client,
            ):
                settings = Settings() if resume else self.settings
                client.send(write_message(Hello(1, self.devices, resume=resume, settings=settings)))
                self.welcomes.append(json.loads(client.recv(timeout=1)))
                self.message(self.welcomes[-1])
                resume = Resume(self.welcomes[-1]["session"], self.welcomes[-1]["token"])
                if len(self.welcomes) == 1:
                    client.send(write_message(self.first))
                while not over.is_set():
                    self.do(client)
                    for frame in self.frames(self.signal(sequence)):
                        client.send(write_signal(frame))
                    sequence += 1
                    self.read(client, time.monotonic() + 1 / RATE)
            time.sleep(0.05)  # until the server may have an answer

    def signal(self, sequence: int) -> SignalFrame:
        """Return a frame, 1 m beside and 2 m before the origin."""
        frame = signal(sequence, sequence / RATE)
        return replace(frame, position=frame.position + np.array([1.0, 0.0, 2.0], dtype=np.float32))

    @contextmanager
    def reasons(self) -> Iterator[None]:
        """Keep the reason for which the server closes the connection."""
        try:
            yield
        except ConnectionClosed as error:
            if error.rcvd is not None:
                self.is_told(error.rcvd.reason or str(error.rcvd.code))
            raise

    def is_told(self, reason: str) -> None:
        self.told.append(reason)
        self.is_heard()

    def is_heard(self) -> None:
        now = time.monotonic()
        self.longest, self.answered = max(self.longest, now - (self.answered or now)), now

    def read(self, client: Any, until: float) -> None:
        while (remaining := until - time.monotonic()) > 0:
            try:
                received = client.recv(timeout=remaining)
            except TimeoutError:
                return
            if isinstance(received, str):
                self.message(json.loads(received))
            elif received[0] == POSE:
                self.pose = received
                self.is_heard()

    def message(self, message: dict[str, Any]) -> None:
        self.placed = message if message["type"] == "placed" else self.placed
        if message["type"] in ("said", "error"):
            self.is_told(message.get("text") or message["reason"])


@contextmanager
def worn(wearers: Sequence[Wearer], *addresses: str) -> Iterator[None]:
    """Let wearers wear within the block. Whenever a connection breaks, they try the next one of the addresses."""
    over = threading.Event()
    threads = [threading.Thread(target=one.wear, args=(addresses, over)) for one in wearers]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        over.set()
        for thread in threads:
            thread.join(10)


def until(found: Callable[[], Any], seconds: float = 60.0) -> Any:
    """Return the first true value of a function."""
    end = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < end
        time.sleep(0.02)
    return value
