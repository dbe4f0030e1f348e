"""Tables of scores: rows, keys, remarks and pictures."""

from __future__ import annotations

import numpy as np

from bodysense_lab.core.score_table import (
    Claim,
    Compared,
    Published,
    ScoreColumn,
    ScoreRow,
    ScoreTable,
    score_report,
)
from bodysense_lab.core.scoring import Tally
from bodysense_lab.data.datasets import Census

TABLE = ScoreTable(
    name="t",
    title="T",
    axes=("where", "how"),
    places={"arm": ScoreRow("arm", "arm"), "leg": ScoreRow("leg", "leg", "_low"), "all": ScoreRow("all", None)},
    methods={"a": "A", "b": "B"},
    figures=(
        ScoreColumn("root", "error", "rmsjpe", "{method}_{place.key}_root{place.ending}", bounded=True),
        ScoreColumn("frames", "error", "count", "{place.key}_frames"),
    ),
    caption="",
    published=(Published(("theirs",), {("arm", "a"): (5.0,), ("leg", "b"): (2.0,)}),),
    claims=(
        Claim("A is better", Compared("A", "arm", "a"), (Compared("B", "arm", "b"),)),
        Claim("Nobody knows", Compared("A", "leg", "a"), (Compared("B", "leg", "b"),)),
    ),
    bounded=0,
    change_from="b",
)


def tally(*errors: float) -> Tally:
    found = Tally()
    for person, error in enumerate(errors):
        found.add(np.array([error, error]), f"p{person}")
    return found


SCORES = {
    ("main", "arm", "a", "error"): tally(3.0, 4.0),
    ("main", "arm", "b", "error"): tally(6.0, 8.0),
    ("sport", "arm", "a", "error"): tally(9.0),
    ("main", "all", "a", "error"): tally(1.0),
}


def test_rows_have_every_column_in_its_place() -> None:
    report = score_report(TABLE, SCORES, None, ())
    assert report.columns == (
        *("where", "how", "root", "frames", "root low", "high", "theirs"),
        *("change, %", "UNOC's change, %", "sport RMSJPE"),
    )
    rows = {row[:2]: row[2:] for row in report.rows}
    assert list(rows) == [("arm", "A"), ("arm", "B"), ("all", "A")], "no row without figures of ours"
    root = np.sqrt(12.5)
    assert rows["arm", "A"] == (root, 4, 3.0, 4.0, 5.0, -50.0, None, 9.0)
    assert rows["arm", "B"][4:] == (None, 0.0, None, None)


def test_keys_have_their_group_and_bounds() -> None:
    numbers = score_report(TABLE, SCORES, Census(2, frozenset("ab"), 60.0), (), numbers={"more": 1.0}).numbers
    assert numbers["a_arm_root_low"] == 3.0 and numbers["a_arm_root_high"] == 4.0
    assert numbers["a_arm_root_sport"] == 9.0 and "a_arm_root_sport_low" not in numbers, "one person has no bounds"
    assert numbers["arm_frames"] == 4 and numbers["more"] == 1.0 and numbers["people"] == 2
    assert not [key for key in numbers if "all" in key], "a place without a key"


def test_claims_about_missing_figures_are_omitted() -> None:
    report = score_report(TABLE, SCORES, None, (), ["And more."])
    assert [text.partition(":")[0] for text in report.remarks] == ["A is better", "And more."]
    assert "holds (A 3.54, B 7.07 cm)" in report.remarks[0]
