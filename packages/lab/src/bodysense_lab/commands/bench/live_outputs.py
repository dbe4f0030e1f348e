"""`bodysense bench live-outputs`: latency from a packet of trackers to the packets of a body, on four outputs."""

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
from bodysense_lab.core.options import Json, Rate

_WARM_UP = 100  # frames
_TIMEOUT = 0.5  # s after which a body counts as missed
_START_TIMEOUT = 60.0  # s for the server to start


def live_outputs(frames: Count = 2000, rate: Rate = 72.0, json: Json = None) -> None:
    """Time a server with headset and controllers by VMC, and bodies out by VMC, VRChat, VMT and SolarXR.

    Times are from sending a packet to receiving the first packet of its body on this machine; `all` is the slowest of
    the four. The receiving programs are simulated. SteamVR must not run on this machine.

    Args:
        frames: bodies to time.
        rate: incoming packets per second.
    """
    from bodysense_lab.commands.bench.timing import report

    with _Peers() as peers:
        for k in range(_WARM_UP):
            peers.body(k, rate)
        found = [peers.body(_WARM_UP + k, rate) for k in range(frames)]
    numbers: dict[str, float] = {"frames": frames, "rate_hz": rate, "missed": sum(one is None for one in found)}
    rows = np.array([list(one.values()) for one in found if one is not None]) * 1000
    if not len(rows):
        raise BodysenseError("no body came out in time; see the server's output above")
    for name, values in (*zip(peers.names, rows.T, strict=True), ("all", rows.max(axis=1))):
        numbers |= {
            f"{name}_p50_ms": float(np.percentile(values, 50)),
            f"{name}_p99_ms": float(np.percentile(values, 99)),
        }
    report("live-outputs", numbers, json)


class _Peers:
    """A server in its own process, a sender of trackers, and receivers of bodies."""

    names = ("vmc", "vrchat", "vmt", "solarxr")

    def __enter__(self) -> _Peers:
        from bodysense_lab.serving.server import running_server
        from bodysense_live.protocols.steamvr.vmt import DRIVER_PORT

        self._stack = ExitStack()
        with ExitStack() as stack:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="bodysense-"))
            with _udp_socket(0) as free:
                port = free.getsockname()[1]
            self._input = stack.enter_context(_udp_socket(0))
            self._target = ("127.0.0.1", port)
            avatars = [stack.enter_context(_udp_socket(0)), stack.enter_context(_udp_socket(0))]
            ports = [one.getsockname()[1] for one in avatars]
            driver = stack.enter_context(_udp_socket(DRIVER_PORT))
            outputs = ("--vmc-out", f"127.0.0.1:{ports[0]}", "--vrchat-out", f"127.0.0.1:{ports[1]}")
            options = (*outputs, "--vmt", "--vmt-port", "0", "--solarxr", "--solarxr-port", "0")
            stack.enter_context(running_server("--vmc-in", str(port), *options, XDG_RUNTIME_DIR=folder))
            runtime = stack.enter_context(_runtime_socket(Path(folder)))
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
        while (remaining := self._due - time.monotonic()) > 0:  # these packets are of the previous one
            self._ready_outputs(remaining)
        self._ready_outputs(0)
        self._due = max(self._due + 1 / rate, time.monotonic())
        sent = time.monotonic()
        self._input.sendto(_device_packet(k / rate), self._target)
        found: dict[str, float] = {}
        while len(found) < len(self.names):
            remaining = sent + _TIMEOUT - time.monotonic()
            if remaining <= 0:
                return None
            for name in self._ready_outputs(remaining):
                found.setdefault(name, time.monotonic() - sent)
        return {name: found[name] for name in self.names}

    def _ready_outputs(self, seconds: float) -> list[str]:
        """Return the outputs that receive a body within `seconds`, after reading their packets."""
        found = []
        for key, _ in self._selector.select(max(seconds, 0.0)):
            one: Any = key.fileobj
            data = b"".join(_read_available(one))
            if key.data != "vmt" or b"/VMT/Raw/Driver" in data:  # the driver also receives requests
                found.append(key.data)
        return found


def _read_available(one: socket.socket) -> Iterator[bytes]:
    while True:
        try:
            data = one.recv(1 << 16)
        except BlockingIOError:
            return
        if not data:
            raise BodysenseError("the server closed a connection; see its output above")
        yield data


@contextmanager
def _udp_socket(port: int) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
        try:
            found.bind(("127.0.0.1", port))
        except OSError as error:
            raise BodysenseError(
                f"UDP port {port}: {error.strerror}; stop what listens there (SteamVR's VMT)"
            ) from None
        yield found


@contextmanager
def _runtime_socket(folder: Path) -> Iterator[socket.socket]:
    """Connect a runtime that has requested updates."""
    from bodysense_lab.serving.solarxr_client import request
    from bodysense_live.protocols.solarxr.solarxr_link import RPC

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as found:
        found.settimeout(_START_TIMEOUT)
        found.connect(str(folder / RPC))
        starts = request(polls=False, starts=1, asks=None)
        found.sendall(struct.pack("<I", 4 + len(starts)) + starts)
        yield found


def _device_packet(time: float) -> bytes:
    """Return headset and controllers of a swaying wearer, in one VMC packet."""
    from bodysense.io.formats.osc import bundled, message_bytes

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
