"""Preferences: compared with SciPy, computed by hand, and for simulated raters of known preference."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from bodysense.errors import BodysenseError
from bodysense_lab.study.analysis import (
    analyze,
    preference,
    simulate_answers,
    votes,
    write_csv,
)
from bodysense_lab.study.study import COMPARISONS, Answers, Choice, Condition, StudyKey, draw_key, pairs_for


@pytest.fixture(scope="module")
def key() -> StudyKey:
    return draw_key([f"scene{k}" for k in range(4)], np.random.default_rng(0))


@pytest.mark.parametrize("seed", range(2))
def test_preferences_equal_those_of_scipy(seed: int) -> None:
    values = np.random.default_rng(seed).choice([-1.0, 0.0, 1.0], 12, p=[0.2, 0.3, 0.5])
    ours = preference(values)
    t, p = stats.ttest_1samp(values, 0)
    assert (ours.t, ours.p) == pytest.approx((t, p), rel=1e-12)
    assert (ours.mean, ours.n) == (values.mean(), 12)
    assert ours.standard_error == pytest.approx(stats.sem(values))


def test_equal_votes_have_no_standard_error() -> None:
    agree, nobody, one = preference(np.ones(9)), preference(np.zeros(9)), preference(np.array([-1.0]))
    assert (agree.mean, agree.standard_error, agree.t, agree.p) == (1, 0, math.inf, 0)
    assert (nobody.mean, nobody.standard_error, nobody.p) == (0, 0, 1) and math.isnan(nobody.t)
    assert one.mean == -1 and math.isnan(one.p) and one.stars == ""


def test_a_vote_is_for_the_displayed_animation(key: StudyKey) -> None:
    """One rater always chooses the better condition, the other the right-hand picture."""
    rank = {"truth": 2, "ours": 1, "baseline": 0}

    def better(left: str, right: str) -> Choice:
        return "left" if rank[key.condition_of(left)] > rank[key.condition_of(right)] else "right"

    given = [
        Answers(key.study, "knows", tuple((a, b, better(a, b)) for a, b in pairs_for(key, "knows"))),
        Answers(key.study, "right", tuple((a, b, "right") for a, b in pairs_for(key, "right"))),
        Answers(key.study, "none", tuple((a, b, "none") for a, b in pairs_for(key, "none"))),
    ]
    cast = votes(key, given)
    assert cast.shape == (3, 4, 3)
    assert (cast[0] == 1).all() and (cast[2] == 0).all()
    assert (np.abs(cast[1]) == 1).all() and (cast[1].sum(axis=0) == 0).all(), "sides are balanced in each comparison"
    result = analyze(key, given)
    assert result.raters == 3 and result.preferences[None][0].n == 3
    assert [one.mean for one in result.preferences[None]] == pytest.approx([1 / 3] * 3)
    # Over all scenes, as in the paper, a value is a rater's mean over scenes: 1, 0, 0.
    _, p = stats.ttest_1samp([1, 0, 0], 0)
    assert result.preferences[None][1].p == pytest.approx(p)


def test_simulated_preference_is_recovered(key: StudyKey) -> None:
    quality: dict[Condition, float] = {"truth": 0.7, "ours": 0.5}
    expected = (0.2, 0.5, 0.7)
    given = simulate_answers(key, 150, quality, np.random.default_rng(0))
    result = analyze(key, given)
    for name in (*result.scenes, None):
        for one, mean in zip(result.preferences[name], expected, strict=True):
            assert abs(one.mean - mean) < 3.5 * one.standard_error
    assert all(one.p < 0.01 for one in result.preferences[None])
    assert simulate_answers(key, 150, quality, np.random.default_rng(0)) == given
    ties = np.mean([choice == "none" for one in given for *_, choice in one.given])
    assert ties == pytest.approx(0.2 * np.mean([1 - mean for mean in expected]), abs=0.03)


def test_without_preference_one_in_twenty_is_significant(key: StudyKey) -> None:
    generator, tests, found = np.random.default_rng(1), 0, 0
    for _ in range(60):
        result = analyze(key, simulate_answers(key, 16, {}, generator))
        tests += len(COMPARISONS)
        found += sum(one.p < 0.05 for one in result.preferences[None])
    low, high = stats.binom.interval(0.999, tests, 0.05)
    assert low <= found <= high, f"{found} of {tests}"


@pytest.mark.parametrize(
    ("raters", "quality", "ties", "message"),
    [
        (0, {}, 0.2, "0 raters cannot answer"),
        (3, {"truth": 0.8, "baseline": -0.5}, 0.2, r"quality of truth minus that of baseline is 1\.3; mean votes are"),
        (3, {"ours": math.nan}, 0.2, "mean votes are"),
        (3, {}, 1.5, r"ties 1\.5 is not a share"),
    ],
)
def test_impossible_raters_are_refused(key: StudyKey, raters: int, quality: dict, ties: float, message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        simulate_answers(key, raters, quality, np.random.default_rng(0), ties)


def test_numbers_and_csv_have_every_comparison(tmp_path: Path, key: StudyKey) -> None:
    result = analyze(key, simulate_answers(key, 10, {"truth": 1.0}, np.random.default_rng(2)))
    numbers = result.numbers()
    assert (numbers["raters"], numbers["scenes"]) == (10, 4)
    assert numbers["truth_over_baseline_mean"] == 1 and numbers["truth_over_baseline_p"] == 0
    assert "truth_over_baseline_t" not in numbers, "infinite figures are omitted"
    assert numbers["scene2_ours_over_baseline_p"] == result.preferences["scene2"][1].p
    json.loads(json.dumps(numbers, allow_nan=False))
    write_csv(tmp_path / "p.csv", result)
    with (tmp_path / "p.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3 * 5
    assert [row["scene"] for row in rows[-3:]] == ["(all)"] * 3
    assert float(rows[1]["mean"]) == result.preferences["scene0"][1].mean and rows[1]["n"] == "10"
