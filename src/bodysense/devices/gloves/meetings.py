"""Which capsules of a few hands meet, all pairs at once from inner products."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations

import numpy as np

from bodysense.body.capsules import nearest_shares
from bodysense.body.hand import HAND_JOINTS, Side
from bodysense.body.hand_capsules import GIVE, NAMES, hand_capsules, own_pairs, point_beyond
from bodysense.body.skeleton import Skeleton

COUNT = len(NAMES)
_LAST = np.array([name.endswith("3") for name in NAMES])
_THUMB = np.array([name.startswith("thumb") for name in NAMES])
_MARGIN = 0.01  # m: gaps narrower than this are looked at
_KNUCKLE = HAND_JOINTS.index("middle1")


@dataclass(frozen=True, eq=False)
class Pairs:
    """P pairs of capsules; capsule c of hand h is number h · C + c. C = `COUNT`."""

    first: np.ndarray  # (P,)
    second: np.ndarray  # (P,)
    reach: np.ndarray = field(repr=False)  # (P,) m: nearer than this they collide
    squared: tuple[np.ndarray, np.ndarray] = field(repr=False)  # (P,), (P,) m², lengths of their axes
    tips: np.ndarray = field(repr=False)  # (P,) whether they are thumb's and finger's, or two hands', last segments
    products: np.ndarray = field(repr=False)  # (8, P) where in the matrix of all inner products theirs are

    def __getitem__(self, key: np.ndarray) -> Pairs:
        """Some of them."""
        squared = (self.squared[0][key], self.squared[1][key])
        return Pairs(self.first[key], self.second[key], self.reach[key], squared, self.tips[key], self.products[:, key])


@dataclass(frozen=True, eq=False)
class Meeting:
    """How near pairs are, and where."""

    axes: np.ndarray  # (H · 2C, 3) m: of each hand where its capsules begin, and from there to their ends
    squared: np.ndarray  # (P,) m² distance of their axes
    along: tuple[np.ndarray, np.ndarray]  # (P,), (P,) how far along each axis, 0 to 1, the nearest points lie


@dataclass(frozen=True, eq=False)
class HandFlesh:
    """The capsules of H hands: their skeletons as left hands, and which hand each is."""

    hands: Sequence[Skeleton]
    sides: Sequence[Side]

    @cached_property
    def flip(self) -> np.ndarray:
        """(H, 3) from a hand's own mirrored world to the world."""
        return np.array([[-1.0 if side == "right" else 1.0, 1.0, 1.0] for side in self.sides])

    def pairs(self, position: np.ndarray) -> Pairs:
        """The pairs that may meet of hands whose points are at (H, 21, 3) m: of two hands only where they are near."""
        if len(self.hands) == 1:
            return self._own
        one, other = self._couples
        middle = position[:, _KNUCKLE] * self.flip
        apart = middle[one] - middle[other]
        if not ((apart * apart).sum(axis=1) < self._near).any():
            return self._own
        world = position * self.flip[:, None]
        low, high = world.min(axis=1), world.max(axis=1)
        gap = np.maximum(low[one] - high[other], low[other] - high[one]).max(axis=1)
        return self._all if (gap < self._thick).any() else self._own

    def axes(self, position: np.ndarray) -> np.ndarray:
        """(H · 2C, 3) m: where all capsules lie in the world, for `meet`."""
        return (self._mix @ (position * self.flip[:, None])).reshape(-1, 3)

    @cached_property
    def _mix(self) -> np.ndarray:
        return np.stack([capsule_mix(hand) for hand in self.hands])

    @cached_property
    def _own(self) -> Pairs:
        return pairs_of(self.hands, mutual=False)

    @cached_property
    def _all(self) -> Pairs:
        return pairs_of(self.hands, mutual=True)

    @cached_property
    def _near(self) -> float:
        """m²: hands whose middle knuckles are farther apart cannot meet."""
        return float((2 * max(np.linalg.norm(hand.path @ hand.rest_offset, axis=1).max() for hand in self.hands)) ** 2)

    @cached_property
    def _thick(self) -> float:
        """m: hands whose points' boxes are farther apart cannot meet."""
        return float(2 * max(hand_capsules(hand).radius.max() for hand in self.hands) + _MARGIN)

    @cached_property
    def _couples(self) -> np.ndarray:
        """(2, K) every two hands."""
        return np.array(list(combinations(range(len(self.hands)), 2)), dtype=np.intp).reshape(-1, 2).T


