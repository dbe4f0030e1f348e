"""Gloves among unnamed points: three of them form the triangle on the back of a hand, the others are where it says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bodysense.body.glove import ALIGNMENT, MARKERS
from bodysense.body.registration import register
from bodysense.devices.gloves.assignment import assigned_or_none, cost_of

SIDES = ((0, 1), (1, 2), (0, 2))  # of the triangle on the back of the hand
_BACK = list(ALIGNMENT)
_THUMB = MARKERS.index("thumb_middle")
_FIRM = [_BACK[0], _BACK[2], _THUMB]  # these move little in the hand, and tell a left one from a right one
_UNCERTAIN = 0.8  # markers that a hand costs more beside others if its thumb or a finger's base is hidden
_TRIED = 8  # triangles, those whose hands look best, that are looked at in full
_SHARED = len(MARKERS) // 2  # points: two hands that share more are two readings of one


class FoundHand(NamedTuple):
    """A hand that may be there."""

    hand: int  # which
    cost: float  # of its labels: squared distances as shares of the limit, more for hidden markers
    chosen: np.ndarray  # (9,) the point of each marker, −1 hidden
    size: float  # as a factor of the template's
    flat: np.ndarray  # (9, 3) m, where it would have its markers if it were flat

    @property
    def points(self) -> np.ndarray:
        """Those that it takes."""
        return self.chosen[self.chosen >= 0]

    @property
    def certain(self) -> bool:
        """Whether it shows what tells a left hand from a right one, and a hand from another turned round."""
        return bool((self.chosen[_FIRM] >= 0).all())

    def same_as(self, other: FoundHand) -> bool:
        """Whether it is the same hand in the same place."""
        both = (self.chosen[_BACK] >= 0) & (other.chosen[_BACK] >= 0)
        return self.hand == other.hand and both.sum() > 1 and bool((self.chosen == other.chosen)[_BACK][both].all())

    def excludes(self, other: FoundHand) -> bool:
        """Whether one of the two at most is there: most of their points are the same, and they are not."""
        return not self.same_as(other) and len(np.intersect1d(self.points, other.points)) > _SHARED


def unlikeness(local: np.ndarray, ranges: np.ndarray, allowed: np.ndarray) -> np.ndarray:
    """(..., 9, N) how far points (..., N, 3) m are from where a hand can have each marker: squared, as a share.

    Points are in the hand; `ranges` (9, K, 3) m is where it can have its markers and `allowed` (9, 1) m² how far,
    squared, they may be from there.
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
) -> list[FoundHand]:
    """The likeliest readings of points (N, 3) m as a left hand.

    Args:
        hand: which it is.
        place: (N, 3) m, points.
        template: (9, 3) m, markers of a flat hand.
        ranges: (9, K, 3) m, where the hand can have its markers (`hand_family.marker_ranges`).
        allowed: (9, 1) m², how far, squared, markers may be from there.
        stiffness: m by which the sides of the triangle on the back of the hand may differ from the template's.
        sizes: smallest and largest factor of the template.
        fewest: markers that must be there.
        worst: mean of their squared distances, as shares of what is allowed, that makes no hand.
        without_wrist: look as well for a hand whose wrist is hidden, by its thumb: best where its size is known.
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
    unlike = unlikeness(local, ranges, allowed)  # (K, 9, N)
    found = []
    for triple in np.argsort(np.minimum(unlike.min(axis=-1), 1.0).sum(axis=-1))[:_TRIED]:
        chosen = assigned_or_none(np.where(unlike[triple] < 1, unlike[triple], np.inf))
        cost = cost_of(unlike[triple], chosen)
        fit = cost - (chosen < 0).sum()
        if fit < worst * (chosen >= 0).sum() >= worst * fewest:
            flat = size[triple] * template @ rotation[triple].T + translation[triple]
            found.append(FoundHand(hand, cost, chosen, float(size[triple]), flat))
    return found


def _triangles(
    place: np.ndarray, corners: np.ndarray, stiffness: float, sizes: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations (K, 3, 3), translations (K, 3) m and sizes (K,) of hands that have a triangle among points (N, 3) m.

    `corners` (V, 3, 3) m gives what the triangle may be like; of each three points, the likest counts.
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
    off = np.abs(sides[:, None] - factor[..., None] * usual).max(axis=-1)
    off = np.where((factor > sizes[0]) & (factor < sizes[1]), off, np.inf)
    likest = off.argmin(axis=1) if len(off) else np.zeros(0, dtype=int)
    rows = np.flatnonzero(off[np.arange(len(off)), likest] < stiffness)
    size, likest = factor[rows, likest[rows]], likest[rows]
    if not len(rows):
        return np.zeros((0, 3, 3)), np.zeros((0, 3)), size
    scaled = size[:, None, None] * corners[likest]
    rotation, translation = register(scaled, place[possible[rows]], np.ones(scaled.shape[:2], dtype=bool))
    return rotation, translation, size


def surest(hands: list[FoundHand], margin: float) -> FoundHand | None:
    """The likeliest certain hand whose points make no other one nearly as well: all those cost `margin` more."""
    for hand in sorted(hands, key=lambda one: one.cost):
        if hand.certain and all(
            other.cost + _UNCERTAIN * (not other.certain) > hand.cost + margin
            for other in hands
            if hand.excludes(other)
        ):
            return hand
    return None
