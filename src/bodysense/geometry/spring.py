"""A critically damped spring, solved exactly, so that its motion is independent of the frame rate."""

from __future__ import annotations

import numpy as np

_HALF = 1.6783469900166605  # y·t at which (1 + y t) e^(−y t), the critically damped response, is one half


def spring_step(
    offset: np.ndarray, velocity: np.ndarray, half_life: np.ndarray | float, interval: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray]:
    """Return offset and velocity `interval` s later. An offset at rest halves within `half_life` s."""
    y = _HALF / half_life
    fade, pull = np.exp(-y * interval), velocity + offset * y
    return fade * (offset + pull * interval), fade * (velocity - pull * (y * interval))
