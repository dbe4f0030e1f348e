"""Tables for the terminal, and one flat object of numbers for machines."""

from __future__ import annotations

import json
import os
import platform
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bodysense.files import written_beside

if TYPE_CHECKING:
    from rich.console import Console

    from bodysense_lab.table import Cell, Report

_WIDTH = 160  # characters of a table that no terminal shows

PARTS = {
    "body": "body",  # shoulders, elbows, hands, hips, knees, feet
    "finger": "fingers",  # from their wrist
    "body_and_finger": "body and fingers",
    "every_point": "all body points",  # pelvis, spine and neck too
}
SHARES = {
    "occluded": "occluded",
    "known": "hidden again",  # and seen earlier in the clip
    "all": "all",
}


def wide_console() -> Console:
    """A console whose tables are not folded to 80 characters where no terminal shows them."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal or "COLUMNS" in os.environ else Console(width=_WIDTH)


def write_numbers(path: Path | None, numbers: dict[str, float]) -> None:
    """Write one flat JSON object, if a path was given; figures that do not exist (not a number) are left out."""
    if path is not None:
        with written_beside(path) as beside:
            told = {name: value for name, value in numbers.items() if np.isfinite(value)}
            beside.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def print_report(report: Report, console: Console) -> None:
    """The table, what it was made of, and what holds of the paper; a first cell that repeats stands once."""
    from rich import box
    from rich.markup import escape
    from rich.padding import Padding
    from rich.table import Table

    shown = Table(title=report.title, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    firsts = [row[0] for row in report.rows]
    for k, column in enumerate(report.columns):
        words = all(isinstance(row[k], str) for row in report.rows)
        shown.add_column(column, justify="left" if words else "right", no_wrap=k == 0)
    before: tuple[Cell, ...] = (None,) * len(report.columns)
    for row in report.rows:
        if before[0] not in (None, row[0]) and len(set(firsts)) < len(firsts):
            shown.add_section()
        repeats = next((k for k, (one, two) in enumerate(zip(row, before, strict=True)) if one != two), len(row))
        cells = ["" if k < repeats else _cell(one, report.digits) for k, one in enumerate(row)]
        shown.add_row(*cells)
        before = row
    console.print(shown)
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


def processor() -> str:
    """Name of the processor, for figures of speed."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()
