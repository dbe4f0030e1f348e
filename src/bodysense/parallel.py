"""Work in several processes, with results in order."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor  # noqa: TID251 (the pool that the message names)
from contextlib import contextmanager
from functools import partial
from multiprocessing import get_context, parent_process
from queue import Queue
from threading import Thread
from typing import Any, TypeVar

from bodysense.errors import BodysenseError, missing_package

_WAIT = 10.0  # s for a scheduler to answer
Item = TypeVar("Item")
Result = TypeVar("Result")


def parallel_map(
    work: Callable[[Item], Result], clips: Iterable[Item], jobs: int, scheduler: str | None = None
) -> Iterator[tuple[Item, Result]]:
    """Yield every clip with its result of `work`, in order, from `jobs` processes (1: this process).

    `work` must be picklable. Only a few clips wait in memory. `scheduler` is the address of a Dask scheduler whose
    machines do the work instead. Raises BodysenseError if it does not answer.
    """
    if jobs == 1 and scheduler is None:
        for clip in clips:
            yield clip, work(clip)
        return
    with _workers(jobs, scheduler) as (submit, count):
        waiting: deque[tuple[Item, Any]] = deque()
        for clip in clips:
            waiting.append((clip, submit(work, clip)))
            if len(waiting) > 2 * count:
                done, future = waiting.popleft()
                yield done, future.result()
        for done, future in waiting:
            yield done, future.result()


def worker_pool(jobs: int | None, begin: Callable[[], object] | None = None) -> ProcessPoolExecutor:
    """Return a pool of `jobs` processes (None: one for each core) that end with this one; each calls `begin` first."""
    # Spawned, not forked: a fork of a process that has threads (a progress bar, BLAS, PyTorch) can hang.
    return ProcessPoolExecutor(jobs, mp_context=get_context("spawn"), initializer=_begin_worker, initargs=(begin,))


@contextmanager
def _workers(jobs: int, scheduler: str | None) -> Iterator[tuple[Callable[..., Any], int]]:
    """Yield a function that submits work and returns a future, and the number of tasks at a time."""
    if scheduler is None:
        with worker_pool(jobs) as pool:
            yield pool.submit, jobs
        return
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
        cores: Any = client.ncores()
        yield partial(client.submit, pure=False), max(1, sum(cores.values()))


def prefetched(items: Iterable[Item], count: int = 2) -> Iterator[Item]:
    """Yield items that a thread takes from an iterable in advance, up to `count` of them."""
    waiting: Queue[tuple[Item | None, BaseException | None]] = Queue(count)

    def take() -> None:
        try:
            for item in items:
                waiting.put((item, None))
        except BaseException as error:
            waiting.put((None, error))
        else:
            waiting.put((None, StopIteration()))

    Thread(target=take, daemon=True).start()
    while True:
        item, error = waiting.get()
        if isinstance(error, StopIteration):
            return
        if error is not None:
            raise error
        yield item  # type: ignore[misc]


def _begin_worker(begin: Callable[[], object] | None) -> None:
    end_with_parent()
    if begin is not None:
        begin()


def end_with_parent() -> None:
    """End this worker process when its parent ends, because a killed parent does not shut its pool down."""
    parent = parent_process()
    if parent is None:
        raise RuntimeError("end_with_parent: this process is not a worker; call it in a worker process")

    def watch() -> None:
        parent.join()
        os._exit(1)

    Thread(target=watch, daemon=True).start()
