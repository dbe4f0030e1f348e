"""How far off a hand is expected to be, by how long its markers have been hidden."""

from __future__ import annotations

import numpy as np

from bodysense.body.glove import Glove
from bodysense.body.hand import FINGERS, HAND_JOINTS

SHOWN_ERROR = 0.001  # m, expected of a point whose markers are seen
# m/√s: expected errors of hidden markers grow with the root of time; two-hands, Table 3: 0.56 to 2.09 cm within 0.1 to
# 2 s by the network with one hidden marker, 1.54 to 8.06 cm where nothing moves on.
HIDDEN_ERROR, LOST_ERROR = 0.0146, 0.055
LARGEST_ERROR = 0.3  # m


def expected_error(hidden: np.ndarray, influence: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Errors expected (H, 21) m where markers have been hidden for (H, 9) s, and how much is hidden (H, 21), 0 to 1."""
    root = np.sqrt(hidden)
    error = HIDDEN_ERROR * (root @ influence) + SHOWN_ERROR
    lost = np.minimum.reduce(root, axis=1)
    if lost.any():
        error += (LOST_ERROR * lost)[:, None]
    return np.minimum(error, LARGEST_ERROR), (hidden > 0) @ influence


def influence(glove: Glove) -> np.ndarray:
    """(9, 21): how much each marker tells of where each point of a hand is; of sum 1 for every point."""
    points = ["wrist", *HAND_JOINTS[1:], *(f"{finger}_tip" for finger in FINGERS)]
    back = np.array([carrier == "wrist" for carrier in glove.carried_by], dtype=float)
    rows = np.tile(back / back.sum(), (len(points), 1))
    for finger in FINGERS:
        tip = np.zeros(len(back))
        tip[glove.markers.index(f"{finger}_tip")] = 1.0
        rows[points.index(f"{finger}2")] = 0.5 * (tip + rows[0])
        rows[points.index(f"{finger}3")] = rows[points.index(f"{finger}_tip")] = tip
    middle = glove.markers.index("thumb_middle")
    rows[points.index("thumb2")] = np.eye(len(back))[middle]
    return rows.T
