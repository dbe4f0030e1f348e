"""An overloaded server: even answers for all wearers, and few decoded frames."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from bodysense.io.formats.protocol import SUBPROTOCOL, read_pose, read_signal, write_signal
from bodysense.tracking.estimate import Estimate
from bodysense_live.server import scheduler
from bodysense_live.server.message_text import write_message
from bodysense_live.server.messages import Hello
from bodysense_live.sessions import session
from bodysense_live.sessions.answer import CompletionJob
from bodysense_live.sessions.estimation import PipelineState, step_many
from bodysense_live.sessions.newest_frames import SKIPPED, NewestFrames

from ..conftest import DEVICES, Address, Connecting, Serving, signal

RATE, SECONDS = 8.0, 5.0  # Hz, s
LOADS = ((5, 4.0), (20, 2.0))  # number of wearers, load as a multiple of the capacity


@dataclass
class SlowStep:
    """A replacement of the tracker: returns the estimate of a first step after a sleep."""

    seconds: float  # duration of a step per wearer
    answer: tuple[Estimate, PipelineState] | None = None
    begun: float = 0.0  # s, of the first step
    ended: float = 0.0  # s, of the last one
    busy: float = 0.0  # s spent in steps
    jobs: int = 0
    late: list[float] = field(default_factory=list)  # s by which a frame was older than the newest one sent

    def __call__(self, jobs: Sequence[CompletionJob]) -> list[tuple[Estimate, PipelineState]]:
        if self.answer is None:
            ((estimate, state),) = step_many([(jobs[0].pipeline, jobs[0].observation, jobs[0].state)])
            self.answer = estimate, state
            self.begun = time.monotonic()
        begun = time.monotonic()
        self.late += [begun - job.frame.time for job in jobs]
        time.sleep(self.seconds * len(jobs))
        self.ended = time.monotonic()
        self.busy, self.jobs = self.busy + self.ended - begun, self.jobs + len(jobs)
        return [self.answer] * len(jobs)


async def wear(address: Address, points: int, until: float, answered: list[int], k: int) -> None:
    """Send frames at a steady rate, timed by a clock that the server shares, and count answers."""
    from websockets.asyncio.client import connect
    from websockets.typing import Subprotocol

    opening = connect(address.websocket, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None)
    async with opening as socket:
        await socket.send(write_message(Hello(1, points=DEVICES)))

        async def listen() -> None:
            async for received in socket:
                if isinstance(received, bytes):
                    read_pose(received, points)
                    answered[k] += 1

        listening = asyncio.create_task(listen())
        sequence = 0
        while time.monotonic() < until:
            await socket.send(write_signal(signal(sequence, time.monotonic())))
            sequence += 1
            await asyncio.sleep(1 / RATE)
        listening.cancel()


@pytest.mark.slow
@pytest.mark.parametrize(("wearers", "load"), LOADS)
def test_an_overloaded_server_answers_every_wearer_evenly(
    server_of: Serving, connect: Connecting, monkeypatch: pytest.MonkeyPatch, wearers: int, load: float
) -> None:
    slow, decoded = SlowStep(load / (wearers * RATE)), []
    monkeypatch.setattr(scheduler, "complete", slow)
    monkeypatch.setattr(session, "read_signal", lambda *given: decoded.append(None) or read_signal(*given))
    server = server_of()
    points = len(connect(server).welcome["points"])
    answered = [0] * wearers
    until = time.monotonic() + SECONDS

    async def everybody() -> None:
        await asyncio.gather(*(wear(server, points, until, answered, k) for k in range(wearers)))

    client = threading.Thread(target=lambda: asyncio.run(everybody()))
    client.start()
    client.join(60)
    total = sum(answered)
    assert total >= slow.jobs - 2 * wearers  # except for jobs that ran when the wearers left
    assert slow.busy >= 0.8 * (slow.ended - slow.begun)  # of the time in which the tracker could step
    assert max(answered) - min(answered) <= 0.1 * max(answered) + 1
    assert min(answered) >= 0.8 / load * RATE * SECONDS  # of 20 wearers on a machine that bears 10, 40 % each
    assert len(decoded) <= total + 2 * wearers  # of four frames three are replaced before they are decoded
    assert np.median(slow.late) < 2 / RATE  # the newest frame, although each waits for a step of all


def test_a_frame_replaces_a_queued_one_and_texts_keep_their_order() -> None:
    queue = NewestFrames()
    for item in (
        {"bytes": b"1"},
        {"bytes": b"2"},
        {"text": "a"},
        {"text": "b"},
        {"bytes": b"3"},
        {"bytes": b"4"},
        {"bytes": b"5"},
        {"type": "websocket.disconnect"},
    ):
        queue.put_nowait({"type": "websocket.receive", **item})
    found: list[dict[str, Any]] = [queue.get_nowait() for _ in range(queue.qsize())]
    assert [item.get("bytes") or item.get("text") for item in found] == [b"2", "a", "b", b"5", None]
    assert [item.get(SKIPPED, 0) for item in found] == [1, 0, 0, 2, 0]
