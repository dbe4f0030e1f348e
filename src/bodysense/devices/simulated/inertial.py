"""What inertial sensors strapped along bones feel: accelerations without gravity, smoothed as sensors smooth them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

ALONG = 0.8  # of the bone from its joint: above the ankle, the wrist, the knee
SMOOTHING = 0.066  # s: an acceleration is that of twice this time before it, and uses nothing that comes after
_AT_JOINT = ("pelvis", "spine3")
_ENDS = {"hip": "knee", "knee": "ankle", "ankle": "foot", "shoulder": "elbow", "elbow": "wrist"}
# What may carry a sensor, and the point toward which it sits along the bone; None: at the joint itself.
STRAPPED: dict[str, str | None] = {
    **dict.fromkeys(_AT_JOINT),
    **{f"{side}_{joint}": f"{side}_{end}" for joint, end in _ENDS.items() for side in ("left", "right")},
}


def strapped_places(position: np.ndarray, points: Sequence[str], along: float | np.ndarray = ALONG) -> np.ndarray:
    """Places (..., 12, 3) m of the sensors of `STRAPPED`, `along` their bones, of points (..., P, 3) m so named."""
    begins = [points.index(name) for name in STRAPPED]
    ends = [points.index(end or name) for name, end in STRAPPED.items()]
    share = np.broadcast_to(np.asarray(along, dtype=float), len(begins))[:, None]
    return position[..., begins, :] * (1 - share) + position[..., ends, :] * share


def accelerations(place: np.ndarray, interval: float) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations (T, N, 3) m/s² of places (T, N, 3) m every `interval` s, and from when they are known (T,) bool."""
    lag = max(1, round(SMOOTHING / interval))
    felt, known = np.zeros(place.shape), np.arange(len(place)) >= 2 * lag
    if known.any():
        felt[2 * lag :] = (place[2 * lag :] - 2 * place[lag:-lag] + place[: -2 * lag]) / (lag * interval) ** 2
    return felt, known
