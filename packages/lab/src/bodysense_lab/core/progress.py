"""Progress of long work: a bar in a terminal, lines in a log."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import Progress

_EVERY = 15.0  # s between lines of a log
Item = TypeVar("Item")


@contextmanager
def log_progress(what: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
    """Display progress over `total` pieces; yields a function that adds a number of finished pieces.

    Without a terminal a line is printed at the start, every 15 s, and at the end. If several processes share a
    training, only the first one displays progress.
    """
    console = Console(width=None if Console().is_terminal else 200)
    distributed = sys.modules.get("torch.distributed")  # imported already, if PyTorch trains
    shared = distributed is not None and distributed.is_available() and distributed.is_initialized()
    if distributed is not None and shared and distributed.get_rank() > 0:
        yield lambda done: None
        return
    if console.is_terminal:
        with Progress(console=console) as bars:
            bar = bars.add_task(what, total=total)
            yield lambda done: bars.advance(bar, done)
        return
    reached, begun = 0, time.monotonic()
    last = begun

    def advance(done: int) -> None:
        nonlocal reached, last
        reached, now = reached + done, time.monotonic()
        if now >= last + _EVERY or reached >= (total or math.inf):
            last = now
            console.print(_progress_line(what, reached, total, now - begun), highlight=False, markup=False)

    console.print(_progress_line(what, 0, total, 0.0), highlight=False, markup=False)
    yield advance


def with_progress_log(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """Yield the items and display progress over them; `total` is their number."""
    with log_progress(what, total) as advance:
        for item in items:
            yield item
            advance(1)


def _progress_line(what: str, reached: int, total: int | None, seconds: float) -> str:
    count = f"{what}: {reached}" if total is None else f"{what}: {reached}/{total}"
    if not reached:
        return count
    count += f", {seconds:.0f} s"
    if total is None:
        return count
    return f"{count}, {timedelta(seconds=round(max(0, total - reached) * seconds / reached))} remaining"


def read_log(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a training's log; none if there is no file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.is_file() else []
