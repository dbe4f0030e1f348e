"""Hostile packets of every UDP and socket protocol. Readers must raise nothing and give no NaN."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.io.formats.osc import bundled, message_bytes
from bodysense.observing.checks import check_observation
from bodysense_live.protocols.slimevr import SlimevrState, take
from bodysense_live.protocols.solarxr.driver_input import DriverReader, DriverState
from bodysense_live.protocols.solarxr.driver_messages import is_hello, read_requests
from bodysense_live.protocols.solarxr.runtime_messages import read_bundle, settings_bundle
from bodysense_live.protocols.solarxr.solarxr_input import InputReader
from bodysense_live.protocols.steamvr.vmt import VmtReader
from bodysense_live.protocols.vmc import VmcTrackers
from bodysense_live.protocols.vrchat import VrchatReader
from bodysense_live.sessions.tracked_devices import DeviceReader

from ..protocols.solarxr import client
from .hostile_clients import corrupted

_POSE = (0.0, 1.6, 0.0, 0.0, 0.0, 0.0, 1.0)
_HERE = ("127.0.0.1", 50000)
_HELLO = struct.pack(">IQ7i", 3, 0, 4, 0, 0, 0, 0, 0, 22) + b"\x01x" + bytes(range(1, 7))
_READERS: dict[str, tuple[DeviceReader, tuple[bytes, ...]]] = {  # readers and valid packets, by protocol
    "vmc": (
        VmcTrackers(),
        tuple(
            bundled([message_bytes("/VMC/Ext/T", "f", 1.0), message_bytes("/VMC/Ext/Hmd/Pos", "sfffffff", "H", *_POSE)])
        ),
    ),
    "vmt": (
        VmtReader(),
        (
            message_bytes("/VMT/Out/Devices/List", "s", "0:H\n1:A\n"),
            message_bytes("/VMT/Out/SubscribedDevice", "sfffffff", "H", *_POSE),
        ),
    ),
    "vrchat": (VrchatReader(), (message_bytes("/tracking/vrsystem/head/pose", "ffffff", *_POSE[:6]),)),
    "solarxr input": (
        InputReader(),
        (
            b"\x1a\x04\x08\x01\x20\x13",
            b"\x0a\x25\x08\x01" + b"".join(bytes([k << 3 | 5]) + struct.pack("<f", x) for k, x in enumerate(_POSE, 2)),
        ),
    ),
}
_SLIMEVR = (
    _HELLO,
    struct.pack(">IQBB4fB", 17, 1, 0, 1, 0.0, 0.0, 0.0, 1.0, 0),
    struct.pack(">IQBBBHBBB2f", 15, 1, 0, 1, 0, 0, 1, 9, 0, 0.0, 0.0),
    struct.pack(">IQBB", 101, 1, 19, 23) + bytes(18),
)
_DRIVER = (
    client.add_tracker("abc", 1, 7),
    client.tracker_pose(1, (0, 1, 0)),
    client.register("a", (0, 3), 1),
    client.connection_message(client.HELLO, 3),
)


def fuzz_packets(count: int, rng: np.random.Generator) -> dict[str, int]:
    """Read `count` packets, mostly corrupted, and count them by protocol. Raises BodysenseError for a failure."""
    steps: dict[str, Callable[[int], object]] = {}
    for name, (reader, good) in _READERS.items():
        steps[name] = partial(_read, reader, good, rng, [reader.start()])
    steps["slimevr"] = partial(_slimevr, rng, [SlimevrState()])
    greeted = DriverState(greeted=True, configured=True, name="driver")
    steps["solarxr driver"] = partial(_read, DriverReader(), _DRIVER, rng, [greeted])
    requests = client.request(starts=1, asks=7), settings_bundle(7)
    steps["solarxr"] = lambda k: read_bundle(_packet(requests, rng))
    steps["solarxr requests"] = lambda k: [read(_packet(_DRIVER, rng)) for read in (is_hello, read_requests)]
    for k in range(count):
        name = list(steps)[k % len(steps)]
        try:
            steps[name](k)
        except Exception as error:
            raise BodysenseError(
                f"packets: {name} failed after {k} of them: {type(error).__name__}: {error}"
            ) from error
    return {name: len(range(k, count, len(steps))) for k, name in enumerate(steps)}


def _packet(good: tuple[bytes, ...], rng: np.random.Generator) -> bytes:
    """Return a valid packet, mostly corrupted, or a random one."""
    chance = rng.random()
    if chance < 0.1:
        return rng.bytes(int(rng.integers(0, 120)))
    packet = good[int(rng.integers(len(good)))]
    return packet if chance < 0.3 else corrupted(packet, rng)


def _read(reader: DeviceReader, good: tuple[bytes, ...], rng: np.random.Generator, state: list[Any], k: int) -> None:
    packet, now = _packet(good, rng), k * 1e-3
    state[0], _ = reader.take(packet, now, state[0])
    reader.commands(packet)
    reader.is_whole(now, state[0])
    observation = reader.observation(now, state[0])
    if observation is not None:
        check_observation(observation)


def _slimevr(rng: np.random.Generator, state: list[SlimevrState], k: int) -> None:
    packet = _packet(_SLIMEVR, rng)
    taken = take(packet, _HERE, k * 1e-3, state[0], frozenset())
    state[0] = taken.state
    assert sum(map(len, taken.replies)) <= 64 + 14 * len(packet)  # no reply is much larger than its request
    sensors = [one for tracker in taken.state.trackers.values() for one in tracker.sensors.values()]
    assert all(one.rotation is None or np.isfinite(one.rotation).all() for one in sensors)
