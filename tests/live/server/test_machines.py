"""Two server hosts, each in a network namespace, behind HAProxy: if one ends, its wearers resume at the other."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.io.formats.protocol import POSE, SUBPROTOCOL, PoseFrame, read_pose, write_signal
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Calibrate, Hello, Resume, Settings
from bodysense_live.sessions.tracked_devices import SIGNALS

from ..conftest import storing
from ..sessions.test_worn_trackers import SKELETON, STRAPPED, frames

DEPLOY = Path(__file__).parents[3] / "extras" / "deploy"
NETWORK, TOKEN = "10.231.77", "a-token-of-this-test"
PROXY, STORE, SERVER = 8080, 6379, 8765  # ports
RATE, WEARERS = 30, 4
BACK = 2.0  # s until a wearer is answered again

pytestmark = [
    pytest.mark.slow,
    pytest.mark.alone,
    pytest.mark.skipif(
        sys.platform != "linux" or os.geteuid() != 0 or not all(map(shutil.which, ("ip", "haproxy"))),
        reason="needs root, and Debian's iproute2 and haproxy",
    ),
]


def ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True)


@contextmanager
def network(hosts: tuple[str, ...]) -> Iterator[None]:
    """Create a bridge with the first address, and a namespace and a link for each host, named after it."""
    bridge = "bs-bridge"
    with ExitStack() as undo:
        ip("link", "add", bridge, "type", "bridge")
        undo.callback(ip, "link", "del", bridge)
        ip("addr", "add", f"{NETWORK}.1/24", "dev", bridge)
        ip("link", "set", bridge, "up")
        for number, host in enumerate(hosts, start=2):
            ip("netns", "add", host)
            undo.callback(ip, "netns", "del", host)
            ip("link", "add", host, "type", "veth", "peer", "name", "net", "netns", host)
            undo.callback(ip, "link", "del", host)  # with open connections a namespace exists for minutes
            ip("link", "set", host, "master", bridge, "up")
            ip("-n", host, "addr", "add", f"{NETWORK}.{number}/24", "dev", "net")
            for device in ("lo", "net"):
                ip("-n", host, "link", "set", device, "up")
        yield


@contextmanager
def running(command: list[str], **environment: str) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, env=os.environ | environment) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for(url: str) -> None:
    until = time.monotonic() + 60
    while time.monotonic() < until:
        with suppress(OSError), urllib.request.urlopen(url, timeout=1):
            return
        time.sleep(0.05)
    raise AssertionError(f"{url} does not answer")


@dataclass
class Wearer:
    """A standing wearer with three unassigned trackers, who reconnects whenever the connection breaks."""

    settings: Settings
    welcomes: list[dict[str, Any]] = field(default_factory=list)  # one per connection
    last_welcome: dict[str, Any] = field(default_factory=dict)
    pose: PoseFrame | None = None
    answered: float = 0.0  # s, time of the last answer
    longest: float = 0.0  # s between two answers
    is_calibrated: bool = False
    resume: Resume | None = None

    def wear(self, address: str, over: threading.Event) -> None:
        from websockets import WebSocketException
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        protocols = [Subprotocol(SUBPROTOCOL), Subprotocol(f"token.{TOKEN}")]
        signals, sequence = frames(4 * RATE), 0
        while not over.is_set():
            try:
                with connect(address, subprotocols=protocols, compression=None, open_timeout=1) as socket:
                    settings = Settings() if self.resume else self.settings
                    socket.send(write_message(Hello(1, SIGNALS, settings=settings, resume=self.resume)))
                    self.last_welcome = json.loads(socket.recv(timeout=1))
                    self.welcomes.append(self.last_welcome)
                    self.resume = Resume(self.last_welcome["session"], self.last_welcome["token"])
                    if len(self.welcomes) == 1:
                        socket.send(write_message(Calibrate()))
                    while not over.is_set():
                        frame = signals[sequence % len(signals)]
                        socket.send(
                            write_signal(type(frame)(**{**vars(frame), "sequence": sequence, "time": sequence / RATE}))
                        )
                        sequence += 1
                        self.read(socket, time.monotonic() + 1 / RATE)
            except (OSError, WebSocketException):
                time.sleep(0.05)

    def read(self, socket: Any, until: float) -> None:
        while (left := until - time.monotonic()) > 0:
            try:
                received = socket.recv(timeout=left)
            except TimeoutError:
                return
            if isinstance(received, str):
                message = json.loads(received)
                self.last_welcome = message if message["type"] == "welcome" else self.last_welcome
                self.is_calibrated |= message["type"] == "said" and message["text"].startswith("worn:")
            elif received[0] == POSE:
                now = time.monotonic()
                self.longest = max(self.longest, now - (self.answered or now))
                self.pose, self.answered = read_pose(received, len(SKELETON.points)), now

    def is_tracked(self) -> bool:
        """Whether the joints with trackers are measured."""
        assert self.pose is not None
        return bool((self.pose.hidden[SKELETON.indices(list(STRAPPED))] < 0.5).all())


@pytest.mark.parametrize("end", ["killed", "cut off", "drained"])
def test_wearers_of_a_host_that_ends_resume_at_the_other(end: str) -> None:
    hosts = ("bs-one", "bs-two")
    with ExitStack() as stack:
        stack.enter_context(network(hosts))
        store = stack.enter_context(storing(STORE, f"{NETWORK}.1"))
        servers = []
        for number, host in enumerate(hosts, start=2):
            command = ["ip", "netns", "exec", host, sys.executable, "-m", "bodysense", "serve"]
            command += ["--host", f"{NETWORK}.{number}", "--port", str(SERVER), "--token", TOKEN, "--shared", store]
            servers.append(stack.enter_context(running(command)))
        for number in (2, 3):
            wait_for(f"http://{NETWORK}.{number}:{SERVER}/healthz")
        address = f"{NETWORK}.1:{PROXY}"
        ends = {name: f"{NETWORK}.{number}:{SERVER}" for name, number in (("ONE", 2), ("TWO", 3))}
        stack.enter_context(running(["haproxy", "-f", str(DEPLOY / "haproxy.cfg")], LISTEN=address, **ends))
        wait_for(f"http://{address}/healthz")

        over, wearers = (
            threading.Event(),
            [Wearer(Settings(height=1.5 + 0.1 * k, floor=0.01 * k)) for k in range(WEARERS)],
        )
        threads = [threading.Thread(target=one.wear, args=(f"ws://{address}/ws", over)) for one in wearers]
        stack.callback(lambda: [thread.join(10) for thread in threads])
        stack.callback(over.set)
        for thread in threads:
            thread.start()
        until = time.monotonic() + 30
        while not all(one.is_calibrated and one.pose is not None and one.is_tracked() for one in wearers):
            assert time.monotonic() < until, wearers
            time.sleep(0.05)
        time.sleep(3.0)  # until the sessions are stored and the bodies are at rest
        before = [(one.last_welcome, one.pose) for one in wearers]
        for one in wearers:
            one.longest = 0.0

        if end == "cut off":
            ip("link", "set", hosts[0], "down")
        else:
            servers[0].send_signal(signal.SIGKILL if end == "killed" else signal.SIGTERM)
        time.sleep(4.0)
        reconnected = [one for one in wearers if len(one.welcomes) > 1]
        assert len(reconnected) == WEARERS // 2  # HAProxy balances both hosts
        for one, (last_welcome, pose) in zip(wearers, before, strict=True):
            assert time.monotonic() - one.answered < 0.5 and one.longest < BACK, one.longest
            assert one.is_tracked()
            assert pose is not None and one.pose is not None
            assert np.abs(one.pose.root_position - pose.root_position).max() < 0.03  # m
            assert (
                one.last_welcome["settings"] == last_welcome["settings"]
                and one.last_welcome["session"] == last_welcome["session"]
            )
        for one in reconnected:
            back = one.welcomes[-1]
            assert back["resumed"] and back["height"] == pytest.approx(back["settings"]["height"], abs=0.002)
        assert {one.last_welcome["settings"]["floor"] for one in wearers} == {0.0, 0.01, 0.02, 0.03}
        print(f"{end}: longest silence {max(one.longest for one in reconnected):.2f} s")
