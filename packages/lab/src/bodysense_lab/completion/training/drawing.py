"""Drawing of training sequences in worker processes, through a ring of files on disk.

Each worker draws sequences in blocks and writes each block as a file into a free place of the ring. The training reads
the places in turn. A place is free again when its sequences have been played as often as allowed. If the training is
faster than the workers, it plays a block that is still there again, or waits for one that was never played.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, fields
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.files import make_folder, written_beside
from bodysense.parallel import end_with_parent
from bodysense_lab.completion.data.sequences import Sequence

BLOCK, PLACES = 16, 48  # sequences of a file, and files of the ring; together about 350 MB
_POLL = 0.01  # s between two looks for a free place or a new file
_OF_SEQUENCE = ("accuracy", "rest_offset", "certainty", "size", "interval")  # fields without frames

Sampler = Callable[[np.random.Generator], Callable[[], Sequence]]  # generator → function that draws a sequence


@dataclass(frozen=True)
class Drawing:
    """Worker processes that draw sequences."""

    sampler: Sampler  # picklable; called once in each worker
    folder: Path  # of the ring; its contents are removed
    processes: int
    plays: int = 1  # how often a sequence may be played; with 1, each is played once, in a fixed order
    block: int = BLOCK
    places: int = PLACES

    def sequences(self, seed: int) -> Generator[Sequence]:
        """Yield sequences without end. The workers end with the iterator, or with this process."""
        shutil.rmtree(self.folder, ignore_errors=True)
        make_folder(self.folder)
        # Spawned, not forked: a fork of a process that has threads (BLAS, PyTorch) can hang.
        spawned = get_context("spawn").Process
        workers: list[BaseProcess] = [
            spawned(target=_fill, args=(self, seed, one), daemon=True) for one in range(self.processes)
        ]
        for worker in workers:
            worker.start()
        played = dict.fromkeys(range(self.places), 0)
        try:
            while True:
                for place in range(self.places):
                    path = _place(self.folder, place)
                    if not path.is_file() and not self._wait(path, workers):
                        continue
                    sequences = read_block(path)
                    played[place] += 1
                    if played[place] >= self.plays:
                        path.unlink()
                        played[place] = 0
                    yield from sequences
        finally:
            for worker in workers:
                worker.terminate()
            shutil.rmtree(self.folder, ignore_errors=True)

    def _wait(self, path: Path, workers: list[BaseProcess]) -> bool:
        """Wait for a file. Return False if another one may be played again instead.

        Raises BodysenseError if a worker has ended.
        """
        while not path.is_file():
            if self.plays > 1 and any(self.folder.glob("*.npz")):
                return False
            if not all(worker.is_alive() for worker in workers):
                raise BodysenseError("a process that draws sequences has ended; see its message above, and run again")
            time.sleep(_POLL)
        return True


def _fill(drawing: Drawing, seed: int, worker: int) -> None:
    """Draw blocks into the places of a worker, without end."""
    end_with_parent()
    draw = drawing.sampler(np.random.default_rng([seed, worker]))
    while True:
        for place in range(worker, drawing.places, drawing.processes):
            path = _place(drawing.folder, place)
            while path.is_file():
                time.sleep(_POLL)
            write_block(path, [draw() for _ in range(drawing.block)])


def _place(folder: Path, place: int) -> Path:
    return folder / f"{place:04d}.npz"


def write_block(path: Path, sequences: list[Sequence]) -> None:
    """Write sequences without hands as one file, which appears whole."""
    values: dict[str, Any] = {"length": np.array([len(one) for one in sequences])}
    for name in (field.name for field in fields(Sequence) if field.name != "hands"):
        parts = [getattr(one, name) for one in sequences]
        values[name] = np.stack([np.asarray(part) for part in parts]) if name in _OF_SEQUENCE else np.concatenate(parts)
    with written_beside(path) as beside, beside.open("wb") as file:
        np.savez(file, **values)


def read_block(path: Path) -> list[Sequence]:
    """Read the sequences of a file."""
    with np.load(path, allow_pickle=False) as stored:
        values = {name: stored[name] for name in stored.files}
    ends = np.cumsum(values.pop("length"))
    rows = {name: part if name in _OF_SEQUENCE else np.split(part, ends[:-1]) for name, part in values.items()}
    scalars: dict[str, Callable[[Any], Any]] = {"size": float, "interval": float}
    sequences = []
    for k in range(len(ends)):
        own: dict[str, Any] = {name: scalars.get(name, np.asarray)(part[k]) for name, part in rows.items()}
        sequences.append(Sequence(**own))
    return sequences
