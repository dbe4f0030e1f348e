"""Preferences of a study's raters: means, standard errors and t-tests, as in UNOC's Fig. 6; and simulated raters.

The paper attributes +1 and −1 to the two techniques of a pair, averages *each participant's* votes over the scenes, and
tests those averages against zero: it reports t(38) for 39 participants. This module does the same. Over all scenes, n
is the number of raters and a value is a rater's mean. In one scene a value is a rater's single vote. Votes are never
pooled over scenes, because those of one rater are not independent. As in the paper, p is not corrected for the number
of tests.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from bodysense.errors import BodysenseError
from bodysense_lab.core.table import write_rows
from bodysense_lab.study.study import COMPARISONS, CONDITIONS, Answers, Choice, Condition, StudyKey, pairs_for


@dataclass(frozen=True)
class Preference:
    """A mean vote in [−1, 1], positive for the first of a comparison, tested against zero."""

    mean: float
    standard_error: float  # NaN for fewer than two votes
    t: float  # Student's, n − 1 degrees of freedom; infinite if all agree, NaN without a test
    p: float  # two-sided
    n: int

    @property
    def stars(self) -> str:
        """'**' for p < 0.01, '*' for p < 0.05."""
        return "**" if self.p < 0.01 else "*" if self.p < 0.05 else ""


@dataclass(frozen=True)
class StudyResult:
    """Preferences by scene, and over all scenes under the name None, for each of `COMPARISONS`."""

    scenes: tuple[str, ...]
    preferences: dict[str | None, tuple[Preference, ...]]

    @property
    def raters(self) -> int:
        """Number of raters."""
        return self.preferences[None][0].n

    def numbers(self) -> dict[str, float]:
        """Return one flat object: `truth_over_ours_mean`, `<scene>_truth_over_ours_p` …; finite values only."""
        result: dict[str, float] = {"raters": self.raters, "scenes": len(self.scenes)}
        for scene, preferences in self.preferences.items():
            for (first, second), one in zip(COMPARISONS, preferences, strict=True):
                key = f"{first}_over_{second}" if scene is None else f"{scene}_{first}_over_{second}"
                for name in ("mean", "standard_error", "t", "p"):
                    result[f"{key}_{name}"] = getattr(one, name)
        return {key: value for key, value in result.items() if math.isfinite(value)}


def analyze(key: StudyKey, answers: Sequence[Answers]) -> StudyResult:
    """Return the preferences of raters, per scene and over all scenes."""
    cast = votes(key, answers)
    names = tuple(scene.name for scene in key.scenes)
    count = range(len(COMPARISONS))
    result: dict[str | None, tuple[Preference, ...]] = {
        name: tuple(preference(cast[:, scene, which]) for which in count) for scene, name in enumerate(names)
    }
    result[None] = tuple(preference(cast[:, :, which].mean(axis=1)) for which in count)
    return StudyResult(names, result)


def votes(key: StudyKey, answers: Sequence[Answers]) -> np.ndarray:
    """Return votes (raters, scenes, comparisons): +1 for the first condition, −1 for the second, 0 for neither."""
    cast = np.zeros((len(answers), len(key.scenes), len(COMPARISONS)))
    for rater, one in enumerate(answers):
        for left, right, choice in one.given:
            which, sign = _comparison(key.condition_of(left), key.condition_of(right))
            cast[rater, key.scene_of[left], which] = sign * {"left": 1, "right": -1, "none": 0}[choice]
    return cast


def preference(values: np.ndarray) -> Preference:
    """Return the mean of values (n,) and Student's one-sample t-test of it against zero.

    Equal values have no variance: p is 0 if they differ from zero, and 1 if not.
    """
    n, mean = len(values), float(values.mean())
    if n < 2:
        return Preference(mean, math.nan, math.nan, math.nan, n)
    if values.min() == values.max():
        return Preference(mean, 0.0, math.copysign(math.inf, mean) if mean else math.nan, 0.0 if mean else 1.0, n)
    t, p = map(float, stats.ttest_1samp(values, 0.0))
    return Preference(mean, float(stats.sem(values)), t, p, n)


def write_csv(path: str | Path, result: StudyResult) -> None:
    """Write a row for every scene and comparison, then rows over all scenes, as CSV."""
    rows = [
        (
            scene or "(all)",
            f"{first} over {second}",
            one.mean,
            one.standard_error,
            one.t,
            one.p,
            one.n,
        )
        for scene, preferences in result.preferences.items()
        for (first, second), one in zip(COMPARISONS, preferences, strict=True)
    ]
    write_rows(path, ("scene", "comparison", "mean", "standard_error", "t", "p", "n"), rows)


def simulate_answers(
    key: StudyKey,
    raters: int,
    quality: Mapping[Condition, float],
    generator: np.random.Generator,
    ties: float = 0.2,
) -> list[Answers]:
    """Return answers of simulated raters; the mean vote on a pair is the difference of its conditions' quality.

    Conditions that `quality` lacks have 0. Votes are independent. The share of 'no difference' is `ties` for equal
    quality and falls to 0 for a difference of ±1. Raises BodysenseError for a difference beyond that.
    """
    if raters < 1:
        raise BodysenseError(f"{raters} raters cannot answer; give at least 1")
    if not 0 <= ties <= 1:
        raise BodysenseError(f"ties {ties:g} is not a share; give a number from 0 to 1")
    level = {condition: float(quality.get(condition, 0.0)) for condition in CONDITIONS}
    for first, second in COMPARISONS:
        difference = level[first] - level[second]
        if not abs(difference) <= 1:
            raise BodysenseError(
                f"the quality of {first} minus that of {second} is {difference:g}; mean votes are from -1 to 1"
            )
    result = []
    for number in range(1, raters + 1):
        rater, given = f"simulated-{number:03d}", []
        for left, right in pairs_for(key, rater):
            mean = level[key.condition_of(left)] - level[key.condition_of(right)]
            equal = ties * (1 - abs(mean))
            odds = [(1 - equal + mean) / 2, (1 - equal - mean) / 2]
            place = int(np.searchsorted(np.cumsum(odds), generator.random(), side="right"))
            choices: tuple[Choice, ...] = ("left", "right", "none")
            given.append((left, right, choices[place]))
        result.append(Answers(key.study, rater, tuple(given)))
    return result


def _comparison(first: Condition, second: Condition) -> tuple[int, int]:
    """Return the index in `COMPARISONS` of two conditions, and +1, or −1 if they are in reverse order."""
    for which, pair in enumerate(COMPARISONS):
        if pair == (first, second):
            return which, 1
        if pair == (second, first):
            return which, -1
    raise AssertionError(f"{first} and {second} are not compared")
