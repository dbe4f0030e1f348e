"""The scheduler: steps all sessions with a new frame together.

A thread completes bodies, so that the event loop stays free. Only the event loop accesses sessions.

If frames arrive faster than they are completed, most are replaced by newer ones. Reading a frame costs a tenth of a
step, so clients with a pending frame are not read while sessions are stepped (`reading`). They are read just before the
next step, and all but their newest frame are skipped without being decoded (`newest_frames`).
"""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from time import monotonic, thread_time
from typing import Generic, Protocol, TypeVar

from bodysense.io.formats.protocol import ProtocolError
from bodysense.tracking.estimate import Estimate
from bodysense_live.sessions.answer import Answer, CompletionJob
from bodysense_live.sessions.estimation import PipelineState, step_many
from bodysense_live.sessions.session import Session

_LOOP_TURNS = 4  # of the event loop, from a readable socket to the newest frame in its session


class HasSession(Protocol):
    """An object with a session to step."""

    session: Session


Slot = TypeVar("Slot", bound=HasSession)


class Scheduler(Generic[Slot]):
    """A task that steps sessions.

    Args:
        deliver: called with a slot and its answer, or None if the step failed.
        refuse: called with a slot and the reason for which its client must be closed: a frame with an invalid value,
            or a failure to deliver.
        on_stepped: called with the processor time in s that a common step took.
    """

    def __init__(
        self,
        deliver: Callable[[Slot, Answer | None], None],
        refuse: Callable[[Slot, ProtocolError], None],
        on_stepped: Callable[[float], object],
    ) -> None:
        self._deliver, self._refuse, self._on_stepped = deliver, refuse, on_stepped
        self._ready: dict[Slot, float] = {}  # in order of arrival: since when (s) each has a frame
        self._stepping: list[Slot] = []  # whose frames are being completed
        self._stepping_since: float | None = None  # s, when the oldest frame arrived that is being completed
        self._wake = asyncio.Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="tracker")
        self.reading = asyncio.Event()  # cleared while sessions are stepped
        self.reading.set()

    def ready(self, slot: Slot) -> None:
        """Schedule a step of a session, if it has a new frame."""
        if slot.session.is_ready:
            self._ready.setdefault(slot, monotonic())
            self._wake.set()

    @property
    def waiting_since(self) -> float | None:
        """Since when (s, of `time.monotonic`) the oldest frame waits for its answer; None if none does."""
        waiting = [*self._ready.values(), *([] if self._stepping_since is None else [self._stepping_since])]
        return min(waiting, default=None)

    @property
    def waiting(self) -> set[Slot]:
        """The slots whose frames wait for their answer."""
        return {*self._ready, *self._stepping}

    async def run(self) -> None:
        """Step until cancelled."""
        try:
            while True:
                await self._wake.wait()
                self._wake.clear()
                while self._ready:
                    batch, self._stepping_since = list(self._ready), min(self._ready.values())
                    self._ready, self._stepping = {}, batch
                    self.reading.clear()
                    try:
                        await self._step(batch)
                    finally:
                        self.reading.set()
                        self._stepping, self._stepping_since = [], None
                    for _ in range(_LOOP_TURNS if self._ready else 0):
                        await asyncio.sleep(0)
        finally:
            self._thread.shutdown(wait=False, cancel_futures=True)

    def _job(self, slot: Slot) -> CompletionJob | None:
        """Return the job of one session. A failure does not affect other sessions."""
        try:
            return slot.session.job()
        except ProtocolError as error:
            self._refuse(slot, error)
        except Exception:  # any failure; other sessions continue
            traceback.print_exc()
            self._finish(slot, None)
        return None

    async def _step(self, batch: Sequence[Slot]) -> None:
        jobs = [(slot, job) for slot in batch if (job := self._job(slot)) is not None]
        if not jobs:
            return
        loop = asyncio.get_running_loop()
        found, seconds = await loop.run_in_executor(self._thread, _timed, [job for _, job in jobs])
        self._on_stepped(seconds)
        for (slot, job), result in zip(jobs, found, strict=True):
            self._finish(slot, None if result is None else (job, *result))
            self.ready(slot)  # a newer frame may have arrived meanwhile

    def _finish(self, slot: Slot, done: tuple[CompletionJob, Estimate, PipelineState] | None) -> None:
        """Deliver a session's answer; reset it if its step failed. A failure does not affect other sessions."""
        try:
            answer = None if done is None else slot.session.answer(*done)
        except Exception:
            traceback.print_exc()
            done = answer = None
        try:
            if done is None:
                slot.session.abandon()
            self._deliver(slot, answer)
        except Exception:
            traceback.print_exc()
            self._refuse(slot, ProtocolError("the server failed to answer this session; connect again", 1011))


def _timed(jobs: Sequence[CompletionJob]) -> tuple[list[tuple[Estimate, PipelineState] | None], float]:
    """Return the results of `complete`, and the processor time in s of this thread."""
    begun = thread_time()
    return complete(jobs), thread_time() - begun


def complete(jobs: Sequence[CompletionJob]) -> list[tuple[Estimate, PipelineState] | None]:
    """Return estimate and state of every job, or None for a job that failed. A failure does not affect other jobs."""
    try:
        return list(step_many([(job.pipeline, job.observation, job.state) for job in jobs]))
    except Exception:  # any failure of one job; other jobs are stepped again, each alone
        if len(jobs) == 1:
            traceback.print_exc()
        return [None] if len(jobs) == 1 else [found for job in jobs for found in complete([job])]
