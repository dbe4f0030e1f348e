"""Tables of scores: places × methods × figures, next to published figures, from one dictionary of errors.

A `ScoreTable` defines a table of a paper. `score_report` turns it and the scores into rows, numbers and remarks.
A *place* is a row of the table, such as a part of the body.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bodysense_lab.core.intervals import NamedFigure
from bodysense_lab.core.scoring import GROUPS, Measure, Tally, suffix_of
from bodysense_lab.core.table import Cell, Report, bound_cells, cell, finite, interval_bounds, ordering
from bodysense_lab.data.datasets import Census

At = Any  # key of a place: a text, or a tuple of texts
# Errors by group of categories, place, method and measure.
Cells = Mapping[tuple[str, Any, str, str], Tally]
Labels = str | tuple[str, ...]  # one label, or one for each of several columns


@dataclass(frozen=True)
class ScoreColumn:
    """A figure of every place and method.

    `key` is its name in the flat object, with `{method}` and `{place.key}`; the group is appended unless it is the main
    one.
    """

    heading: str
    measure: str
    average: Literal["mpjpe", "rmsjpe", "count"] = "mpjpe"
    key: str | None = None
    bounded: bool = False  # whether the flat object contains its bounds


@dataclass(frozen=True)
class ScoreRow:
    """A place: its labels in the table, and its name in keys; places without a key are not in the flat object."""

    label: Labels
    key: str | None = ""
    ending: str = ""


@dataclass(frozen=True)
class Published:
    """Published figures as columns of a table: for each place and method, a number or None for each heading."""

    headings: tuple[str, ...]
    cells: Mapping[tuple[At, str], Sequence[float | None]]


@dataclass(frozen=True)
class Compared:
    """One of the figures of a claim, and its name in the remark."""

    name: str
    place: At
    method: str
    figure: int = 0


@dataclass(frozen=True)
class Claim:
    """A claim that one figure is smaller than others."""

    text: str
    lower: Compared
    higher: tuple[Compared, ...]


def claim(text: str, names: Mapping[str, str], place: At, lower: str, *higher: str, figure: int = 0) -> Claim:
    """Return the claim that method `lower` has a smaller figure than methods `higher` at a place.

    `names` has the names of the methods in the remark.
    """
    one, *others = (Compared(names[method], place, method, figure) for method in (lower, *higher))
    return Claim(text, one, tuple(others))


@dataclass(frozen=True)
class ScoreTable:
    """Definition of a table of scores."""

    name: str
    title: str
    axes: tuple[str, ...]  # headings of the labels of places, then of methods
    places: Mapping[At, ScoreRow]
    methods: Mapping[str, Labels]
    figures: tuple[ScoreColumn, ...]
    caption: str
    published: tuple[Published, ...] = ()
    claims: tuple[Claim, ...] = ()
    rows: tuple[At, ...] | None = None  # places of the rows; None: all
    bounded: int | None = None  # index of the figure whose bounds are two columns
    groups: tuple[str, ...] = GROUPS[1:]  # groups that have a column if their motion was scored
    of_groups: tuple[int, str] = (0, "{} RMSJPE")  # figure and heading of these columns
    change_from: str | None = None  # method relative to which changes of the first figure are listed
    published_rows: bool = False  # whether rows with only published figures are kept, at the end of a place
    unit: str = "cm"  # of the claims
    digits: int = 1  # decimals of printed figures


def pairs(text: str) -> list[tuple[float, ...]]:
    """Parse published figures: "5.9/4.0 4.3/3.1" gives (5.9, 4.0) and (4.3, 3.1)."""
    return [tuple(map(float, pair.split("/"))) for pair in text.split()]


def score_report(
    table: ScoreTable,
    scores: Cells,
    census: Census | None,
    data: tuple[str, ...],
    remarks: Iterable[str] = (),
    numbers: Mapping[str, float] | None = None,
    remarks_title: str = "What holds of the paper",
) -> Report:
    """Return the report of a table of scores.

    Args:
        table: definition of the table.
        scores: errors by group, place, method and measure.
        census: amount of motion, for the flat object.
        data: sentences about the motion.
        remarks: sentences after those of the claims.
        numbers: more numbers for the flat object.
        remarks_title: heading of the remarks.
    """
    of_groups = table.figures[table.of_groups[0]]
    with_motion = {group for (group, _, _, measure), one in scores.items() if measure == of_groups.measure if one.count}
    groups = [group for group in table.groups if group in with_motion]
    low = () if table.bounded is None else (f"{table.figures[table.bounded].heading} low", "high")
    change = ("change, %", "UNOC's change, %") if table.change_from else ()
    return Report(
        name=table.name,
        title=table.title,
        columns=(
            *table.axes,
            *(one.heading for one in table.figures),
            *low,
            *(heading for one in table.published for heading in one.headings),
            *change,
            *(table.of_groups[1].format(group.replace("_", " ")) for group in groups),
        ),
        rows=tuple(_rows(table, scores, groups)),
        numbers=flat_numbers(table, scores) | dict(numbers or {}) | ({} if census is None else census.numbers()),
        data=data,
        remarks=(*_verdicts(table, scores), *remarks),
        remarks_title=remarks_title,
        caption=table.caption,
        digits=table.digits,
    )


def flat_numbers(table: ScoreTable, scores: Cells) -> dict[str, float]:
    """Return the finite figures by their keys, with bounds as KEY_low and KEY_high."""
    numbers: dict[str, float] = {}
    for (group, place, method, measure), tally in scores.items():
        where = table.places.get(place)
        if where is None or where.key is None:
            continue
        for figure in table.figures:
            if figure.measure == measure and figure.key is not None:
                key = figure.key.format(method=method, place=where) + suffix_of(group)
                numbers[key] = getattr(tally, figure.average)
                if figure.bounded:
                    numbers |= interval_bounds({key: tally.interval(_averaged(figure))})
    return finite(numbers)


def _value(figure: ScoreColumn, scores: Cells, place: At, method: str, group: str = "main") -> float:
    tally = scores.get((group, place, method, figure.measure))
    if tally is not None and figure.average == "count":
        return int(tally.count)
    return math.nan if tally is None else getattr(tally, figure.average)


def _rows(table: ScoreTable, scores: Cells, groups: Sequence[str]) -> Iterator[tuple[Cell, ...]]:
    of_groups = table.figures[table.of_groups[0]]
    found: dict[str, list[tuple[bool, tuple[Cell, ...]]]] = {}  # by the first label
    for place in table.places if table.rows is None else table.rows:
        for method, label in table.methods.items():
            ours = [cell(_value(figure, scores, place, method)) for figure in table.figures]
            published = [one.cells.get((place, method), (None,) * len(one.headings)) for one in table.published]
            has_ours = any(v is not None and one.average != "count" for one, v in zip(table.figures, ours, strict=True))
            has_published = table.published_rows and any(row[0] is not None for row in published)
            if not has_ours and not has_published:
                continue
            row = [*_labels(table.places[place].label), *_labels(label), *ours]
            if table.bounded is not None:
                figure = table.figures[table.bounded]
                tally = scores.get(("main", place, method, figure.measure), Tally())
                row += bound_cells(tally.interval(_averaged(figure)))
            row += [value for values in published for value in values]
            if table.change_from is not None:
                row += _changes(table, scores, place, method)
            row += [cell(_value(of_groups, scores, place, method, group)) for group in groups]
            found.setdefault(str(row[0]), []).append((not has_ours, tuple(row)))
    for rows in found.values():
        yield from (row for _, row in sorted(rows, key=lambda one: one[0]))


def _averaged(figure: ScoreColumn) -> Measure:
    return "rmsjpe" if figure.average == "rmsjpe" else "mpjpe"


def _labels(label: Labels) -> tuple[str, ...]:
    return (label,) if isinstance(label, str) else label


def _changes(table: ScoreTable, scores: Cells, place: At, method: str) -> list[Cell]:
    """Return the changes in % of the first figure, ours and the published one, relative to method `change_from`."""
    start, changes = str(table.change_from), list[Cell]()
    ours = [_value(table.figures[0], scores, place, one) for one in (method, start)]
    theirs = [table.published[0].cells.get((place, one), (None,))[0] for one in (method, start)]
    for now, before in (ours, theirs):
        changes.append(cell(100 * (now / before - 1)) if now is not None and before else None)
    return changes


def _verdicts(table: ScoreTable, scores: Cells) -> Iterator[str]:
    """Yield a remark on whether each claim holds; claims about missing figures are omitted."""

    def named(one: Compared) -> NamedFigure:
        figure = table.figures[one.figure]
        tally = scores.get(("main", one.place, one.method, figure.measure), Tally())
        return tally.named(one.name, _averaged(figure))

    for claim in table.claims:
        verdict = ordering(claim.text, named(claim.lower), [named(one) for one in claim.higher], table.unit)
        if verdict is not None:
            yield verdict
