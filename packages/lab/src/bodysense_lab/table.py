"""A table as it is handed out: our figures beside the published ones, what they were made of, and what holds.

How far a mean can be trusted: intervals by drawing the people anew, for frames of one person are not independent.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bodysense.files import written_beside
from bodysense_lab.chart import Panel

DRAWS = 2000
SHARE = 0.95  # of the draws lie within an interval


@dataclass(frozen=True)
class Interval:
    """A figure, and between what it lies."""

    value: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """Of a difference of errors: whether it carries."""
        if math.isnan(self.low):
            return "unknown"
        return "none" if self.low <= 0 <= self.high else "worse" if self.value > 0 else "better"


Shares = Mapping[str, tuple[float, float]]  # by person: the mean, and its weight


def interval(of: Shares, minus: Shares | None = None, seed: int = 0) -> Interval:
    """The weighted mean over people, or the difference to that of `minus`, of the same people in each draw.

    Percentiles of `DRAWS` draws of as many people (Efron). With fewer than two people nothing is known: NaN.

    Args:
        of: mean and weight by person.
        minus: what is taken off; people that are not in both are left out.
        seed: random seed.
    """
    people = sorted(of if minus is None else of.keys() & minus.keys())
    if not people:
        return Interval(math.nan, math.nan, math.nan)
    drawn = np.random.default_rng(seed).integers(len(people), size=(DRAWS, len(people)))
    every = np.concatenate([np.arange(len(people))[None], drawn]) if len(people) > 1 else np.zeros((1, 1), dtype=int)
    mean = _means(of, people, every) - (0.0 if minus is None else _means(minus, people, every))
    if len(people) == 1:
        return Interval(float(mean[0]), math.nan, math.nan)
    low, high = np.percentile(mean[1:], (50 * (1 - SHARE), 50 * (1 + SHARE)))
    return Interval(float(mean[0]), float(low), float(high))


def _means(of: Shares, people: list[str], drawn: np.ndarray) -> np.ndarray:
    """Weighted means (K,) of people drawn (K, N)."""
    value, weight = np.array([of[person] for person in people]).T
    return (value * weight)[drawn].sum(axis=1) / weight[drawn].sum(axis=1)


Cell = float | str | None


@dataclass(frozen=True)
class Report:
    """One table. Rows whose first cells agree stand together."""

    name: str  # of its files
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    numbers: dict[str, float] = field(repr=False)  # one flat object
    data: tuple[str, ...] = ()  # sentences: what was used, what was not there
    remarks: tuple[str, ...] = ()  # sentences: which of the paper's orderings hold
    remarks_title: str = "What holds of the paper"
    caption: str = ""  # units and definitions
    digits: int = 1  # behind the point, where the table is printed
    panels: tuple[Panel, ...] = ()  # of its picture


@dataclass(frozen=True)
class Named:
    """A figure and whose it is."""

    name: str
    value: float
    shares: Shares = field(default_factory=dict, repr=False)  # by person, of the figure or of what grows with it


def surely(numbers: Mapping[str, Interval]) -> dict[str, float]:
    """The bounds of figures by their keys: KEY_low, KEY_high."""
    return finite({f"{key}_{end}": getattr(one, end) for key, one in numbers.items() for end in ("low", "high")})


def bounds(one: Interval) -> tuple[Cell, Cell]:
    """Two cells: between what a figure lies; empty where there are fewer than two people."""
    return cell(one.low), cell(one.high)


def finite(numbers: dict[str, float]) -> dict[str, float]:
    """Without what is not a number, for JSON has no word for it."""
    return {key: value for key, value in numbers.items() if math.isfinite(value)}


def cell(value: float) -> float | None:
    """A figure, or an empty cell where there is none."""
    return value if math.isfinite(value) else None


def ordering(claim: str, lower: Named, higher: Sequence[Named], unit: str, digits: int = 2) -> str | None:
    """Whether `lower` lies below all of `higher`, as the paper claims; None where a figure is missing.

    A difference whose interval over people holds 0 is none.
    """
    if not higher or not all(math.isfinite(one.value) for one in (lower, *higher)):
        return None
    none = [one for one in higher if interval(lower.shares, one.shares).verdict == "none"]
    wrong = [one for one in higher if one not in none and not lower.value < one.value]
    shown = ", ".join(f"{one.name} {one.value:.{digits}f}" for one in (lower, *higher))
    verdicts = (("does not hold against", wrong), ("no sure difference to", none))
    verdict = "; ".join(f"{text} {', '.join(one.name for one in ones)}" for text, ones in verdicts if ones) or "holds"
    return f"{claim}: {verdict} ({shown} {unit})."


def write_csv(path: str | Path, report: Report) -> None:
    """The table, unrounded; empty cells where there is no figure."""
    with written_beside(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(report.columns)
        writer.writerows(["" if one is None else one for one in row] for row in report.rows)
