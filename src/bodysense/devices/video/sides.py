"""Correction of a pose landmarker that suddenly mistakes the front of a body for its back.

Without a visible face, the landmarker may exchange left and right from one picture to the next and invert depth. People
cannot turn that fast. If hands are found, their labels decide which side is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.devices.video.landmarks import BODY_LANDMARKS

_PARTS = ("shoulder", "elbow", "wrist", "hip")
_SIDES = np.array([[BODY_LANDMARKS.index(f"{side}_{part}") for part in _PARTS] for side in ("left", "right")])
_OTHER = {"left": "right", "right": "left"}
_MIRROR = np.array([1.0, 1.0, -1.0])
_NEAR = 0.5  # ratio of distances to the last positions, with and without exchange, below which sides are exchanged
_WIDE = 0.3  # width of shoulders, as a share of the body's size, below which the body is seen from its side
_GAP = 0.3  # s after which last positions are ignored
_PATIENCE = 1.0  # s for which sides are exchanged without labels of hands
_SURE = 0.5  # least sum of the hands' labels, −2 to 2, that decides


EXCHANGED = np.array(  # (33,) index of each landmark's counterpart
    [
        BODY_LANDMARKS.index("_".join([_OTHER.get(side, side), *rest]))
        for side, *rest in (name.split("_", 1) for name in BODY_LANDMARKS)
    ]
)


@dataclass(frozen=True, eq=False)
class SideState:
    """Last sighting of a body from its front or back."""

    time: float  # s
    places: np.ndarray  # (33, 2) positions of landmarks in the picture
    since: float | None = None  # s, time since which sides have been exchanged; None: they are not


def exchange(world: np.ndarray, places: np.ndarray, visible: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Exchange left and right of a body's landmarks (33, …) and invert its depth."""
    return world[EXCHANGED] * _MIRROR, places[EXCHANGED], visible[EXCHANGED]


def detect_exchange(time: float, places: np.ndarray, size: float, labels: float, last: SideState | None) -> bool:
    """Return whether left and right of positions (33, 2) are exchanged, compared with the picture before.

    `labels` is the sum over the hands at its wrists of the agreement of their labels with the wrists' sides, −1 to 1
    each.
    """
    if last is None or time - last.time > _GAP:
        return False
    if _width(places) < _WIDE * size or _away(places[EXCHANGED], last.places) > _NEAR * _away(places, last.places):
        return False
    if abs(labels) >= _SURE:
        return labels < 0
    return last.since is None or time - last.since <= _PATIENCE


def update_sides(
    time: float, places: np.ndarray, size: float, is_exchanged: bool, last: SideState | None
) -> SideState | None:
    """Return the last sighting after a picture with `places` (33, 2); `is_exchanged`: the body was corrected."""
    if _width(places) < _WIDE * size:
        return last
    since = None if not is_exchanged else time if last is None or last.since is None else last.since
    return SideState(time, places, since)


def _width(places: np.ndarray) -> float:
    """Return the distance in the picture from one shoulder to the other."""
    return float(np.linalg.norm(places[_SIDES[0, 0]] - places[_SIDES[1, 0]]))


def _away(places: np.ndarray, last: np.ndarray) -> float:
    return float(np.linalg.norm(places[_SIDES] - last[_SIDES], axis=-1).sum())
