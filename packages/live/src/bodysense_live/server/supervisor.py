"""Supervision of a server's tasks: a server that lost one would look healthy but send no answers."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Callable, Coroutine
from time import monotonic
from typing import Any

STUCK_AFTER = 1.0  # s; a frame that waits longer means that the server is stuck
HOPELESS_AFTER = 10.0  # s; a server that is stuck for longer ends
_CHECK_INTERVAL = 0.5  # s


class Supervisor:
    """The tasks of a server that must run until it stops. If one ends, or no frame is answered, the server ends.

    Args:
        end: called once, with the reason, to end the server.
    """

    def __init__(self, end: Callable[[BaseException], None]) -> None:
        self._end, self._tasks = end, set[asyncio.Task[None]]()
        self._waiting_since: Callable[[], float | None] = lambda: None
        self._report: Callable[[float], None] = lambda seconds: None
        self.failure: BaseException | None = None

    def start(self, coroutine: Coroutine[Any, Any, None]) -> asyncio.Task[None]:
        """Start a task. Cancelling it is the only regular end."""
        task = asyncio.get_running_loop().create_task(coroutine)
        self._tasks.add(task)
        task.add_done_callback(self._done)
        return task

    def watch(self, waiting_since: Callable[[], float | None], report: Callable[[float], None]) -> None:
        """Watch how long frames wait.

        Args:
            waiting_since: returns since when (s, monotonic) the oldest one does, or None.
            report: called once a second while the server is stuck, with the time in s for which the oldest one waits.
        """
        self._waiting_since, self._report = waiting_since, report
        self.start(self._check())

    async def stop(self) -> None:
        """Cancel all tasks, and wait for them."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    @property
    def longest_wait(self) -> float:
        """Time in s for which the oldest frame has waited for its answer."""
        since = self._waiting_since()
        return 0.0 if since is None else monotonic() - since

    @property
    def is_stuck(self) -> bool:
        """Whether a task has ended, or a frame waits for too long."""
        return self.failure is not None or self.longest_wait > STUCK_AFTER

    async def _check(self) -> None:
        reported = 0  # times since a frame waits
        while True:
            await asyncio.sleep(_CHECK_INTERVAL)
            waited = self.longest_wait
            if waited > HOPELESS_AFTER:
                raise TimeoutError(f"no frame was answered for {HOPELESS_AFTER:g} s")
            due = int(waited / STUCK_AFTER)
            if due > reported:
                self._report(waited)
            reported = due

    def _done(self, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        if task.cancelled() or self.failure is not None:
            return
        self.failure = task.exception() or RuntimeError(f"{task.get_coro()} has ended")
        traceback.print_exception(self.failure)
        self._end(self.failure)
