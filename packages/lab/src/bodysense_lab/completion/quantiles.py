"""Running quantiles of magnitudes: a histogram whose bins are 1 % wide."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

_SMALLEST, _STEP, _BINS = 1e-6, 1.01, 2400  # beyond 1e-6 to 2e4: the first and the last bin


@dataclass
class Quantiles:
    """Running counts of values that are 0 or more."""

    count: np.ndarray = field(default_factory=lambda: np.zeros(_BINS))

    def add(self, values: np.ndarray) -> None:
        """Count values of any shape."""
        place = np.log(np.maximum(np.ravel(values), _SMALLEST) / _SMALLEST) / math.log(_STEP)
        self.count += np.bincount(place.clip(0, _BINS - 1).astype(int), minlength=_BINS)

    def merge(self, other: Quantiles) -> None:
        """Count what another has counted."""
        self.count += other.count

    def at(self, percent: float) -> float:
        """Return a percentile of the values, to 1 %; NaN without values."""
        total = np.cumsum(self.count)
        if not total[-1]:
            return math.nan
        place = int(np.searchsorted(total, percent / 100 * total[-1]))
        return _SMALLEST * _STEP ** (place + 0.5) if place else 0.0
