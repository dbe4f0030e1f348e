"""Whether expected errors are true: running histograms of expected against true errors, and what they come to.

Points that are tracked do not count. Points and frames are put into bins of the expected error, each `_STEP` times as
wide as the one before. The *calibration error* (ECE) is the mean over points of the difference, in their bin, between
mean expected and mean true error, in shares of the overall mean error. *Coverage* is the share of points whose true
error is within the 90 % bound that the tracker gives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

REGIONS = ("lower", "upper")  # of the 22 joints, each with an interval of its own
_SHORTEST, _LONGEST, _BINS = 1e-4, 10.0, 100  # m; beyond, the first and last bin
_STEP = (_LONGEST / _SHORTEST) ** (1 / _BINS)


@dataclass
class Calibration:
    """Running histograms over points and frames."""

    pairs: np.ndarray = field(default_factory=lambda: np.zeros((_BINS, _BINS)))  # by expected and true error
    expected: np.ndarray = field(default_factory=lambda: np.zeros(_BINS))  # sums by expected error, m
    error: np.ndarray = field(default_factory=lambda: np.zeros(_BINS))  # the same of true errors
    within: float = 0.0  # points within their interval

    def add(self, expected: np.ndarray, error: np.ndarray, bound: np.ndarray) -> None:
        """Count expected errors, true errors and 90 % bounds (N,), m, of points."""
        rows, columns = _bin(expected), _bin(error)
        self.pairs += np.bincount(rows * _BINS + columns, minlength=_BINS**2).reshape(_BINS, _BINS)
        self.expected += np.bincount(rows, expected, _BINS)
        self.error += np.bincount(rows, error, _BINS)
        self.within += float((error <= bound).sum())

    def merge(self, other: Calibration) -> None:
        """Count what another has counted."""
        self.pairs += other.pairs
        self.expected += other.expected
        self.error += other.error
        self.within += other.within

    @property
    def count(self) -> float:
        """Points and frames."""
        return float(self.pairs.sum())

    @property
    def ece(self) -> float:
        """Calibration error, in shares of the mean error; NaN where nothing was counted."""
        total = float(self.error.sum())
        return float(np.abs(self.error - self.expected).sum()) / total if total else math.nan

    @property
    def coverage(self) -> float:
        """Share of points within their 90 % bound; NaN where nothing was counted."""
        return self.within / self.count if self.count else math.nan

    @property
    def rank_correlation(self) -> float:
        """Spearman's correlation of expected and true error, up to the width of the bins."""
        if not self.count:
            return math.nan
        rows, columns = self.pairs.sum(axis=1), self.pairs.sum(axis=0)
        a, b = _centred_ranks(rows), _centred_ranks(columns)
        scale = math.sqrt(float(rows @ a**2) * float(columns @ b**2))
        return float(a @ self.pairs @ b) / scale if scale else math.nan

    def curve(self, fewest: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
        """Mean expected and mean true error (N,), m, of the bins with at least this share of the points."""
        count = self.pairs.sum(axis=1)
        chosen = count > fewest * count.sum()
        return self.expected[chosen] / count[chosen], self.error[chosen] / count[chosen]


def _bin(values: np.ndarray) -> np.ndarray:
    """The bin (N,) of errors, m."""
    place = np.log(np.maximum(values, 1e-12) / _SHORTEST) / math.log(_STEP)
    return place.clip(0, _BINS - 1).astype(int)


def _centred_ranks(count: np.ndarray) -> np.ndarray:
    """Mean rank of each bin's points, from the mean of all."""
    return np.cumsum(count) - (count - 1) / 2 - (count.sum() + 1) / 2
