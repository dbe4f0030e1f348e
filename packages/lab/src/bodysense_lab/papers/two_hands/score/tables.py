"""Two-hands, Tables 3 and 4: errors of hidden markers and of finger joints, next to the published figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from bodysense_lab.core.intervals import interval
from bodysense_lab.core.table import Cell, Report, cell, finite, ordering
from bodysense_lab.data.datasets import describe_data
from bodysense_lab.papers.two_hands.score.foreign import ALONE, FEW_MANY, PLACES, WAYS, foreign_numbers
from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED
from bodysense_lab.papers.two_hands.score.scores import SEEDS, STRIDE, SYNTHETIC_SECONDS, GloveTable
from bodysense_lab.papers.two_hands.trials import DURATIONS, HIDDEN

METHODS = {
    "lk": "last known",
    "ls": "last shape of the hand",
    "ma": "moving average",
    "ac": "affine combination",
    "nn": "network",
}
PUBLISHED_MARKERS = {  # cm, by duration; those of LK and MA are of any number of markers
    **{("lk", n): (1.54, 2.58, 4.43, 5.15, 8.06) for n in HIDDEN},
    **{("ma", n): (2.23, 4.28, 9.99, 20.19, 44.28) for n in HIDDEN},
    ("ac", 1): (0.97, 1.54, 2.42, 2.92, 3.67),
    ("ac", 2): (1.06, 1.69, 2.61, 3.47, 4.12),
    ("ac", 3): (1.22, 1.96, 2.95, 3.65, 4.52),
    ("ac", 4): (1.66, 2.68, 4.06, 5.34, 5.45),
    ("nn", 1): (0.56, 0.84, 1.19, 1.46, 2.09),
    ("nn", 2): (0.60, 0.91, 1.33, 1.57, 2.08),
    ("nn", 3): (0.68, 1.03, 1.48, 1.81, 2.32),
    ("nn", 4): (0.79, 1.20, 1.78, 2.14, 2.72),
}
PUBLISHED_POINTS = {  # cm, by duration
    1: (0.11, 0.14, 0.17, 0.19, 0.29),
    2: (0.17, 0.23, 0.29, 0.35, 0.41),
    3: (0.26, 0.36, 0.48, 0.57, 0.79),
    4: (0.38, 0.55, 0.79, 0.89, 1.32),
}
PUBLISHED_STILL = {"ik": 1.87, "ik_tuned": 1.08, "nn": 0.07}  # cm, nothing hidden
_STILL = {"ik": "CCD, no limits", "ik_tuned": "CCD, tuned limits", "nn": "network"}
_STILL_KEYS = {"nn": "nn_0"}  # in the flat object, if another than the method's


_NONE = (None,) * len(DURATIONS)


@dataclass(frozen=True)
class GloveLine:
    """A row of a table: a method with some number of hidden markers, by duration."""

    method: str
    name: str  # of the method
    hidden: int
    published: tuple[float | None, ...]  # by duration, cm
    is_ratio: bool = False  # figures are errors over those of the last known position

    @property
    def durations(self) -> tuple[float, ...]:
        """Durations of the figures, s; with nothing hidden there is one figure."""
        return DURATIONS if self.hidden else (0.0,)

    def key(self, duration: float) -> str:
        """Return the name of a figure in the flat object."""
        if not self.hidden:
            return f"{_STILL_KEYS.get(self.method, self.method)}_cm"
        at = f"{self.hidden}_{duration:.1f}"
        return f"ratio_{at}" if self.is_ratio else f"{self.method}_{at}_cm"


def published_ratio(hidden: int, duration: float) -> float:
    """Network ÷ last known position by the paper's table."""
    place = DURATIONS.index(duration)
    return PUBLISHED_MARKERS["nn", hidden][place] / PUBLISHED_MARKERS["lk", hidden][place]


MARKER_LINES = (
    *(
        GloveLine(method, name, hidden, PUBLISHED_MARKERS.get((method, hidden), _NONE))
        for method, name in METHODS.items()
        for hidden in HIDDEN
    ),
    *(
        GloveLine("nn", "network ÷ last known", n, tuple(published_ratio(n, d) for d in DURATIONS), is_ratio=True)
        for n in HIDDEN
    ),
)
FINGER_LINES = (
    *(GloveLine(method, name, 0, (PUBLISHED_STILL[method], *_NONE[1:])) for method, name in _STILL.items()),
    *(GloveLine("nn", "network", hidden, PUBLISHED_POINTS[hidden]) for hidden in HIDDEN),
)


def marker_report(table: GloveTable) -> Report:
    """Table 3, with the ratios of network and last known position."""
    return _report(
        table,
        "gloves-table3",
        "Table 3: hidden markers of a glove on the last frame before they return",
        MARKER_LINES,
        remarks=_marker_remarks(table),
        caption=f"Mean error of hidden markers, cm; {SEEDS} seeds, a trial every {STRIDE / 60:g} s each. Last known is "
        "where they were in the world, so that all of a hand's way counts; last shape, where they were on the hand.",
    )


