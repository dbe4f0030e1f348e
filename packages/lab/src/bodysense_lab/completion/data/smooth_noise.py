"""Smooth noise for drift of sensors, turning hands and swaying people."""

from __future__ import annotations

import numpy as np

from bodysense.geometry.rotation import smooth_step


def smooth_noise(frames: int, count: int, rate: float, seconds: float, rng: np.random.Generator) -> np.ndarray:
    """Return smooth noise (T, count) of standard deviation 1 that changes within `seconds`, at `rate` Hz."""
    knots = int(np.ceil(frames / (rate * seconds))) + 2
    values = rng.standard_normal((knots, count)) * 1.2
    place = np.arange(frames) / (rate * seconds) + rng.uniform(0, 1)
    low = place.astype(int)
    share = smooth_step((place - low)[:, None])
    return values[low] * (1 - share) + values[np.minimum(low + 1, knots - 1)] * share
