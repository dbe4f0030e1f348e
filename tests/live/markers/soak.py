"""Lag of live markers over a long time: `PYTHONPATH=tests python -m tests.live.markers.soak --seconds 600`.

A twin of each server sends a body with two gloves at 100 Hz to `bodysense serve`; the poses are timed as they arrive.
Twin, server and client are processes of their own.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bodysense.io.formats.protocol import POSE, SIGNAL, SUBPROTOCOL, read_pose, read_signal
from bodysense_lab.serving.server import running_server
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Hello

from .performer import captured
from .twins import NatnetTwin, QtmTwin, Twin, ViconTwin

ROOT = Path(__file__).parents[3]
TWINS: dict[str, type[Twin]] = {"natnet": NatnetTwin, "qtm": QtmTwin, "vicon": ViconTwin}
_SETTLING = 3.0  # s, until the layout is learned


@dataclass(frozen=True)
class Lag:
    """How late poses are, in frames of the server, and how many came."""

    frames: int  # that were sent
    poses: int
    median: float
    p99: float
    longest: float


@contextmanager
def twin_process(name: str, rate: float) -> Iterator[tuple[int, float]]:
    """Run a twin in its own process; yield its port and when it sent frame 0, s of the monotonic clock."""
    command = [sys.executable, "-m", "tests.live.markers.soak", "--twin", name, "--rate", str(rate)]
    path = os.pathsep.join([str(ROOT / "tests"), *sys.path])
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=ROOT, env={**os.environ, "PYTHONPATH": path}, **pipes) as process:
        assert process.stdout is not None and process.stdin is not None
        port, start = process.stdout.readline().split()
        try:
            yield int(port), float(start)
        finally:
            process.stdin.close()


def play(name: str, rate: float) -> None:
    """Play a twin until the standard input ends."""
    with TWINS[name](captured(rate)) as twin:
        while 0 not in twin.sent:
            time.sleep(0.01)
        print(twin.port, twin.sent[0], flush=True)
        sys.stdin.read()


def lag_of(name: str, seconds: float, rate: float = 100.0) -> Lag:
    """Return the lag of poses from a twin's frames of body and gloves, from sending to the arrival at a client."""
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    late: list[float] = []
    with (
        twin_process(name, rate) as (port, start),
        running_server("--markers", f"{name}://127.0.0.1:{port}") as (address, _),
        connect(_websocket(address), subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None) as client,
    ):
        client.send(write_message(Hello(1, watch="markers")))
        begun, frame, points, body = time.monotonic(), 0, 0, 0
        while time.monotonic() - begun < seconds + _SETTLING:
            received = client.recv(timeout=20)
            now = time.monotonic()
            if isinstance(received, str):
                message = json.loads(received)
                if message["type"] == "welcome":
                    points, body = len(message["signal"]), len(message["points"])
            elif received[0] == SIGNAL and now - begun > _SETTLING:
                frame = round(read_signal(received, points).time * rate)
            elif received[0] == POSE and frame and (read_pose(received, body).hidden < 0.5).sum() > 20:
                late.append((now - start) * rate - frame)
    sent = round(seconds * rate)
    median, high = (float(value) for value in np.percentile(late, (50, 99)))
    return Lag(sent, len(late), median, high, max(late))


def _websocket(address: str) -> str:
    return f"{address.replace('http://', 'ws://').rstrip('/')}/ws"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0, help="time for each server")
    parser.add_argument("--server", choices=TWINS, nargs="*", default=list(TWINS))
    parser.add_argument("--twin", choices=TWINS, help="play this twin until the standard input ends")
    parser.add_argument("--rate", type=float, default=100.0, help="frames per second of --twin")
    given = parser.parse_args()
    if given.twin is not None:
        play(given.twin, given.rate)
        sys.exit()
    for server in given.server:
        lag = lag_of(server, given.seconds)
        print(
            f"{server}: {lag.poses} poses of {lag.frames} frames at 100 Hz; lag in frames: median {lag.median:.2f}, "
            f"99 % below {lag.p99:.2f}, longest {lag.longest:.2f}",
            flush=True,
        )
