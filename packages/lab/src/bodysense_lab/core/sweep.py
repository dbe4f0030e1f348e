"""Training of many networks with one command: finished ones are kept, several train in parallel."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, wait
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars

from bodysense.errors import BodysenseError
from bodysense.parallel import worker_pool
from bodysense_lab.core.checkpoint import identity_differences
from bodysense_lab.core.fit import Progress, Report, progress_line, progress_printer
from bodysense_lab.core.progress import read_log

# Train the network of a name, and call a report with its progress. Returns a line about the result.
Train = Callable[[str, Report], str]


def is_trained_as_configured(path: Path, before: str, now: str) -> bool:
    """Return True if identity `before`, of the network in `path`, equals `now`. Raises BodysenseError otherwise."""
    if json.loads(before) != json.loads(now):
        changed = identity_differences(before, now)
        raise BodysenseError(f"{path} is of another configuration ({changed}); give another --out, or those settings")
    return True


def sweep(
    steps: Mapping[str, int],
    train: Train,
    is_trained: Callable[[str], bool],
    logs: Path,
    jobs: int = 1,
    quiet: bool = False,
) -> None:
    """Train the networks that are not trained yet, in order.

    Args:
        steps: number of steps of each network, by name.
        train: trains one network; must be picklable if `jobs` is above 1.
        is_trained: whether a network is trained.
        logs: folder of the logs, NAME.jsonl.
        jobs: networks that train at the same time, each in its own process if above 1.
        quiet: print nothing.

    A terminal displays one bar. Without a terminal each network prints lines of progress.
    """
    todo = [name for name in steps if not is_trained(name)]
    console = Console(quiet=quiet)
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total} steps"))
    with Bars(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console) as bars:
        done = sum(count for name, count in steps.items() if name not in todo)
        bar = bars.add_task("training", total=sum(steps.values()), completed=done)
        if jobs > 1:
            with worker_pool(jobs) as pool:
                waiting = {
                    pool.submit(train, name, discard_progress if console.is_terminal else progress_printer(name))
                    for name in todo
                }
                while waiting:
                    ended, waiting = wait(waiting, timeout=1.0, return_when=FIRST_COMPLETED)
                    lines = {name: read_log(logs / f"{name}.jsonl")[-1:] for name in todo}
                    now = sum(min(steps[name], line["step"]) for name, last in lines.items() for line in last)
                    bars.update(bar, completed=done + now)
                    for future in ended:
                        console.print(future.result(), highlight=False)
            return
        for name in todo:
            bars.update(bar, description=name)

            def report(progress: Progress, name: str = name, before: int = done) -> None:
                if not (progress.terms and console.is_terminal):
                    console.print(f"{name} {progress_line(progress)}", highlight=False, soft_wrap=True)
                pace = f", {progress.steps_per_second:.3g} steps/s" if progress.terms else ""
                bars.update(bar, completed=before + progress.step, description=f"{name}{pace}")

            if not is_trained(name):  # the network on which it depends may be unchanged
                console.print(train(name, report), highlight=False)
            done += steps[name]
            bars.update(bar, completed=done)


def discard_progress(progress: Progress) -> None:
    """Report nothing; the log is read instead."""
