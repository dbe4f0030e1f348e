"""Reports: CSV files and remarks about orderings."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense_lab.core.intervals import NamedFigure
from bodysense_lab.core.table import Report, cell, finite, ordering, write_csv


def test_a_csv_has_the_rows_of_the_report(tmp_path: Path) -> None:
    report = Report("t", "T", ("a", "b", "c"), (("x, y", 1 / 3, None), ("z", 12, "w")), {})
    write_csv(tmp_path / "t.csv", report)
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    assert head == ["a", "b", "c"]
    assert rows[0][0] == "x, y" and float(rows[0][1]) == 1 / 3 and rows[0][2] == ""
    assert rows[1] == ["z", "12", "w"]
    assert [path.name for path in tmp_path.iterdir()] == ["t.csv"], "nothing is left beside"
    with pytest.raises(BodysenseError, match="does not exist"):
        write_csv(tmp_path / "none" / "t.csv", report)


@pytest.mark.parametrize(
    ("lower", "higher", "verdict"),
    [
        (1.0, (2.0, 3.0), "holds (A 1.00, B 2.00, C 3.00 cm)"),
        (2.5, (2.0, 3.0), "does not hold against B (A 2.50, B 2.00, C 3.00 cm)"),
        (3.0, (3.0, 3.5), "does not hold against B"),
        (9.0, (2.0, 3.0), "does not hold against B, C"),
    ],
)
def test_remarks_name_the_figures_that_break_an_ordering(
    lower: float, higher: tuple[float, float], verdict: str
) -> None:
    others = [NamedFigure("B", higher[0]), NamedFigure("C", higher[1])]
    remark = ordering("A is best", NamedFigure("A", lower), others, "cm")
    assert remark is not None and remark.startswith("A is best: ") and verdict in remark


@pytest.mark.parametrize(
    ("spread", "verdict"),
    [(0.0, "A is best: holds (A 1.00, B 1.20 cm)."), (1.0, "A is best: no sure difference to B (A 1.00, B 1.20 cm).")],
)
def test_differences_that_are_not_significant_are_not_sure(spread: float, verdict: str) -> None:
    away = spread * np.linspace(-1, 1, 9)
    a, b = ({f"p{k}": (value + sign * away[k], 10.0) for k in range(9)} for value, sign in ((1.0, 1), (1.2, -1)))
    assert ordering("A is best", NamedFigure("A", 1.0, a), [NamedFigure("B", 1.2, b)], "cm") == verdict
    one, other = (NamedFigure(name, value, {"p": (value, 1.0)}) for name, value in (("A", 1.0), ("B", 1.2)))
    assert ordering("A is best", one, [other], "cm") == "A is best: holds (A 1.00, B 1.20 cm)."


def test_orderings_with_missing_figures_have_no_remark() -> None:
    assert ordering("x", NamedFigure("A", math.nan), [NamedFigure("B", 1.0)], "cm") is None
    assert ordering("x", NamedFigure("A", 1.0), [NamedFigure("B", math.nan)], "cm") is None
    assert ordering("x", NamedFigure("A", 1.0), [], "cm") is None
    assert finite({"a": 1.0, "b": math.nan, "c": math.inf}) == {"a": 1.0}
    assert (cell(2.0), cell(math.nan)) == (2.0, None)
