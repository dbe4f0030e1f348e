"""Confidence intervals of means by bootstrap over people, because frames of one person are not independent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

DRAWS = 2000
SHARE = 0.95  # share of the draws within an interval


@dataclass(frozen=True)
class Interval:
    """A figure and its confidence interval."""

    value: float
    low: float
    high: float

    @property
    def verdict(self) -> str:
        """Verdict on a difference of errors: 'worse', 'better', 'none' (not significant) or 'unknown'."""
        if math.isnan(self.low):
            return "unknown"
        return "none" if self.low <= 0 <= self.high else "worse" if self.value > 0 else "better"


Shares = Mapping[str, tuple[float, float]]  # by person: the mean, and its weight


def interval(of: Shares, minus: Shares | None = None, seed: int = 0) -> Interval:
    """Return the weighted mean over people, or its difference from that of `minus`, with its confidence interval.

    Bounds are percentiles of `DRAWS` draws of people with replacement (Efron). Both means have the same people in each
    draw. With fewer than two people the bounds are NaN.

    Args:
        of: mean and weight by person.
        minus: mean and weight by person to subtract; people that are not in both are omitted.
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
    """Return weighted means (K,) of drawn people (K, N)."""
    value, weight = np.array([of[person] for person in people]).T
    return (value * weight)[drawn].sum(axis=1) / weight[drawn].sum(axis=1)


@dataclass(frozen=True)
class NamedFigure:
    """A figure, its name, and its shares by person."""

    name: str
    value: float
    shares: Shares = field(default_factory=dict, repr=False)  # of the figure, or of one that increases with it
