"""Table 5: every pair of what a network was trained and tested on, in its place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.takes.last_known import KNOWN
from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet
from bodysense_lab.papers.unoc.score.cross_table import PUBLISHED_BODY, PUBLISHED_FINGERS, SETS, cross_report
from bodysense_lab.papers.unoc.score.kept_scores import Scores


def tally_of(error: float) -> Tally:
    tally = Tally()
    tally.add(np.full(3, error))
    return tally


def made(error: float, fingers: bool = True) -> Scores:
    parts = ("body", "body_and_finger") if fingers else ("body",)
    tallies = Tallies({("main", part, "occluded"): tally_of(error) for part in parts})
    return Scores(tallies, Census(2, frozenset("a"), 60.0, 2 * fingers, 60.0 * fingers))


@pytest.fixture
def sets(data: DataSet) -> list[DataSet]:
    return [replace(data, name=name) for name in ("UNOC", "CMU")]


def test_published_figures_are_under_their_test_set() -> None:
    """Rows are the test sets: the input is that of the set, and the diagonal the least of its row."""
    assert PUBLISHED_BODY["", "UNOC"] == (15.9, 9.6), "Table 2's last known position"
    assert PUBLISHED_BODY["UNOC", "UNOC"] == (9.3, 5.9), "Table 2's GRU"
    for matrix in (PUBLISHED_BODY, PUBLISHED_FINGERS):
        for test in SETS:
            assert min(SETS, key=lambda train: matrix[train, test][0]) == test


def test_every_pair(sets: list[DataSet]) -> None:
    fingers = {"UNOC": True, "CMU": False}
    errors = {("UNOC", "UNOC"): 5.0, ("UNOC", "CMU"): 8.0, ("CMU", "UNOC"): 12.0, ("CMU", "CMU"): 9.0}
    scores = {pair: made(error, fingers[pair[1]]) for pair, error in errors.items()}
    known = {name: {f"last_known_{frame}": made(10.0, fingers[name]) for frame in KNOWN} for name in fingers}
    report = cross_report(["UNOC", "CMU"], sets, scores, known)
    rows = {row[:3]: row[3:] for row in report.rows}
    assert rows["body, occluded", "UNOC", "CMU"][:4] == (12.0, 12.0, 10.0, 10.0)
    ours = [row for row in report.rows if row[0] == "both, occluded" and row[3] is not None]
    assert [row[:4] for row in ours] == [("both, occluded", "UNOC", "UNOC", 5.0)], "CMU has no fingers to learn"
    assert rows["both, occluded", "UNOC", "UNOC"][4:] == (9.3, 5.9, 15.9), "published beside ours"
    assert rows["both, occluded", "Mixamo", "UNOC"] == (None, None, None, None, 22.4, 14.6, 23.1)
    assert report.numbers["unoc_to_cmu_body_occluded_rmsjpe_cm"] == 8.0
    assert report.numbers["last_known_on_cmu_body_occluded_rmsjpe_cm"] == 10.0 and report.numbers["cmu_clips"] == 2
    text = " ".join(report.remarks)
    assert "on UNOC: its own network is the best: holds" in text
    assert "on CMU: its own network is the best: does not hold against UNOC" in text
    assert "on UNOC: the network of CMU is better than the last known position: does not hold" in text
    assert not any("UNOC, of the published" in line for line in report.data) and any(
        "Mixamo, of the published" in line for line in report.data
    )
