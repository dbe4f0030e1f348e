"""How far a mean can be trusted: intervals by drawing the people anew, for frames of one person are not independent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

DRAWS = 2000
SHARE = 0.95  # of the draws lie within an interval


@dataclass(frozen=True)
class Interval:
    """A figure and its confidence interval."""

    value: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """Whether a difference of errors is significant: 'worse', 'better', 'none' or 'unknown'."""
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


@dataclass(frozen=True)
class NamedFigure:
    """A figure and whose it is."""

    name: str
    value: float
    shares: Shares = field(default_factory=dict, repr=False)  # by person, of the figure or of what grows with it
