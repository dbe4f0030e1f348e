"""The scheduler: stepping of many sessions, and failures."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass

import pytest

from bodysense_live.server import scheduler as module
from bodysense_live.server.messages import Pong
from bodysense_live.server.scheduler import Scheduler
from bodysense_live.server.send_queue import SendQueue
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.estimation import step_many
from bodysense_live.sessions.session import Session

from ..conftest import DEVICES, signal


@dataclass(eq=False)
class Wearer:
    session: Session


def wearers(count: int) -> list[Wearer]:
    return [Wearer(Session(DEVICES)) for _ in range(count)]


def run(slots: list[Wearer], frames: int) -> list[tuple[Wearer, Answer | None]]:
    async def go() -> list[tuple[Wearer, Answer | None]]:
        found: list[tuple[Wearer, Answer | None]] = []
        scheduler: Scheduler[Wearer] = Scheduler(
            lambda slot, answer: found.append((slot, answer)), lambda slot, error: None, lambda seconds: None
        )
        task = asyncio.create_task(scheduler.run())
        for k in range(frames):
            for one in slots:
                one.session.receive(signal(k, k / 72), 0.0)
                scheduler.ready(one)
            while len(found) < (k + 1) * len(slots):
                await asyncio.sleep(0.001)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        return found

    return asyncio.run(asyncio.wait_for(go(), 60))


def test_every_session_is_answered() -> None:
    slots = wearers(3)
    found = run(slots, 3)
    for one in slots:
        assert [a.frame.sequence for slot, a in found if slot is one and a is not None] == [0, 1, 2]


def test_a_failing_session_affects_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    slots = wearers(3)
    broken = slots[1].session

    def failing(jobs: list) -> list:
        if any(job[0] is broken._pipeline for job in jobs):
            raise ZeroDivisionError
        return step_many(jobs)

    monkeypatch.setattr(module, "step_many", failing)
    found = run(slots, 2)
    for one in slots:
        answers = [answer for slot, answer in found if slot is one]
        assert len(answers) == 2 and all((a is None) == (one is slots[1]) for a in answers)
    monkeypatch.undo()
    slots[1].session.receive(signal(9, 0.5), 0.0)
    assert slots[1].session.step() is not None


def test_a_send_queue_keeps_the_newest_frame_and_a_limited_number_of_texts() -> None:
    async def go() -> None:
        queue = SendQueue(3)
        assert not queue.put_frames([b"1"]) and queue.put_frames([b"2"])
        for k in range(5):
            queue.put_message(Pong(k))
        assert queue.is_full
        texts, frames = await queue.take()
        assert len(texts) == 3 and list(frames) == [b"2"]
        assert not queue.put_frames([b"3"])

    asyncio.run(go())


def test_steps_count_processor_time_not_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    original, seconds = module.complete, list[float]()

    def slow(jobs: list) -> list:
        time.sleep(0.3)  # as on a machine whose cores others use
        return original(jobs)

    monkeypatch.setattr(module, "complete", slow)

    async def go() -> None:
        scheduler: Scheduler[Wearer] = Scheduler(lambda slot, answer: None, lambda slot, error: None, seconds.append)
        (one,) = wearers(1)
        task = asyncio.create_task(scheduler.run())
        one.session.receive(signal(0, 0.0), 0.0)
        scheduler.ready(one)
        async with asyncio.timeout(10):
            while not seconds:
                await asyncio.sleep(0.01)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(go())
    assert 0 < seconds[0] < 0.2
