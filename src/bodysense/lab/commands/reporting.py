"""What every table's command shares: its options, its progress, and how it hands out the report."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from bodysense.files import check_place, make_folder
from bodysense.lab.options import check_positive

if TYPE_CHECKING:
    from bodysense.io.clip import Clip
    from bodysense.lab.datasets import DataSet
    from bodysense.lab.table import Report
    from bodysense.lab.unoc.ik_tracker import IkTrackerSettings


@dataclass(frozen=True)
class Common:
    """What every table asks for."""

    split: Literal["train", "val", "test", "all"] = "test"
    """people to score"""
    quick: bool = False
    """Only the first seconds of a few clips, in under a minute; the table says what was left out."""
    jobs: int | None = None
    """Processes; all processors by default."""
    out: Path = Path("bodysense-tables")
    """Folder for the table as CSV and as a picture (PNG)."""
    json: Path | None = None
    """Write the numbers here, as one flat object."""


def checked(common: Common, stride: int = 1) -> int:
    """Refuse what cannot work before anything is computed; the number of processes."""
    check_positive(jobs=common.jobs, stride=stride)
    if common.json is not None:
        check_place(common.json)
    make_folder(common.out)
    return common.jobs or os.cpu_count() or 1


@contextmanager
def progress_over(sets: list[DataSet]) -> Iterator[Callable[[Clip], None]]:
    """A progress bar over the clips of data sets; gives what is to be told of each clip that is done."""
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TimeRemainingColumn()) as progress:
        bar = progress.add_task("scoring", total=sum(data.count() for data in sets))
        yield lambda clip: progress.update(bar, advance=1, description=f"scored {clip.name}")


def finish(report: Report, common: Common) -> None:
    """Print a report and write its files."""
    from rich.console import Console

    from bodysense.cli.show import print_report, write_numbers
    from bodysense.lab.chart import draw_panels
    from bodysense.lab.table import write_csv

    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console = Console(width=120)
    print_report(report, console)
    table = common.out / f"{report.name}.csv"
    picture = common.out / f"{report.name}.png" if report.panels else None
    write_csv(table, report)
    if picture is not None:
        draw_panels(picture, report.panels, report.title)
    write_numbers(common.json, report.numbers)
    for path in (table, picture, common.json):
        if path is not None:
            console.print(f"wrote {path}", highlight=False)


def tracker_settings(half_life: float | None) -> IkTrackerSettings:
    """The settings of UNOC's tracker with another half-life, seconds; None keeps its own."""
    from bodysense.lab.unoc.ik_tracker import IkTrackerSettings

    return IkTrackerSettings() if half_life is None else IkTrackerSettings(half_life=half_life)
