"""Work on clips, or anything else, in several processes, results in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

from bodysense.errors import BodysenseError, missing_package

_WAIT = 10.0  # s for a scheduler to answer
Item = TypeVar("Item")
Result = TypeVar("Result")


def spread(
    work: Callable[[Item], Result], clips: Iterable[Item], jobs: int, scheduler: str | None = None
) -> Iterator[tuple[Item, Result]]:
    """Every clip with what `work` made of it, in order, from `jobs` processes (1: this one).

    `work` must pickle. No more than a few clips wait in memory. `scheduler` is the address of a Dask scheduler whose
    machines do the work instead.
    """
    if scheduler is not None:
        yield from _on_machines(work, clips, scheduler)
        return
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


def _on_machines(
    work: Callable[[Item], Result], clips: Iterable[Item], scheduler: str
) -> Iterator[tuple[Item, Result]]:
    try:
        from distributed import Client
    except ImportError as error:
        raise missing_package(error) from None
    try:
        client = Client(scheduler, timeout=_WAIT)
    except (OSError, ValueError):
        raise BodysenseError(
            f"--scheduler {scheduler}: no Dask scheduler answers; `dask scheduler` prints its address"
        ) from None
    with client:
        waiting = [(clip, client.submit(work, clip, pure=False)) for clip in clips]
        for clip, future in waiting:
            yield clip, future.result()
