"""Shared parts of the tables' commands: progress and output of reports."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from bodysense.files import check_place, make_folder
from bodysense_lab.core.options import TableOptions

if TYPE_CHECKING:
    from rich.console import Console

    from bodysense_lab.core.table import Cell, Report
    from bodysense_lab.data.datasets import DataSet

Piece = TypeVar("Piece")


def check_places(*paths: Path | None) -> None:
    """Refuse files that cannot be written, before anything is computed."""
    for path in paths:
        if path is not None:
            check_place(path)


def check_outputs(table: TableOptions) -> None:
    """Refuse outputs that cannot be written, before anything is computed."""
    check_places(table.json)
    make_folder(table.out)


def open_data(data: str, table: TableOptions) -> DataSet:
    """Return the data set of a table; refuse outputs that cannot be written."""
    return open_sets((data,), table)[0]


def open_sets(data: Sequence[str], table: TableOptions) -> list[DataSet]:
    """Return the data sets of a table; refuse outputs that cannot be written."""
    from bodysense_lab.data.datasets import open_data_set

    check_outputs(table)
    return [open_data_set(one, table.split, table.quick) for one in data]


@contextmanager
def progress_bar(what: str, total: int | None = None) -> Iterator[Callable[..., None]]:
    """Display progress over `total` pieces; yields a function to call after each.

    Its arguments are the piece or a name, which is displayed, and the number of finished pieces (default 1).
    """
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
        bar = progress.add_task(what, total=total)

        def advance(piece: object = None, done: int = 1) -> None:
            name = piece if isinstance(piece, str) else getattr(piece, "name", "")
            progress.update(bar, advance=done, description=f"{what} {name}".rstrip())

        yield advance


def with_progress_bar(pieces: Iterable[Piece], what: str, total: int) -> Iterator[Piece]:
    """Yield pieces and display progress over them; `total` is their number."""
    with progress_bar(what, total) as advance:
        for piece in pieces:
            yield piece
            advance(piece)


def finish(report: Report, table: TableOptions, data: DataSet | None = None) -> None:
    """Print a report and write its files. With --quick, the numbers have the number of all clips of `data`."""
    from rich.console import Console

    from bodysense.cli.show import write_numbers
    from bodysense_lab.core.table import write_csv
    from bodysense_lab.data.clips import count_clips

    console = Console()
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console = Console(width=120)
    print_report(report, console)
    rows = table.out / f"{report.name}.csv"
    write_csv(rows, report)
    sample = {"quick": 1.0} if table.quick else {}
    if table.quick and data is not None:
        sample["clips_in_split"] = float(count_clips(data.path, data.split))
    write_numbers(table.json, report.numbers | sample)
    for path in (rows, table.json):
        if path is not None:
            console.print(f"wrote {path}", highlight=False)


def show(report: Report, json: Path | None) -> None:
    """Print a report and write its numbers."""
    from bodysense.cli.show import wide_console, write_numbers

    print_report(report, wide_console())
    write_numbers(json, report.numbers)


def print_report(report: Report, console: Console) -> None:
    """Print the table, its data and its remarks; repeated first cells are printed once."""
    from rich import box
    from rich.markup import escape
    from rich.padding import Padding
    from rich.table import Table

    printed = Table(title=report.title, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    firsts = [row[0] for row in report.rows]
    for k, column in enumerate(report.columns):
        words = all(isinstance(row[k], str) for row in report.rows)
        printed.add_column(column, justify="left" if words else "right", no_wrap=k == 0)
    before: tuple[Cell, ...] = (None,) * len(report.columns)
    for row in report.rows:
        if before[0] not in (None, row[0]) and len(set(firsts)) < len(firsts):
            printed.add_section()
        repeats = next((k for k, (one, two) in enumerate(zip(row, before, strict=True)) if one != two), len(row))
        cells = ["" if k < repeats else _cell(one, report.digits) for k, one in enumerate(row)]
        printed.add_row(*cells)
        before = row
    console.print(printed)
    console.print(report.caption, highlight=False, markup=False)
    for heading, lines in (("Data", report.data), (report.remarks_title, report.remarks)):
        if lines:
            console.print(heading, style="bold")
        for line in lines:
            console.print(Padding(escape(line), (0, 0, 0, 2)), highlight=False)


def _cell(value: Cell, digits: int) -> str:
    if value is None or isinstance(value, str):
        return value or ""
    return f"{value:,}" if isinstance(value, int) else f"{value:,.{digits}f}"
