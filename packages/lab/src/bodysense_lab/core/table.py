"""Report of a table: our figures next to published ones, remarks about the data, and the claims that hold."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bodysense.files import written_beside
from bodysense_lab.core.intervals import Interval, NamedFigure, interval

Cell = float | str | None


@dataclass(frozen=True)
class Report:
    """One table. Rows with equal first cells are adjacent."""

    name: str  # of its files
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    numbers: dict[str, float] = field(repr=False)  # one flat object
    data: tuple[str, ...] = ()  # sentences about the data that were used, and missing data
    remarks: tuple[str, ...] = ()  # sentences about the paper's orderings
    remarks_title: str = "What holds of the paper"
    caption: str = ""  # units and definitions
    digits: int = 1  # decimals of the printed table


def interval_bounds(numbers: Mapping[str, Interval]) -> dict[str, float]:
    """Return the finite bounds of figures as KEY_low and KEY_high."""
    return finite({f"{key}_{end}": getattr(one, end) for key, one in numbers.items() for end in ("low", "high")})


def bound_cells(one: Interval) -> tuple[Cell, Cell]:
    """Return the bounds of a figure as two cells, empty for fewer than two people."""
    return cell(one.low), cell(one.high)


def finite(numbers: dict[str, float]) -> dict[str, float]:
    """Drop NaN and infinite figures, which JSON cannot represent."""
    return {key: value for key, value in numbers.items() if math.isfinite(value)}


def cell(value: float) -> float | None:
    """Return a finite figure, or None (an empty cell)."""
    return value if math.isfinite(value) else None


def ordering(claim: str, lower: NamedFigure, higher: Sequence[NamedFigure], unit: str, digits: int = 2) -> str | None:
    """Return a remark on whether `lower` is below all of `higher`, as the paper claims; None if a figure is missing.

    A difference counts only if its interval over people excludes 0.
    """
    if not higher or not all(math.isfinite(one.value) for one in (lower, *higher)):
        return None
    none = [one for one in higher if interval(lower.shares, one.shares).verdict == "none"]
    wrong = [one for one in higher if one not in none and not lower.value < one.value]
    figures = ", ".join(f"{one.name} {one.value:.{digits}f}" for one in (lower, *higher))
    verdicts = (("does not hold against", wrong), ("no sure difference to", none))
    verdict = "; ".join(f"{text} {', '.join(one.name for one in ones)}" for text, ones in verdicts if ones) or "holds"
    return f"{claim}: {verdict} ({figures} {unit})."


def write_csv(path: str | Path, report: Report) -> None:
    """Write the table, unrounded; cells without a figure are empty."""
    write_rows(path, report.columns, report.rows)


def write_rows(path: str | Path, columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    """Write rows as CSV below the names of their columns; None is an empty cell."""
    with written_beside(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(rows)
