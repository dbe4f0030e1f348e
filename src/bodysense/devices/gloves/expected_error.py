"""Expected errors of a hand's points, by the time for which its markers have been hidden."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, Glove
from bodysense.body.hands.hand import FINGERS, HAND_JOINTS
from bodysense.devices.gloves.fingers import POINT_COUNT

# Fitted to hands of `lab.synthesis.hands` whose markers are hidden at random for 0.05 to 3 s, one or several at once.
SEEN_ERROR, SEEN_TIP_ERROR = 0.001, 0.002  # m, expected error of a point with seen markers
# m/√s: the expected error of a point grows with the square root of the time for which markers have been hidden.
HIDDEN_ERROR, TIP_HIDDEN_ERROR = 0.017, 0.024  # markers near the point are hidden
OTHERS_ERROR = 0.014  # all other markers are hidden
BACK_ERROR = 0.010  # the three alignment markers are hidden
LOST_ERROR = 0.12  # all markers are hidden: hands that stay in place are off by 3 to 6 cm after 0.1 s (docs/gloves.md)
LONGEST = 1.0  # s after which these errors stop growing, except that of a hand with all markers hidden
LARGEST_ERROR = 0.3  # m, upper bound of the error of a hand with all alignment markers hidden
SENSED = 0.06  # s: `LONGEST` for fingers with inertial sensors
_TIPS = np.arange(POINT_COUNT) >= len(HAND_JOINTS)
_SEEN = np.where(_TIPS, SEEN_TIP_ERROR, SEEN_ERROR)  # (21,)
_BACK = list(ALIGNMENT)


class Influence(NamedTuple):
    """How much each marker tells about each point of the hand."""

    share: np.ndarray  # (9, 21) of the point's position; sums to 1 for every point
    growth: np.ndarray  # (9, 21) m/√s: contribution of a hidden marker to the point's expected error


def expected_error(
    hidden: np.ndarray, influence: Influence, sensed: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return expected errors (…, 21) m of points, and the hidden share (…, 21), 0 to 1, of their markers.

    `hidden` (…, 9) s are the times for which markers have been hidden, `sensed` (…, 9) marks those of fingers with
    inertial sensors.
    """
    longest = LONGEST if sensed is None else np.where(sensed, SENSED, LONGEST)
    error = np.sqrt(np.minimum(hidden, longest)) @ influence.growth + _SEEN
    back = np.minimum.reduce(hidden.take(_BACK, axis=-1), axis=-1, keepdims=True)
    if back.any():
        lost = np.minimum.reduce(hidden, axis=-1, keepdims=True)
        error += BACK_ERROR * np.sqrt(np.minimum(back, LONGEST)) + LOST_ERROR * np.sqrt(lost)
        error = np.minimum(error, LARGEST_ERROR)
    return error, np.sign(hidden) @ influence.share


def influence(glove: Glove) -> Influence:
    """Return the influence of a glove's markers."""
    share = _share(glove)
    hidden = np.where(_TIPS, TIP_HIDDEN_ERROR, HIDDEN_ERROR)
    return Influence(share, hidden * share + OTHERS_ERROR / len(share))


def _share(glove: Glove) -> np.ndarray:
    """Return `Influence.share` (9, 21)."""
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
