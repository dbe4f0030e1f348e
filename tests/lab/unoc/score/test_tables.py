"""Tables 2 to 4: our figures and the published ones in their places, and remarks about the paper's orderings."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from bodysense.takes.last_known import KNOWN
from bodysense_lab.core.score_table import ScoreTable
from bodysense_lab.core.scoring import Tally
from bodysense_lab.core.tallies import Tallies
from bodysense_lab.data.datasets import Census, DataSet
from bodysense_lab.papers.unoc.network.variants import TABLES
from bodysense_lab.papers.unoc.score.kept_scores import Scores
from bodysense_lab.papers.unoc.score.tables import OWN_NAMES, TABLE_2, TABLE_3, TABLE_4, network_report

ALL = (TABLE_2, TABLE_3, TABLE_4)
PARTS = ("body", "finger", "body_and_finger", "parent_body", "parent_all", "bone_body", "bone_all")


def made(error: float, fingers: bool = True, groups: tuple[str, ...] = ("main", "sport")) -> Scores:
    """A method whose errors are all alike; those of hidden joints twice as large, those of sport ten times."""
    tallies = Tallies()
    for group in groups:
        for part in PARTS if fingers else ("body", "parent_body", "bone_body"):
            for share, factor in (("occluded", 2.0), ("all", 1.0)):
                tally = tallies[group, part, share] = Tally()
                tally.add(np.full(4, error * factor * (10 if group == "sport" else 1)))
    return Scores(tallies, Census(3, frozenset("ab"), 60.0, int(fingers), 20.0))


def scores_of(table: ScoreTable, errors: Mapping[str, float], fingers: bool = True) -> dict[str, Scores]:
    methods = {name: made(errors.get(name, 5.0), fingers) for name in table.methods if name != "last_known"}
    known = {"world": 9.0, "head": 8.0, "heading": errors.get("last_known", 7.0)}
    return methods | {f"last_known_{frame}": made(known[frame], fingers) for frame in KNOWN}


@pytest.mark.parametrize("table", ALL, ids=lambda table: table.name)
def test_the_networks_are_those_that_are_trained(table: ScoreTable) -> None:
    networks = {name for name in table.methods if name not in OWN_NAMES}
    assert networks == set(TABLES[table.name[-1]])
    assert len(set(table.methods.values())) == len(table.methods)
    for claim in table.claims:
        for one in (claim.lower, *claim.higher):
            assert one.method in table.methods and one.place in (table.rows or ())


@pytest.mark.parametrize("table", ALL, ids=lambda table: table.name)
def test_the_published_figures_support_the_claims(table: ScoreTable) -> None:
    """The published figures have every ordering that a remark attributes to the paper."""
    for claim in table.claims:
        if not claim.text.startswith("Not in the paper"):
            lower, *higher = (
                float(table.published[0].cells[one.place, one.method][one.figure] or 0)
                for one in (claim.lower, *claim.higher)
            )
            assert lower < min(higher), claim


def test_every_place_has_our_figures_and_the_published_ones(data: DataSet) -> None:
    report = network_report(TABLE_2, scores_of(TABLE_2, {"gru": 3.0}), data)
    columns = {name: k for k, name in enumerate(report.columns)}
    rows = {(row[0], row[1]): row for row in report.rows}
    assert len(rows) == len(TABLE_2.rows or ()) * len(TABLE_2.methods)
    row = rows["body, occluded", "GRU"]
    assert [row[columns[name]] for name in ("RMSJPE", "MPJPE", "UNOC's RMSJPE", "UNOC's MPJPE", "sport RMSJPE")] == [
        6.0,
        6.0,
        5.9,
        4.0,
        60.0,
    ]
    assert rows["both, all", "TCN"][columns["UNOC's MPJPE"]] == 4.1
    assert rows["fingers, occluded", "last known"][columns["RMSJPE"]] == 14.0, "the best of the three"
    assert rows["body, all", "shipped"][columns["UNOC's RMSJPE"]] is None
    assert "dance RMSJPE" not in columns


def test_changes_of_table_4(data: DataSet) -> None:
    report = network_report(TABLE_4, scores_of(TABLE_4, {"gru": 4.0, "no_bone": 5.0}), data)
    rows = {(row[0], row[1]): row for row in report.rows}
    ours, theirs = (report.columns.index(name) for name in ("change, %", "UNOC's change, %"))
    row = rows["bones, body", "w/o bone length"]
    assert row[ours] == pytest.approx(25.0) and row[theirs] == pytest.approx(100 * (1.06 / 0.90 - 1))
    assert rows["bones, both", "GRU"][ours] == 0.0


def test_without_networks_our_own_methods_remain(data: DataSet) -> None:
    scores = scores_of(TABLE_2, {})
    report = network_report(TABLE_2, {name: one for name, one in scores.items() if name not in TABLES["2"]}, data)
    assert {row[1] for row in report.rows} == set(OWN_NAMES.values())
    assert not [text for text in report.remarks if "GRU" in text]
