"""Accelerations of inertial sensors strapped to bones, without gravity, smoothed as those of real sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bodysense.body.skeleton import INERTIAL_BONES, INERTIAL_POINTS

ALONG = 0.8  # position on the bone, as a share of its length from its joint: above the ankle, the wrist, the knee
SMOOTHING = 0.066  # s; an acceleration is the mean over the last two of these intervals, without look-ahead


def strapped_positions(position: np.ndarray, points: Sequence[str], along: float | np.ndarray = ALONG) -> np.ndarray:
    """Return positions (..., 12, 3) m of the inertial sensors, `along` their bones, from points (..., P, 3) m."""
    begins = [points.index(name) for name in INERTIAL_POINTS]
    ends = [points.index(end or name) for name, end in INERTIAL_BONES.items()]
    share = np.broadcast_to(np.asarray(along, dtype=float), len(begins))[:, None]
    return position[..., begins, :] * (1 - share) + position[..., ends, :] * share


def accelerations(place: np.ndarray, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Return accelerations (T, N, 3) m/s² of positions (T, N, 3) m at intervals of `interval` s, and a mask (T,)."""
    lag = max(1, round(SMOOTHING / interval))
    felt, known = np.zeros(place.shape), np.arange(len(place)) >= 2 * lag
    if known.any():
        felt[2 * lag :] = (place[2 * lag :] - 2 * place[lag:-lag] + place[: -2 * lag]) / (lag * interval) ** 2
    return felt, known


def sensor_accelerations(
    position: np.ndarray, points: Sequence[str], sensors: Sequence[str], time: np.ndarray
) -> np.ndarray:
    """Return accelerations (..., T, N, 3) m/s² of `sensors` on a body with points (..., T, P, 3) m; NaN if unknown.

    `sensors` are names in `INERTIAL_POINTS`. The frame interval is the median one of `time` (T,) s.
    """
    place = strapped_positions(position, points)[..., [INERTIAL_POINTS.index(name) for name in sensors], :]
    if len(time) < 2:
        return np.full(place.shape, np.nan)
    felt, known = accelerations(np.moveaxis(place, -3, 0), float(np.median(np.diff(time))))
    felt[~known] = np.nan
    return np.moveaxis(felt, 0, -3)
