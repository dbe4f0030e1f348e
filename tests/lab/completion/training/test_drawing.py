"""Worker processes that draw sequences: files of the ring, order, repeated plays, workers that end."""

from __future__ import annotations

import itertools
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from drawn_sequences import failing, numbered

from bodysense.errors import BodysenseError
from bodysense.parallel import prefetched
from bodysense_lab.completion.data.sequences import Sequence
from bodysense_lab.completion.training import drawing as drawing_module
from bodysense_lab.completion.training.drawing import Drawing, read_block, write_block
from bodysense_lab.completion.training.packaged import packaged_sampler


def test_a_block_is_read_as_it_was_written(tmp_path: Path) -> None:
    draw = packaged_sampler(np.random.default_rng(3))
    sequences = [draw() for _ in range(3)]
    write_block(tmp_path / "a.npz", sequences)
    for before, after in zip(sequences, read_block(tmp_path / "a.npz"), strict=True):
        for one in fields(Sequence):
            value, again = getattr(before, one.name), getattr(after, one.name)
            assert type(value) is type(again), one.name
            np.testing.assert_array_equal(again, value)


class Worker(threading.Thread):
    """A worker in a thread, which ends with its first block after `terminate`."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.lock, self.is_ended = threading.Lock(), False

    def run(self) -> None:
        with suppress(Ended, SystemExit):
            super().run()

    def terminate(self) -> None:
        with self.lock:
            self.is_ended = True


class Ended(Exception):
    """A worker was terminated."""


@pytest.fixture
def workers_in_threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Draw in threads: each process would import PyTorch."""
    workers: list[Worker] = []

    def started(**given: Any) -> Worker:
        workers.append(Worker(**given))
        return workers[-1]

    def write(path: Path, sequences: list[Sequence]) -> None:
        worker = threading.current_thread()
        assert isinstance(worker, Worker)
        with worker.lock:
            if worker.is_ended:
                raise Ended
            write_block(path, sequences)

    monkeypatch.setattr(drawing_module, "get_context", lambda method: SimpleNamespace(Process=started))
    monkeypatch.setattr(drawing_module, "end_with_parent", lambda: None)
    monkeypatch.setattr(drawing_module, "write_block", write)
    yield
    for worker in workers:
        worker.join(10)
        assert not worker.is_alive()


@pytest.mark.usefixtures("workers_in_threads")
def test_each_sequence_is_played_once_in_a_fixed_order(tmp_path: Path) -> None:
    """Two workers take turns by block. The order does not depend on their speed."""
    runs = []
    for name in ("first", "second"):
        drawn = Drawing(numbered, tmp_path / name, processes=2, block=3, places=4).sequences(5)
        runs.append([(one.size, one.interval) for one in itertools.islice(drawn, 30)])
        drawn.close()
    assert runs[0] == runs[1] and len({size for size, _ in runs[0]}) == 30
    counts = [interval for _, interval in runs[0]]
    assert counts[:12] == [1, 2, 3, 1, 2, 3, 4, 5, 6, 4, 5, 6], "a block of each worker in turn"
    assert not (tmp_path / "second").exists()
    other = Drawing(numbered, tmp_path / "other", processes=2, block=3, places=4).sequences(6)
    assert (next(other).size, 1.0) != runs[0][0]
    other.close()


@pytest.mark.usefixtures("workers_in_threads")
def test_sequences_are_played_again_while_workers_are_slower(tmp_path: Path) -> None:
    def slowly(rng: np.random.Generator) -> Callable[[], Sequence]:
        draw = numbered(rng)

        def wait_and_draw() -> Sequence:
            time.sleep(0.02)
            return draw()

        return wait_and_draw

    drawn = Drawing(slowly, tmp_path / "ring", processes=1, plays=3, block=2, places=3).sequences(1)
    played = Counter(one.size for one in itertools.islice(drawn, 60))
    drawn.close()
    assert max(played.values()) <= 3 and len(played) < 60


def test_a_worker_is_a_process_of_its_own(tmp_path: Path) -> None:
    drawn = Drawing(numbered, tmp_path / "ring", processes=1, block=3, places=2).sequences(5)
    draw = numbered(np.random.default_rng([5, 0]))
    assert [one.size for one in itertools.islice(drawn, 7)] == [draw().size for _ in range(7)]
    drawn.close()
    assert not (tmp_path / "ring").exists()


@pytest.mark.usefixtures("workers_in_threads")
def test_a_worker_that_ends_is_reported(tmp_path: Path) -> None:
    drawn = Drawing(failing, tmp_path / "ring", processes=1).sequences(1)
    with pytest.raises(BodysenseError, match="a process that draws sequences has ended"):
        next(drawn)


def test_items_are_prefetched_in_order_and_errors_pass() -> None:
    taken: list[int] = []

    def items():
        for k in range(6):
            taken.append(k)
            yield k
        raise ValueError("over")

    source = prefetched(items(), 2)
    assert next(source) == 0
    deadline = time.monotonic() + 5
    while len(taken) < 4 and time.monotonic() < deadline:
        time.sleep(0.01)
    assert taken == [0, 1, 2, 3], "two wait, and one more is held"
    assert list(itertools.islice(source, 5)) == [1, 2, 3, 4, 5]
    with pytest.raises(ValueError, match="over"):
        next(source)
    assert list(prefetched([1, 2])) == [1, 2]