def capsule_mix(hand: Skeleton) -> np.ndarray:
    """(2C, P): capsules' starts, then their axes from start to end, as mixtures of a hand's points (P, 3)."""
    capsules, mix = hand_capsules(hand), np.zeros((2, COUNT, len(hand.points)))
    for place, name in enumerate(NAMES):
        palm = name.startswith("palm_")
        near = hand.index("wrist" if palm else name)
        far = hand.index(f"{name.removeprefix('palm_')}1" if palm else point_beyond(name))
        bone = hand.rest_offset[far]
        begin, end = (float(part[place] @ bone / (bone @ bone)) for part in (capsules.start, capsules.end))
        mix[0, place, near], mix[0, place, far] = 1 - begin, begin
        mix[1, place, near], mix[1, place, far] = begin - end, end - begin
    return mix.reshape(2 * COUNT, -1)


def pairs_of(hands: Sequence[Skeleton], mutual: bool) -> Pairs:
    """The pairs within each hand and, if `mutual`, of every two hands."""
    own = np.array(own_pairs())
    rows = [own + hand * COUNT for hand in range(len(hands))]
    if mutual:
        every = np.indices((COUNT, COUNT)).reshape(2, -1)
        rows += [every + np.array([[one], [other]]) * COUNT for one, other in combinations(range(len(hands)), 2)]
    first, second = np.concatenate(rows, axis=1)
    capsules = [hand_capsules(hand) for hand in hands]
    radius = np.concatenate([one.radius for one in capsules])
    length = np.concatenate([np.sum((one.end - one.start) ** 2, axis=1) for one in capsules])
    size = 2 * COUNT * len(hands)

    def product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return one * size + other

    p, q = (2 * COUNT * (number // COUNT) + number % COUNT for number in (first, second))
    u, v = p + COUNT, q + COUNT
    own = first // COUNT == second // COUNT
    products = (product(u, v), product(u, p), product(u, q), product(v, p), product(v, q), product(p, p), product(q, q))
    return Pairs(
        first,
        second,
        (1 - GIVE) * (radius[first] + radius[second]),
        (length[first], length[second]),
        _LAST[first % COUNT] & _LAST[second % COUNT] & (_THUMB[first % COUNT] | ~own),
        np.stack([*products, product(p, q)]),
    )


def meet(axes: np.ndarray, pairs: Pairs) -> Meeting:
    """How near pairs are whose capsules lie at `axes` (H · 2C, 3) m."""
    uv, up, uq, vp, vq, pp, qq, pq = (axes @ axes.T).take(pairs.products)
    uw, vw = up - uq, vp - vq
    uu, vv = pairs.squared
    s, t = nearest_shares(uu, vv, uv, uw, vw)
    squared = pp + qq - 2 * (pq + s * t * uv - s * uw + t * vw) + s * s * uu + t * t * vv
    return Meeting(axes, np.maximum(squared, 0.0), (s, t))


def nearest(pairs: Pairs, meeting: Meeting, gap: float) -> tuple[Pairs, Meeting]:
    """The pairs whose gap is less, m."""
    near = np.flatnonzero(meeting.squared < (pairs.reach + gap) ** 2)
    along = (meeting.along[0][near], meeting.along[1][near])
    return pairs[near], Meeting(meeting.axes, meeting.squared[near], along)


def points_on(axes: np.ndarray, capsule: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(K, 3) m: points on the axes of capsules (K,), `along` (K,) of the way from their starts."""
    place = 2 * COUNT * (capsule // COUNT) + capsule % COUNT
    return axes[place] + along[:, None] * axes[place + COUNT]
