"""Nearest points of two segments."""

from __future__ import annotations

import numpy as np

TINY = 1e-30  # keeps divisions by zero finite


def nearest_shares(
    uu: np.ndarray, vv: np.ndarray, uv: np.ndarray, uw: np.ndarray, vw: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the shares, 0 to 1, of the nearest points along two segments (Ericson 2005, Collision Detection, 5.1.9).

    For segments p + s·u and q + t·v with w = p − q it takes only inner products (...), and returns s and t (...).
    """
    s = np.minimum(np.maximum((uv * vw - uw * vv) / np.maximum(uu * vv - uv * uv, TINY), 0.0), 1.0)
    t = np.minimum(np.maximum((uv * s + vw) / np.maximum(vv, TINY), 0.0), 1.0)
    s = np.minimum(np.maximum((uv * t - uw) / np.maximum(uu, TINY), 0.0), 1.0)
    return s, t