def finger_report(table: GloveTable) -> Report:
    """Table 4, with inverse kinematics by cyclic coordinate descent."""
    remarks: list[str | None] = []
    for method in ("ik", "ik_tuned"):
        lower, higher = (table.tally(one, 0, 0.0).named(_STILL[one]) for one in ("nn", method))
        title = f"The network is better than {_STILL[method]}, nothing hidden"
        remarks.append(ordering(title, lower, [higher], "cm"))
    return _report(
        table,
        "gloves-table4",
        "Table 4: joints of fingers",
        FINGER_LINES,
        remarks=filter(None, remarks),
        caption="Mean error of the second and third joint and the tip of every finger (p1, p2, p3), in the world, cm; "
        f"{SEEDS} seeds, a trial every {STRIDE / 60:g} s at each, of one hand whose markers are right. "
        "With nothing hidden duration means nothing.",
    )


def _report(
    table: GloveTable,
    name: str,
    title: str,
    lines: Sequence[GloveLine],
    remarks: Iterable[str],
    **more: Any,
) -> Report:
    """Return a table by duration, ours and the paper's; rows of unseen hands come last."""
    made = f"Synthesised: {table.synthesised} different hands, {SYNTHETIC_SECONDS:g} s each, of a seed of their own."
    data = (made,)
    if table.data is not None:
        data = (describe_data(table.data, table.census), f"{made} Their keys end in _{SYNTHESISED}.")
    durations = [f"{duration:g} s" for duration in DURATIONS]
    rows, numbers = list[tuple[Cell, ...]](), dict[str, float]()
    for group in table.groups:
        for line in lines:
            ours: list[Cell] = []
            for duration in line.durations:
                key = f"{line.key(duration)}{table.suffix(group)}"
                if not line.is_ratio:
                    figures = table.means.figures(key, group, line.method, line.hidden, duration)
                else:
                    figures = {key: _ratio(table, line.hidden, duration, group)}
                ours.append(cell(figures[key]))
                numbers |= figures
            blank = _NONE[len(ours) :]
            rows.append((_motion(table, group), line.name, str(line.hidden), *ours, *blank, *line.published))
    return Report(
        name=name,
        title=f"Two hands, {title}",
        columns=("motion", "method", "hidden", *durations, *(f"paper's {duration}" for duration in durations)),
        rows=(*rows, *_foreign_rows(table)),
        numbers=finite(numbers | foreign_numbers(table.means)) | table.census.numbers(),
        data=data,
        remarks=tuple(remarks),
        digits=2,
        **more,
    )


def _motion(table: GloveTable, group: str) -> str:
    """Return the name of a group in the table."""
    return group if group == SYNTHESISED or table.data is None else f"{table.data.name}, {group}"


def _foreign_rows(table: GloveTable) -> Iterator[tuple[Cell, ...]]:
    """Return the rows of unseen hands."""
    for place, label in PLACES.items():
        for way, name in (*WAYS.items(), (ALONE, "hand known, network alone")):
            if math.isfinite(still := table.get(way, 0, 0.0, place)):
                yield (label, name, "0", cell(still), *_NONE[1:], *_NONE)
            for hidden in FEW_MANY:
                row = [table.get(way, hidden, duration, place) for duration in DURATIONS]
                if any(map(math.isfinite, row)):
                    yield (label, name, str(hidden), *map(cell, row), *_NONE)


def _ratio(table: GloveTable, hidden: int, duration: float, group: str | None = None) -> float:
    last = table.get("lk", hidden, duration, group)
    return table.get("nn", hidden, duration, group) / last if last > 0 else math.nan


def _marker_remarks(table: GloveTable) -> Iterator[str]:
    cells = [(hidden, duration) for hidden in HIDDEN for duration in DURATIONS]
    for group in table.groups:
        worse = [
            f"{hidden} at {duration:g} s ({_ratio(table, hidden, duration, group):.2f} against "
            f"{published_ratio(hidden, duration):.2f})"
            for hidden, duration in cells
            if _ratio(table, hidden, duration, group) > published_ratio(hidden, duration)
        ]
        verdict = "holds in every cell" if not worse else f"does not hold with {', '.join(worse)}"
        yield f"{_motion(table, group)}: network ÷ last known is at most the paper's: {verdict}."
    for method in ("lk", "ls", "ma", "ac"):
        better = all(table.get("nn", *one) < table.get(method, *one) for one in cells)
        pairs = [(table.tally("nn", *one).shares(), table.tally(method, *one).shares()) for one in cells]
        sure = sum(interval(ours, theirs).verdict == "better" for ours, theirs in pairs)
        held = "holds" if better else "does not hold"
        text = f"The network is better than {METHODS[method]} in every cell: {held}"
        yield f"{text}; the interval over people carries it in {sure} of {len(cells)}."
