"""Training many networks with one command: what is there is kept, several side by side, one progress bar."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from bodysense.errors import BodysenseError
from bodysense.lab.checkpoint import differences
from bodysense.lab.fit import Progress, Report

# Train the network of this name, telling a report how it goes; returns what to say of it.
Train = Callable[[str, Report], str]


def is_same(path: Path, before: str, now: str) -> bool:
    """True where the network in `path` was trained as asked; both are identities. Raises BodysenseError otherwise."""
    if json.loads(before) != json.loads(now):
        raise BodysenseError(
            f"{path} is of another configuration ({differences(before, now)}); give another --out, or those settings"
        )
    return True


def sweep(
    steps: Mapping[str, int],
    train: Train,
    is_trained: Callable[[str], bool],
    logs: Path,
    jobs: int = 1,
    quiet: bool = False,
) -> None:
    """Train the networks that are not trained, in order, `jobs` at a time; `steps` are of each by its name.

    With several jobs each has a process of its own, and `train` must be picklable; the folder `logs` holds NAME.jsonl.
    """
    todo = [name for name in steps if not is_trained(name)]
    console = Console(quiet=quiet)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
    with Bars(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as bars:
        done = sum(count for name, count in steps.items() if name not in todo)
        bar = bars.add_task("training", total=sum(steps.values()), completed=done)
        if jobs > 1:
            with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
                waiting = {pool.submit(train, name, quietly) for name in todo}
                while waiting:
                    ended, waiting = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
                    bars.update(bar, completed=done + sum(_reached(logs, name, steps[name]) for name in todo))
                    for future in ended:
                        console.print(future.result(), highlight=False)
            return
        for name in todo:
            bars.update(bar, description=name)

            def report(progress: Progress, before: int = done) -> None:
                bars.update(bar, completed=before + progress.step)

            if not is_trained(name):  # what it waits for may have come out as it was
                console.print(train(name, report), highlight=False)
            done += steps[name]
            bars.update(bar, completed=done)


def quietly(progress: Progress) -> None:
    """A report that says nothing: the log is read instead."""


def last_progress(log: Path) -> Progress | None:
    """The last line of a log."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.is_file() else []
    return Progress(**json.loads(lines[-1])) if lines else None


def _reached(logs: Path, name: str, steps: int) -> int:
    last = last_progress(logs / f"{name}.jsonl")
    return 0 if last is None else min(steps, last.step)
