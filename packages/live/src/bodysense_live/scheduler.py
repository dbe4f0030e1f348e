"""The scheduler: steps all sessions that have a new frame, together.

Bodies are completed in one thread, so that the event loop stays free; only the event loop touches sessions.

If frames come faster than they are completed, most are replaced by newer ones. To read a frame costs a tenth of a step,
so clients whose frame waits are not read while others are stepped (`reading`). They are read just before the next
step, and what they sent meanwhile is skipped without being decoded (`newest_frames`).
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, Protocol, TypeVar

from bodysense.estimate import Estimate
from bodysense.io.protocol import ProtocolError
from bodysense_live.answer import Answer, CompletionJob
from bodysense_live.estimation import PipelineState, step_many
from bodysense_live.session import Session

_LOOP_TURNS = 4  # of the event loop: from a socket that may be read again to the newest frame in its session


class HasSession(Protocol):
    """Anything with a session to step."""

    session: Session


Slot = TypeVar("Slot", bound=HasSession)


class Scheduler(Generic[Slot]):
    """Steps sessions until cancelled.

    `deliver(who, answer)` is called with every answer, and with None if a step failed. `refuse(who, error)` is called
    for a frame with a value that no tracker gives, and `stepped(seconds)` after sessions were stepped together.
    """

    def __init__(
        self,
        deliver: Callable[[Slot, Answer | None], None],
        refuse: Callable[[Slot, ProtocolError], None],
        on_stepped: Callable[[float], object],
    ) -> None:
        self._deliver, self._refuse, self._on_stepped = deliver, refuse, on_stepped
        self._ready: dict[Slot, None] = {}  # in order of arrival
        self._wake = asyncio.Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="tracker")
        self.reading = asyncio.Event()  # cleared while sessions are stepped
        self.reading.set()

    def ready(self, slot: Slot) -> None:
        """Step a session soon, if it has a new frame."""
        if slot.session.is_ready:
            self._ready[slot] = None
            self._wake.set()

    async def run(self) -> None:
        """Step until cancelled."""
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._ready:
                    batch, self._ready = list(self._ready), {}
                    self.reading.clear()
                    try:
                        await self._step(batch)
                    finally:
                        self.reading.set()
                    for _ in range(_LOOP_TURNS if self._ready else 0):
                        await asyncio.sleep(0)
        finally:
            self._thread.shutdown(wait=False, cancel_futures=True)

    def _job(self, slot: Slot) -> CompletionJob | None:
        """Return the job of one session; one that fails affects no other."""
        try:
            return slot.session.job()
        except ProtocolError as error:
            self._refuse(slot, error)
            return None
        except Exception:  # whatever it was, the others go on
            slot.session.abandon()
            self._deliver(slot, None)
            return None

    async def _step(self, batch: Sequence[Slot]) -> None:
        jobs = [(slot, job) for slot in batch if (job := self._job(slot)) is not None]
        if not jobs:
            return
        loop = asyncio.get_running_loop()
        begun = loop.time()
        found = await loop.run_in_executor(self._thread, complete, [job for _, job in jobs])
        self._on_stepped(loop.time() - begun)
        for (slot, job), result in zip(jobs, found, strict=True):
            if result is None:
                slot.session.abandon()
                self._deliver(slot, None)
            else:
                self._deliver(slot, slot.session.answer(job, *result))
            self.ready(slot)  # a newer frame may have come meanwhile


def complete(jobs: Sequence[CompletionJob]) -> list[tuple[Estimate, PipelineState] | None]:
    """Return the estimate and state of every job, or None for one that failed, which affects no other."""
    try:
        return list(step_many([(job.pipeline, job.observation, job.state) for job in jobs]))
    except Exception:  # of one of them: whatever it was, the others go on
        return [None] if len(jobs) == 1 else [found for job in jobs for found in complete([job])]
