"""Search for gloves among unnamed points.

Three points that form the triangle on the back of a hand give its position; other points must match its other markers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import ALIGNMENT, MARKERS
from bodysense.devices.gloves.labels.assignment import assigned_or_none, cost_of
from bodysense.geometry.registration import register

SIDES = ((0, 1), (1, 2), (0, 2))  # sides of the triangle on the back of the hand
_BACK = list(ALIGNMENT)
_THUMB = MARKERS.index("thumb_middle")
_FIRM = [_BACK[0], _BACK[2], _THUMB]  # markers that move little in the hand and distinguish left from right
_UNCERTAIN = 0.8  # extra cost, in markers, of a hand with a hidden marker in `_FIRM` compared with other hands
_TRIED = 8  # triangles that are tested in full: those that match best
_SHARED = len(MARKERS) // 2  # points: two hands that share more exclude each other


class HandReading(NamedTuple):
    """One reading of points as a hand."""

    hand: int  # number of the hand
    cost: float  # cost of the labels: squared distances as shares of the limit, 1 for each hidden marker
    chosen: np.ndarray  # (9,) the point of each marker, −1 if hidden
    size: float  # as a factor of the template's
    flat: np.ndarray  # (9, 3) m, markers of the flat hand at this position

    @property
    def points(self) -> np.ndarray:
        """Indices of the points of the hand."""
        return self.chosen[self.chosen >= 0]

    @property
    def certain(self) -> bool:
        """Whether the markers are seen that distinguish a left hand from a right one and from one turned round."""
        return bool((self.chosen[_FIRM] >= 0).all())

    def same_as(self, other: HandReading) -> bool:
        """Whether two readings are the same hand in the same position."""
        both = (self.chosen[_BACK] >= 0) & (other.chosen[_BACK] >= 0)
        return self.hand == other.hand and both.sum() > 1 and bool((self.chosen == other.chosen)[_BACK][both].all())

    def excludes(self, other: HandReading) -> bool:
        """Whether at most one of two readings can be right: they are different but share most points."""
        return not self.same_as(other) and len(np.intersect1d(self.points, other.points)) > _SHARED


def range_distances(local: np.ndarray, ranges: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """Return squared distances (..., 9, N) of points from the range of each marker, as a share of the limit.

    Args:
        local: (..., N, 3) m, points in the hand's axes.
        ranges: (9, K, 3) m, possible positions of markers.
        allowed: (9, 1) m², largest squared distance from them.
    """
    inner = local.reshape(-1, 3) @ ranges.reshape(-1, 3).T
    squared = (ranges**2).sum(axis=-1) - 2 * inner.reshape(-1, *ranges.shape[:2])
    nearest = squared.min(axis=-1) + (local.reshape(-1, 3) ** 2).sum(axis=-1)[:, None]
    return np.maximum(nearest.reshape(*local.shape[:-1], -1).swapaxes(-1, -2), 0.0) / allowed


def find_hands(
    hand: int,
    place: np.ndarray,
    template: np.ndarray,
    ranges: np.ndarray,
    allowed: np.ndarray,
    stiffness: float,
    sizes: tuple[float, float],
    fewest: int,
    worst: float,
    without_wrist: bool,
) -> list[HandReading]:
    """Return the most likely readings of points as a left hand.

    Args:
        hand: number of the hand.
        place: (N, 3) m, points.
        template: (9, 3) m, markers of a flat hand.
        ranges: (9, K, 3) m, possible positions of markers (`hand_shapes.marker_ranges`).
        allowed: (9, 1) m², largest squared distance of markers from them.
        stiffness: m by which the sides of the triangle on the back of the hand may differ from the template's.
        sizes: smallest and largest factor of the template.
        fewest: least number of seen markers.
        worst: mean squared distance, as a share of the limit, from which a reading is dropped.
        without_wrist: also search by the thumb for hands with a hidden wrist marker; best if the size is known.
    """
    if len(place) < fewest:
        return []
    triangles = [_triangles(place, template[None, _BACK], stiffness, sizes)]
    if without_wrist:
        thumbs = np.unique(ranges[_THUMB].round(4), axis=0)
        bases = np.broadcast_to(template[_FIRM[:2]], (len(thumbs), 2, 3))
        triangles.append(_triangles(place, np.concatenate([bases, thumbs[:, None]], axis=1), stiffness, sizes))
    rotation, translation, size = (np.concatenate(parts) for parts in zip(*triangles, strict=True))
    if not len(size):
        return []
    local = (place - translation[:, None]) @ rotation / size[:, None, None]  # (K, N, 3)
    distances = range_distances(local, ranges, allowed)  # (K, 9, N)
    found = []
    for triple in np.argsort(np.minimum(distances.min(axis=-1), 1.0).sum(axis=-1))[:_TRIED]:
        chosen = assigned_or_none(np.where(distances[triple] < 1, distances[triple], np.inf))
        cost = cost_of(distances[triple], chosen)
        fit = cost - (chosen < 0).sum()
        if fit < worst * (chosen >= 0).sum() >= worst * fewest:
            flat = size[triple] * template @ rotation[triple].T + translation[triple]
            found.append(HandReading(hand, cost, chosen, float(size[triple]), flat))
    return found


def _triangles(
    place: np.ndarray, corners: np.ndarray, stiffness: float, sizes: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rotations (K, 3, 3), translations (K, 3) m and sizes (K,) of hands with a triangle among points (N, 3) m.

    `corners` (V, 3, 3) m are variants of the triangle; each three points are compared with the most similar one.
    """
    apart = np.linalg.norm(place[:, None] - place, axis=-1)
    sides = np.stack(np.broadcast_arrays(apart[:, :, None], apart[None], apart[:, None]), axis=-1)  # (N, N, N, 3)
    usual = np.stack([np.linalg.norm(corners[:, a] - corners[:, b], axis=-1) for a, b in SIDES], axis=-1)  # (V, 3)
    total = sides.sum(axis=-1)
    possible = np.argwhere(
        (total > sizes[0] * usual.sum(axis=-1).min()) & (total < sizes[1] * usual.sum(axis=-1).max())
    )
    sides, total = sides[tuple(possible.T)], total[tuple(possible.T)]
    factor = total[:, None] / usual.sum(axis=-1)  # (K, V)
    difference = np.abs(sides[:, None] - factor[..., None] * usual).max(axis=-1)
    difference = np.where((factor > sizes[0]) & (factor < sizes[1]), difference, np.inf)
    best = difference.argmin(axis=1) if len(difference) else np.zeros(0, dtype=int)
    rows = np.flatnonzero(difference[np.arange(len(difference)), best] < stiffness)
    size, best = factor[rows, best[rows]], best[rows]
    if not len(rows):
        return np.zeros((0, 3, 3)), np.zeros((0, 3)), size
    scaled = size[:, None, None] * corners[best]
    rotation, translation = register(scaled, place[possible[rows]], np.ones(scaled.shape[:2], dtype=bool))
    return rotation, translation, size


def most_certain(hands: list[HandReading], margin: float) -> HandReading | None:
    """Return the most likely certain hand that costs over `margin` less than every hand that it excludes, or None."""
    for hand in sorted(hands, key=lambda one: one.cost):
        if hand.certain and all(
            other.cost + _UNCERTAIN * (not other.certain) > hand.cost + margin
            for other in hands
            if hand.excludes(other)
        ):
            return hand
    return None
