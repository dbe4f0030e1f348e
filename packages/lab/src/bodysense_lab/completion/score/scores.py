"""Running scores that can be merged: means, and sums of histograms and curves.

`Calibration` compares expected with true errors of untracked points. Points are sorted into bins by expected error. The
*calibration error* (ECE) is the mean over points of the difference between mean expected and mean true error of their
bin, divided by the overall mean error. *Coverage* is the share of points whose true error is within the tracker's 90 %
bound.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

_ERRORS = (1e-4, 1e5 ** (1 / 100), 100)  # upper edge of the first bin in m, ratio of neighbouring edges, number of bins
_QUANTILES = (1e-6, 1.01, 2400)
ROOTS = {"occluded_square": "occluded_rmsjpe_cm"}  # names of means of squares, and keys of their roots


@dataclass
class RunningScores:
    """Weighted means by name, and arrays that add up."""

    total: dict[str, float] = field(default_factory=dict)
    weight: dict[str, float] = field(default_factory=dict)
    sums: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)  # histograms and curves by kind and name

    def add(self, name: str, value: float, weight: float) -> None:
        """Add a mean with its weight in frames, joints or minutes; a weight of 0 adds nothing."""
        if weight:
            self.total[name] = self.total.get(name, 0.0) + value * weight
            self.weight[name] = self.weight.get(name, 0.0) + weight

    def add_share(self, name: str, mask: np.ndarray) -> None:
        """Add the share of true values of a mask (N,)."""
        if mask.size:
            self.add(name, float(mask.mean()), mask.size)

    def add_sum(self, kind: str, name: str, values: np.ndarray) -> None:
        """Add values to the sum of a kind and name."""
        before = self.sums.get((kind, name))
        self.sums[kind, name] = values if before is None else before + values

    def merge(self, other: RunningScores) -> None:
        """Add the scores of another part of the work."""
        for name, weight in other.weight.items():
            self.add(name, other.total[name] / weight, weight)
        for (kind, name), values in other.sums.items():
            self.add_sum(kind, name, values)

    def get(self, name: str) -> float:
        """Return a mean; NaN if nothing was counted."""
        return self.total[name] / self.weight[name] if name in self.weight else math.nan

    def root(self, name: str) -> float:
        """Return the root of a mean of squares."""
        return math.sqrt(self.get(name))

    def numbers(self) -> dict[str, float]:
        """Return all means by key; of squares the root."""
        roots = {ROOTS[name]: self.root(name) for name in ROOTS if name in self.weight}
        return {name: self.get(name) for name in self.weight if name not in ROOTS} | roots


class Calibration(RunningScores):
    """Histograms of expected and true errors over points and frames."""

    def add_errors(self, expected: np.ndarray, error: np.ndarray, bound: np.ndarray) -> None:
        """Count points by their expected errors, true errors and 90 % bounds (N,), m."""
        count, (rows, columns) = _ERRORS[2], (_bins(values, *_ERRORS) for values in (expected, error))
        pairs = np.bincount(rows * count + columns, minlength=count**2).reshape(count, count)
        sums = np.stack([np.bincount(rows, values, count) for values in (expected, error)])
        for name, values in (("pairs", pairs), ("sums", sums), ("within", np.array((error <= bound).sum()))):
            self.add_sum("calibration", name, values.astype(float))

    @property
    def pairs(self) -> np.ndarray:
        """Number of points by bins of expected and true error (B, B)."""
        return self.sums.get(("calibration", "pairs"), np.zeros((_ERRORS[2], _ERRORS[2])))

    @property
    def expected_and_true(self) -> np.ndarray:
        """Sums of expected and of true errors (2, B), m, by bin of the expected error."""
        return self.sums.get(("calibration", "sums"), np.zeros((2, _ERRORS[2])))

    @property
    def count(self) -> float:
        """Number of points, over all frames."""
        return float(self.pairs.sum())

    @property
    def ece(self) -> float:
        """Calibration error divided by the mean error; NaN if nothing was counted."""
        expected, error = self.expected_and_true
        total = float(error.sum())
        return float(np.abs(error - expected).sum()) / total if total else math.nan

    @property
    def coverage(self) -> float:
        """Share of points within their 90 % bound; NaN if nothing was counted."""
        return float(self.sums["calibration", "within"]) / self.count if self.count else math.nan

    @property
    def rank_correlation(self) -> float:
        """Spearman's correlation of expected and true error, at the resolution of the bins."""
        if not self.count:
            return math.nan
        counts = [self.pairs.sum(axis=axis) for axis in (1, 0)]
        a, b = (np.cumsum(count) - (count - 1) / 2 - (count.sum() + 1) / 2 for count in counts)  # centred mean ranks
        scale = math.sqrt(float(counts[0] @ a**2) * float(counts[1] @ b**2))
        return float(a @ self.pairs @ b) / scale if scale else math.nan

    def curve(self, fewest: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
        """Return mean expected and mean true errors (N,), m, of bins with at least a share `fewest` of the points."""
        count = self.pairs.sum(axis=1)
        chosen = count > fewest * count.sum()
        expected, error = self.expected_and_true[:, chosen] / count[chosen]
        return expected, error


def histogram(values: np.ndarray) -> np.ndarray:
    """Return a histogram of non-negative values of any shape, in bins that are 1 % wide."""
    return np.bincount(_bins(np.ravel(values), *_QUANTILES), minlength=_QUANTILES[2]).astype(float)


def percentile(count: np.ndarray, percent: float) -> float:
    """Return a percentile of the values of a `histogram`, accurate to 1 %; NaN without values."""
    smallest, step, _ = _QUANTILES
    total = np.cumsum(count)
    if not total[-1]:
        return math.nan
    place = int(np.searchsorted(total, percent / 100 * total[-1]))
    return smallest * step ** (place + 0.5) if place else 0.0


def _bins(values: np.ndarray, smallest: float, step: float, count: int) -> np.ndarray:
    """Return the bin (N,) of each value; the first and the last bin have all values beyond them."""
    place = np.log(np.maximum(values, smallest) / smallest) / math.log(step)
    return place.clip(0, count - 1).astype(int)
