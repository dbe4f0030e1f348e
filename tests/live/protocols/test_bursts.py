"""Packets that arrive in one turn of the event loop, whose clock counts whole milliseconds: the newest is answered."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

import numpy as np
import pytest

from bodysense.io.formats.osc import message_bytes
from bodysense_live.protocols.links import DeviceInput
from bodysense_live.protocols.steamvr.vmt import VmtReader
from bodysense_live.protocols.vmc import VmcTrackers
from bodysense_live.protocols.vrchat import VRCHAT_POINTS, VrchatReader
from bodysense_live.server.metrics import Metrics
from bodysense_live.sessions.session import Session
from bodysense_live.sessions.tracked_devices import SIGNALS, DeviceReader, TrackedDevices

from . import test_vmc_trackers, test_vmt


class CoarseLoop(asyncio.SelectorEventLoop):
    """An event loop whose clock counts whole milliseconds, as uvloop's does, and stands still within a turn."""

    def time(self) -> float:
        return math.floor(super().time() * 1000) / 1000


def vmc(height: float) -> bytes:
    upright = (0.0, 0.0, 0.0, 1.0)
    hands = [("Con", side, (x, 1.0, 0.3), upright) for side, x in (("left", -0.4), ("right", 0.4))]
    return test_vmc_trackers.packet(("Hmd", "HMD", (0.0, height, 0.0), upright), *hands)


def vmt(height: float) -> bytes:
    return test_vmt.device("HMD", (0.0, height, 0.0))


def vrchat(height: float) -> bytes:
    return message_bytes("/tracking/vrsystem/head/pose", "ffffff", 0.0, height, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("reader", "points", "packet"),
    [
        (VmcTrackers(), SIGNALS, vmc),
        (VmtReader(TrackedDevices({"HMD": "headset"})), SIGNALS, vmt),
        (VrchatReader(), VRCHAT_POINTS, vrchat),
    ],
    ids=["vmc", "vmt", "vrchat"],
)
def test_the_newest_packet_of_a_turn_is_answered(
    reader: DeviceReader, points: tuple[str, ...], packet: Callable[[float], bytes]
) -> None:
    rng, session, dropped = np.random.default_rng(3), Session(points), list[str | None]()

    async def go() -> None:
        loop = asyncio.get_running_loop()
        device_input = DeviceInput(lambda frame: dropped.append(session.receive(frame, 0.0)), Metrics(), reader, points)
        for turn in range(30):
            heights = rng.uniform(1.4, 1.8, int(rng.integers(1, 20)))
            for height in heights:
                device_input.datagram_received(packet(float(height)), ("127.0.0.1", 1))
            await asyncio.sleep(float(rng.choice([0.003, 0.004, 0.012])))
            answer = session.step()
            assert answer is not None, turn
            head = answer.signal.position[answer.signal.point == points.index("headset")]
            assert head[0, 1] == pytest.approx(heights[-1], abs=1e-5)
            assert answer.signal.time <= loop.time() + 0.01

    with asyncio.Runner(loop_factory=CoarseLoop) as runner:
        runner.run(go())
    assert "late" not in dropped
