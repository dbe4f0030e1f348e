"""Tables for the terminal, and one flat object of numbers for machines."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bodysense.files import written_beside

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bodysense.lab.table import Cell, Report
    from bodysense.lab.unoc.headset import HeadsetTable

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


def write_numbers(path: Path | None, numbers: dict[str, float]) -> None:
    """Write one flat JSON object, if a path was given; figures that do not exist (not a number) are left out."""
    if path is not None:
        with written_beside(path) as beside:
            told = {name: value for name, value in numbers.items() if np.isfinite(value)}
            beside.write_text(json.dumps(told, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def headset_table(
    table: HeadsetTable,
    title: str,
    parts: Sequence[str] = tuple(PARTS),
    shares: Sequence[str] = tuple(SHARES),
) -> Table:
    """RMSJPE / MPJPE in cm of the better last-known baseline, the network before IK, and the tracker; and the ratio."""
    from rich import box
    from rich.table import Table

    caption = "RMSJPE / MPJPE, cm. Last known: the best of three ways to keep it."
    shown = Table(title=title, caption=caption, box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    numbers = table.numbers()
    suffixes = {"main": "", "sport": "_sport", "dance": "_dance", "other": "_other"}
    present = [group for group, suffix in suffixes.items() if f"body_occluded_rmsjpe_cm{suffix}" in numbers]
    names = ("motion", "part", "joints") if len(present) > 1 else ("part", "joints")
    for column in (*names, "last known", "network", "bodysense", "ratio"):
        shown.add_column(column, justify="left" if column in names else "right", no_wrap=True)
    for group in present:
        suffix = suffixes[group]
        for key, part, share in ((f"{part}_{share}", part, share) for part in parts for share in shares):
            if f"{key}_rmsjpe_cm{suffix}" not in numbers:
                continue
            cells = [
                f"{numbers[f'{who}{key}_rmsjpe_cm{suffix}']:.1f} / {numbers[f'{who}{key}_mpjpe_cm{suffix}']:.1f}"
                for who in ("baseline_", "network_", "")
            ]
            ratio = " / ".join(f"{numbers[f'{key}_{m}_ratio{suffix}']:.2f}" for m in ("rmsjpe", "mpjpe"))
            label = (group, PARTS[part], SHARES[share])[-len(names) :]
            shown.add_row(*label, *cells, ratio)
        shown.add_section()
    return shown


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
