"""What every table's command shares: its progress, and how it hands out the report."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bodysense.files import check_place, make_folder
from bodysense_lab.options import TableOptions

if TYPE_CHECKING:
    from bodysense.io.clip import Clip
    from bodysense_lab.datasets import DataSet
    from bodysense_lab.table import Report
    from bodysense.papers.ik_tracker import IkTrackerSettings


def check_outputs(table: TableOptions) -> None:
    """Refuse outputs that cannot be written, before anything is computed."""
    if table.json is not None:
        check_place(table.json)
    make_folder(table.out)


def open_data(data: str, table: TableOptions) -> DataSet:
    """The data of a table, as the options have it; its outputs are known to be writable."""
    from bodysense_lab.datasets import named_data

    check_outputs(table)
    return named_data(data, table.split, table.quick)


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


def finish(report: Report, table: TableOptions) -> None:
    """Print a report and write its files."""
    from rich.console import Console

    from bodysense_lab.commands.reporting import print_report
    from bodysense.cli.show import write_numbers
    from bodysense_lab.chart import draw_panels
    from bodysense_lab.table import write_csv

    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console = Console(width=120)
    print_report(report, console)
    rows = table.out / f"{report.name}.csv"
    picture = table.out / f"{report.name}.png" if report.panels else None
    write_csv(rows, report)
    if picture is not None:
        draw_panels(picture, report.panels, report.title)
    write_numbers(table.json, report.numbers)
    for path in (rows, picture, table.json):
        if path is not None:
            console.print(f"wrote {path}", highlight=False)


def tracker_settings(half_life: float | None) -> IkTrackerSettings:
    """The settings of UNOC's tracker with another half-life, seconds; None keeps its own."""
    from bodysense.papers.ik_tracker import IkTrackerSettings

    return IkTrackerSettings() if half_life is None else IkTrackerSettings(half_life=half_life)
