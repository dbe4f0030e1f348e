"""Steps all sessions that have a new frame: quick ones together, slow ones one at a time between them.

Estimators run in one thread, so that the event loop stays free; sessions are touched by the event loop alone.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Generic, Protocol, TypeVar

from bodysense.serve.estimation import step_many
from bodysense.serve.session import Answer, Job, Session

QUICK = ("head", "three-point", "hands", "trackers")  # profiles whose sessions are stepped together


class Stepped(Protocol):
    """Who is stepped."""

    session: Session


Who = TypeVar("Who", bound=Stepped)


class Scheduler(Generic[Who]):
    """`deliver(who, answer)` is called with every answer, with None where a frame came to nothing."""

    def __init__(self, deliver: Callable[[Who, Answer | None], None]) -> None:
        self._deliver = deliver
        self._quick: dict[Who, None] = {}  # in order of arrival
        self._slow: dict[Who, None] = {}
        self._wake = asyncio.Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="estimators")

    def ready(self, who: Who) -> None:
        """There is a new frame."""
        if who.session.is_ready:
            (self._quick if who.session.profile in QUICK else self._slow)[who] = None
            self._wake.set()

    async def run(self) -> None:
        """Step until cancelled."""
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._quick or self._slow:
                    quick, self._quick = list(self._quick), {}
                    await self._step(quick)
                    if self._slow:
                        one = next(iter(self._slow))
                        del self._slow[one]
                        await self._step([one])
        finally:
            self._thread.shutdown(wait=False, cancel_futures=True)

    async def _step(self, those: Sequence[Who]) -> None:
        jobs = [(who, job) for who in those if (job := who.session.job()) is not None]
        if not jobs:
            return
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(self._thread, estimated, [job for _, job in jobs])
        for (who, job), result in zip(jobs, found, strict=True):
            if result is None:
                who.session.abandon()
                self._deliver(who, None)
            else:
                self._deliver(who, who.session.answer(job, *result))
            self.ready(who)  # a newer frame may have come meanwhile


def estimated(jobs: Sequence[Job]) -> list[Any]:
    """(Estimate, state) of every job; None for one that failed, which touches no other."""
    try:
        return list(step_many([(job.adaptive, job.observation, job.state) for job in jobs]))
    except Exception:  # of one of them: whatever it was, the others go on
        return [None] if len(jobs) == 1 else [found for job in jobs for found in estimated([job])]
