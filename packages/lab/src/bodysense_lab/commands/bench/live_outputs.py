"""`bodysense bench live-outputs`: from a packet of trackers to the packets of a body, with four outputs on."""

from __future__ import annotations

import selectors
import socket
import struct
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.ranges import Count
from bodysense_lab.options import Json, Rate

_WARM_UP = 100  # frames
_PATIENCE = 0.5  # s for a body that does not come
_TO_START = 60.0  # s


def live_outputs(frames: Count = 2000, rate: Rate = 72.0, json: Json = None) -> None:
    """Time the way through a server: headset and controllers in by VMC, bodies out by VMC, VRChat, VMT and SolarXR.

    From the moment that a packet is sent to the first packet of its body, as a program on this machine sees it; `all`
    is the slowest of the four. Programs that are sent to are played; no SteamVR may run here.

    Args:
        frames: bodies to time.
        rate: Hz; packets that come in.
    """
    from bodysense_lab.commands.bench.timing import report

    with _Peers() as peers:
        for k in range(_WARM_UP):
            peers.body(k, rate)
        found = [peers.body(_WARM_UP + k, rate) for k in range(frames)]
    numbers: dict[str, float] = {"frames": frames, "rate_hz": rate, "missed": sum(one is None for one in found)}
    rows = np.array([list(one.values()) for one in found if one is not None]) * 1000
    if not len(rows):
        raise BodysenseError("no body came out in time; see the server's own words above")
    for name, values in (*zip(peers.names, rows.T, strict=True), ("all", rows.max(axis=1))):
        numbers |= {
            f"{name}_p50_ms": float(np.percentile(values, 50)),
            f"{name}_p99_ms": float(np.percentile(values, 99)),
        }
    report("live-outputs", numbers, json)


class _Peers:
    """A server of its own process, who sends to it and who is sent to."""

    names = ("vmc", "vrchat", "vmt", "solarxr")

    def __enter__(self) -> _Peers:
        from bodysense_lab.serving.server import running_server
        from bodysense_live.vmt import DRIVER_PORT

        self._stack = ExitStack()
        with ExitStack() as stack:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="bodysense-"))
            with _udp(0) as free:
                port = free.getsockname()[1]
            self._input = stack.enter_context(_udp(0))
            self._target = ("127.0.0.1", port)
            avatars = [stack.enter_context(_udp(0)), stack.enter_context(_udp(0))]
            ports = [one.getsockname()[1] for one in avatars]
            driver = stack.enter_context(_udp(DRIVER_PORT))
            outputs = ("--vmc-out", f"127.0.0.1:{ports[0]}", "--vrchat-out", f"127.0.0.1:{ports[1]}")
            options = (*outputs, "--vmt", "--vmt-port", "0", "--solarxr", "--solarxr-port", "0")
            stack.enter_context(running_server("--vmc-in", str(port), *options, XDG_RUNTIME_DIR=folder))
            runtime = stack.enter_context(_runtime(Path(folder)))
            self._selector = stack.enter_context(selectors.DefaultSelector())
            for name, one in zip(self.names, (*avatars, driver, runtime), strict=True):
                one.setblocking(False)
                self._selector.register(one, selectors.EVENT_READ, name)
            self._stack = stack.pop_all()
        self._due = time.monotonic()
        return self

    def __exit__(self, *_: Any) -> None:
        self._stack.close()

    def body(self, k: int, rate: float) -> dict[str, float] | None:
        """Return the seconds until the body of the k-th packet is at each output; None if it did not arrive."""
        while (left := self._due - time.monotonic()) > 0:  # packets that arrive meanwhile belong to the previous one
            self._ready(left)
        self._ready(0)
        self._due = max(self._due + 1 / rate, time.monotonic())
        sent = time.monotonic()
        self._input.sendto(_devices(k / rate), self._target)
        found: dict[str, float] = {}
        while len(found) < len(self.names):
            left = sent + _PATIENCE - time.monotonic()
            if left <= 0:
                return None
            for name in self._ready(left):
                found.setdefault(name, time.monotonic() - sent)
        return {name: found[name] for name in self.names}

    def _ready(self, seconds: float) -> list[str]:
        """The outputs that have a body now, or within some seconds; what they have is read."""
        found = []
        for key, _ in self._selector.select(max(seconds, 0.0)):
            one: Any = key.fileobj
            data = b"".join(_everything(one))
            if key.data != "vmt" or b"/VMT/Raw/Driver" in data:  # the driver is asked things, too
                found.append(key.data)
        return found


def _everything(one: socket.socket) -> Iterator[bytes]:
    while True:
        try:
            data = one.recv(1 << 16)
        except BlockingIOError:
            return
        if not data:
            raise BodysenseError("the server hung up; see its own words above")
        yield data


@contextmanager
def _udp(port: int) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        try:
            found.bind(("127.0.0.1", port))
        except OSError as error:
            raise BodysenseError(
                f"UDP port {port}: {error.strerror}; stop what listens there (SteamVR's VMT)"
            ) from None
        yield found


@contextmanager
def _runtime(folder: Path) -> Iterator[socket.socket]:
    """A runtime that asked for updates."""
    from bodysense_lab.serving.solarxr_client import request
    from bodysense_live.solarxr_link import RPC

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as found:
        found.settimeout(_TO_START)
        found.connect(str(folder / RPC))
        starts = request(polls=False, starts=1, asks=None)
        found.sendall(struct.pack("<I", 4 + len(starts)) + starts)
        yield found


def _devices(time: float) -> bytes:
    """Return headset and controllers of a swaying wearer, in one packet of VMC."""
    from bodysense.io.osc import bundled, message_bytes

    sway = 0.1 * float(np.sin(2 * np.pi * 0.3 * time))
    rows = (
        ("Hmd", "HMD", sway, 1.6, 0.0),
        ("Con", "left", -0.3, 1.0 + sway, 0.3),
        ("Con", "right", 0.3, 1.0 - sway, 0.3),
    )
    upright = (0.0, 0.0, 0.0, 1.0)
    messages = [
        message_bytes(f"/VMC/Ext/{kind}/Pos", "sfffffff", serial, *place, *upright) for kind, serial, *place in rows
    ]
    (packet,) = bundled([message_bytes("/VMC/Ext/T", "f", time), *messages])
    return packet
