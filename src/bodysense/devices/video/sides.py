"""Left and right of a body: where a pose landmarker suddenly takes somebody for their own back, it is put right.

It does so where it sees no face: left and right change places from one picture to the next, and depth is turned round.
Nobody turns as fast; the labels of the hands tell who is right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.devices.video.landmarks import BODY_LANDMARKS

_PARTS = ("shoulder", "elbow", "wrist", "hip")
_SIDES = np.array([[BODY_LANDMARKS.index(f"{side}_{part}") for part in _PARTS] for side in ("left", "right")])
_OTHER = {"left": "right", "right": "left"}
_MIRROR = np.array([1.0, 1.0, -1.0])
_NEAR = 0.5  # share of the way to the last places that is left when sides are exchanged
_WIDE = 0.3  # of the body's size: shoulders that are seen so narrow turn
_GAP = 0.3  # s after which last places say nothing
_PATIENCE = 1.0  # s for which a body is kept from turning without a word of its hands
_SURE = 0.5  # of the hands' labels, −2 to 2: from which they decide


def _exchanged() -> np.ndarray:
    """(33,) where each landmark's counterpart is."""
    names = (name.split("_", 1) for name in BODY_LANDMARKS)
    return np.array([BODY_LANDMARKS.index("_".join([_OTHER.get(side, side), *rest])) for side, *rest in names])


EXCHANGED = _exchanged()


@dataclass(frozen=True, eq=False)
class LastSides:
    """A body whose shoulders were seen apart: its places (33, 2), when, and since when it is kept from turning."""

    time: float
    places: np.ndarray
    since: float | None = None


def exchange(world: np.ndarray, places: np.ndarray, visible: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Landmarks (33, …) of a body with left and right exchanged, and its depth turned round."""
    return world[EXCHANGED] * _MIRROR, places[EXCHANGED], visible[EXCHANGED]


def is_turned_round(time: float, places: np.ndarray, size: float, labels: float, last: LastSides | None) -> bool:
    """Whether places (33, 2) have left and right exchanged, beside those of the picture before.

    `labels` sums over the hands at its wrists how much they are of those sides, from −1 to 1 each.
    """
    if last is None or time - last.time > _GAP:
        return False
    if _width(places) < _WIDE * size or _away(places[EXCHANGED], last.places) > _NEAR * _away(places, last.places):
        return False
    if abs(labels) >= _SURE:
        return labels < 0
    return last.since is None or time - last.since <= _PATIENCE


def remembered(time: float, places: np.ndarray, size: float, is_kept: bool, last: LastSides | None) -> LastSides | None:
    """What is remembered after a picture in which the body was put right, or was not."""
    if _width(places) < _WIDE * size:
        return last
    since = None if not is_kept else time if last is None or last.since is None else last.since
    return LastSides(time, places, since)


def _width(places: np.ndarray) -> float:
    """Across the picture, from one shoulder to the other."""
    return float(np.linalg.norm(places[_SIDES[0, 0]] - places[_SIDES[1, 0]]))


def _away(places: np.ndarray, last: np.ndarray) -> float:
    return float(np.linalg.norm(places[_SIDES] - last[_SIDES], axis=-1).sum())
