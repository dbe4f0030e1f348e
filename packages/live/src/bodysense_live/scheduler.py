"""Steps all sessions that have a new frame, together.

Bodies are completed in one thread, so that the event loop stays free; sessions are touched by the event loop alone.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, Protocol, TypeVar

from bodysense.observation import Estimate
from bodysense_live.answer import Answer, CompletionJob
from bodysense_live.estimation import PipelineState, step_many
from bodysense_live.session import Session


class Stepped(Protocol):
    """Who is stepped."""

    session: Session


Who = TypeVar("Who", bound=Stepped)


class Scheduler(Generic[Who]):
    """`deliver(who, answer)` is called with every answer, with None where a frame came to nothing."""

    def __init__(self, deliver: Callable[[Who, Answer | None], None]) -> None:
        self._deliver = deliver
        self._ready: dict[Who, None] = {}  # in order of arrival
        self._wake = asyncio.Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="tracker")

    def ready(self, who: Who) -> None:
        """There is a new frame."""
        if who.session.is_ready:
            self._ready[who] = None
            self._wake.set()

    async def run(self) -> None:
        """Step until cancelled."""
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._ready:
                    those, self._ready = list(self._ready), {}
                    await self._step(those)
        finally:
            self._thread.shutdown(wait=False, cancel_futures=True)

    def _job(self, who: Who) -> CompletionJob | None:
        """The job of one session; one that fails touches no other."""
        try:
            return who.session.job()
        except Exception:  # whatever it was, the others go on
            who.session.abandon()
            self._deliver(who, None)
            return None

    async def _step(self, those: Sequence[Who]) -> None:
        jobs = [(who, job) for who in those if (job := self._job(who)) is not None]
        if not jobs:
            return
        loop = asyncio.get_running_loop()
        found = await loop.run_in_executor(self._thread, completed, [job for _, job in jobs])
        for (who, job), result in zip(jobs, found, strict=True):
            if result is None:
                who.session.abandon()
                self._deliver(who, None)
            else:
                self._deliver(who, who.session.answer(job, *result))
            self.ready(who)  # a newer frame may have come meanwhile


def completed(jobs: Sequence[CompletionJob]) -> list[tuple[Estimate, PipelineState] | None]:
    """Estimate and state of every job; None for one that failed, which touches no other."""
    try:
        return list(step_many([(job.pipeline, job.observation, job.state) for job in jobs]))
    except Exception:  # of one of them: whatever it was, the others go on
        return [None] if len(jobs) == 1 else [found for job in jobs for found in completed([job])]
