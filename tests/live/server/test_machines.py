"""Two server hosts, each in a network namespace, behind HAProxy: if one ends, its wearers resume at the other."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.io.formats.protocol import SUBPROTOCOL, PoseFrame, SignalFrame, read_pose
from bodysense_live.server.messages import Calibrate, Recentre, Settings
from bodysense_live.sessions.tracked_devices import SIGNALS

from ..conftest import storing
from ..sessions.test_worn_trackers import SKELETON, STRAPPED, frames
from .wearers import RATE, Wearer, until, worn

DEPLOY = Path(__file__).parents[3] / "extras" / "deploy"
NETWORK, TOKEN = "10.231.77", "a-token-of-this-test"
PROXY, STORE, SERVER = 8080, 6379, 8765  # ports
WEARERS = 4
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


def answers(url: str) -> bool:
    with suppress(OSError), urllib.request.urlopen(url, timeout=1):
        return True
    return False


@cache
def standing_frames() -> list[SignalFrame]:
    return frames(4 * RATE)


@dataclass
class Strapped(Wearer):
    """A standing wearer with three unassigned trackers, who calibrates at first."""

    last_welcome: dict[str, Any] = field(default_factory=dict)
    is_calibrated: bool = False
    devices: tuple[Any, ...] = SIGNALS
    first: Recentre | Calibrate = Calibrate()
    protocols: tuple[str, ...] = (SUBPROTOCOL, f"token.{TOKEN}")

    def is_told(self, reason: str) -> None:
        self.told.append(reason)  # poses alone are answers

    def signal(self, sequence: int) -> SignalFrame:
        return replace(standing_frames()[sequence % (4 * RATE)], sequence=sequence, time=sequence / RATE)

    def message(self, message: dict[str, Any]) -> None:
        super().message(message)
        self.last_welcome = message if message["type"] == "welcome" else self.last_welcome
        self.is_calibrated |= message["type"] == "said" and message["text"].startswith("worn:")

    @property
    def estimated(self) -> PoseFrame:
        return read_pose(self.pose, len(SKELETON.points))

    def is_tracked(self) -> bool:
        """Whether the joints with trackers are measured."""
        measured = self.estimated.hidden[SKELETON.indices(list(STRAPPED))] < 0.5
        return bool(measured.all())


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
            until(partial(answers, f"http://{NETWORK}.{number}:{SERVER}/healthz"))
        address = f"{NETWORK}.1:{PROXY}"
        ends = {name: f"{NETWORK}.{number}:{SERVER}" for name, number in (("ONE", 2), ("TWO", 3))}
        stack.enter_context(running(["haproxy", "-f", str(DEPLOY / "haproxy.cfg")], LISTEN=address, **ends))
        until(partial(answers, f"http://{address}/healthz"))

        wearers = [Strapped(Settings(height=1.5 + 0.1 * k, floor=0.01 * k)) for k in range(WEARERS)]
        stack.enter_context(worn(wearers, f"ws://{address}/ws"))
        until(lambda: all(one.is_calibrated and one.pose and one.is_tracked() for one in wearers), 30)
        time.sleep(3.0)  # until the sessions are stored and the bodies are at rest
        before = [(one.last_welcome, one.estimated) for one in wearers]
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
            assert np.abs(one.estimated.root_position - pose.root_position).max() < 0.03  # m
            assert (
                one.last_welcome["settings"] == last_welcome["settings"]
                and one.last_welcome["session"] == last_welcome["session"]
            )
        for one in reconnected:
            back = one.welcomes[-1]
            assert back["resumed"] and back["height"] == pytest.approx(back["settings"]["height"], abs=0.002)
        assert {one.last_welcome["settings"]["floor"] for one in wearers} == {0.0, 0.01, 0.02, 0.03}
        print(f"{end}: longest silence {max(one.longest for one in reconnected):.2f} s")
