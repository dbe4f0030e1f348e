"""Work on clips, or anything else, in several processes, results in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


def spread(work: Callable[[Item], Result], clips: Iterable[Item], jobs: int) -> Iterator[tuple[Item, Result]]:
    """Every clip with what `work` made of it, in order, from `jobs` processes (1: this one).

    `work` must pickle. No more than a few clips wait in memory.
    """
    if jobs == 1:
        for clip in clips:
            yield clip, work(clip)
        return
    # Spawned, not forked: a fork of a process that has threads (a progress bar, BLAS, PyTorch) can hang.
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting: deque[tuple[Item, Future[Result]]] = deque()
        for clip in clips:
            waiting.append((clip, pool.submit(work, clip)))
            if len(waiting) > 2 * jobs:
                done, future = waiting.popleft()
                yield done, future.result()
        for done, future in waiting:
            yield done, future.result()
