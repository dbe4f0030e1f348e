"""Collision pairs of hands: which capsules of a few hands are near each other, and where."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations

import numpy as np

from bodysense.body.hands.hand import Side
from bodysense.body.hands.hand_capsules import GIVE, NAMES, axes_between, hand_capsules, nearest_points, own_pairs
from bodysense.body.skeleton import Skeleton

COUNT = len(NAMES)
_LAST = np.array([name.endswith("3") for name in NAMES])
_THUMB = np.array([name.startswith("thumb") for name in NAMES])
_MARGIN = 0.01  # m: hands closer than this are tested against each other


@dataclass(frozen=True, eq=False)
class CapsulePairs:
    """P pairs of capsules; capsule c of hand h is number h · C + c. C = `COUNT`."""

    capsule: np.ndarray  # (2, P) the first and the second capsule
    reach: np.ndarray = field(repr=False)  # (P,) m: axes closer than this collide
    tips: np.ndarray = field(repr=False)  # (N,) pairs of last segments: of thumb and finger, or of two hands


@dataclass(frozen=True, eq=False)
class NearestPoints:
    """Nearest points of the axes of P pairs."""

    distance: np.ndarray  # (P,) m, between the axes
    place: np.ndarray  # (2, P, 3) m, world: the nearest points on both axes


@dataclass(frozen=True, eq=False)
class HandColliders:
    """Capsules of H hands, given by their skeletons as left hands and their sides."""

    hands: Sequence[Skeleton]
    sides: Sequence[Side]

    @cached_property
    def flip(self) -> np.ndarray:
        """(H, 3) factors from a hand's own mirrored world to the world."""
        return np.array([[-1.0 if side == "right" else 1.0, 1.0, 1.0] for side in self.sides])

    def pairs(self, position: np.ndarray) -> CapsulePairs:
        """Return the pairs that may collide in hands with points at (H, 21, 3) m.

        Pairs of two hands are included only if the hands are near each other.
        """
        world = position * self.flip[:, None]
        low, high = world.min(axis=1), world.max(axis=1)
        gap = np.maximum(low[:, None] - high, low - high[:, None]).max(axis=-1)  # (H, H)
        near = np.triu(gap < 2 * self._radius.max() + _MARGIN, k=1)
        return self._all if near.any() else self._own

    def nearest(self, position: np.ndarray, pairs: CapsulePairs) -> NearestPoints:
        """Return the nearest points of pairs in hands with points at (H, 21, 3) m."""
        axes = axes_between(position * self.flip[:, None], self._share)
        start, along = (part.reshape(-1, 3)[pairs.capsule] for part in axes)
        place = np.stack(nearest_points(start[0], along[0], start[1], along[1]))
        return NearestPoints(np.linalg.norm(place[1] - place[0], axis=-1), place)

    @cached_property
    def _share(self) -> np.ndarray:
        return np.stack([hand_capsules(hand).share for hand in self.hands])

    @cached_property
    def _radius(self) -> np.ndarray:
        return np.concatenate([hand_capsules(hand).radius for hand in self.hands])

    @cached_property
    def _own(self) -> CapsulePairs:
        """The pairs within each hand."""
        each = np.array(own_pairs())
        return self._pairs(*np.concatenate([each + hand * COUNT for hand in range(len(self.hands))], axis=1))

    @cached_property
    def _all(self) -> CapsulePairs:
        """The pairs within each hand and those of every two hands."""
        every, couples = np.indices((COUNT, COUNT)).reshape(2, -1), combinations(range(len(self.hands)), 2)
        mutual = [every + COUNT * np.array([[one], [other]]) for one, other in couples]
        return self._pairs(*np.concatenate([self._own.capsule, *mutual], axis=1))

    def _pairs(self, first: np.ndarray, second: np.ndarray) -> CapsulePairs:
        one, other = first % COUNT, second % COUNT
        tips = _LAST[one] & _LAST[other] & (_THUMB[one] | (first // COUNT != second // COUNT))
        reach = (1 - GIVE) * (self._radius[first] + self._radius[second])
        return CapsulePairs(np.stack([first, second]), reach, np.flatnonzero(tips))
