"""Which capsules of a few hands meet, all pairs at once from inner products."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from math import dist

import numpy as np

from bodysense.body.capsules import TINY
from bodysense.body.hand import HAND_JOINTS, Side, point_beyond
from bodysense.body.hand_capsules import GIVE, NAMES, hand_capsules, own_pairs
from bodysense.body.skeleton import Skeleton

COUNT = len(NAMES)
_LAST = np.array([name.endswith("3") for name in NAMES])
_THUMB = np.array([name.startswith("thumb") for name in NAMES])
_MARGIN = 0.01  # m: gaps narrower than this are looked at
_KNUCKLE = HAND_JOINTS.index("middle1")


@dataclass(frozen=True, eq=False)
class Pairs:
    """P pairs of capsules; capsule c of hand h is number h · C + c. C = `COUNT`."""

    capsule: np.ndarray  # (2, P) the first, the second
    start: np.ndarray = field(
        repr=False
    )  # (2, P) where they begin among the axes of all; COUNT on, from there to the end
    reach: np.ndarray = field(repr=False)  # (P,) m: nearer than this they collide
    squared: np.ndarray = field(repr=False)  # (3, P) m², lengths of their axes, m⁴, of both
    inverse: np.ndarray = field(repr=False)  # (2, P) of their squares, m⁻²
    tips: np.ndarray = field(repr=False)  # (N,) those of last segments of thumb and finger, or of two hands
    products: np.ndarray = field(repr=False)  # (8, P) where in the matrix of all inner products theirs are


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
        middle = (position[:, _KNUCKLE] * self.flip).tolist()
        couples = list(combinations(range(len(middle)), 2))
        if all(dist(middle[one], middle[other]) > self._near for one, other in couples):
            return self._own
        world, (one, other) = position * self.flip[:, None], np.array(couples).T
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
        """m: hands whose middle knuckles are farther apart cannot meet."""
        return float(2 * max(np.linalg.norm(hand.path @ hand.rest_offset, axis=1).max() for hand in self.hands))

    @cached_property
    def _thick(self) -> float:
        """m: hands whose points' boxes are farther apart cannot meet."""
        return float(2 * max(hand_capsules(hand).radius.max() for hand in self.hands) + _MARGIN)


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
    products = (product(u, v), product(u, p), product(v, p), product(p, p))
    products += (product(u, q), product(v, q), product(p, q), product(q, q))
    return Pairs(
        np.stack([first, second]),
        np.stack([p, q]),
        (1 - GIVE) * (radius[first] + radius[second]),
        np.stack([length[first], length[second], length[first] * length[second]]),
        1 / np.maximum([length[first], length[second]], TINY),
        np.flatnonzero(_LAST[first % COUNT] & _LAST[second % COUNT] & (_THUMB[first % COUNT] | ~own)),
        np.stack(products),
    )


def meet(axes: np.ndarray, pairs: Pairs) -> Meeting:
    """How near pairs are whose capsules lie at `axes` (H · 2C, 3) m."""
    products = (axes @ axes.T).take(pairs.products)
    uv, pq, qq = products[0], products[6], products[7]
    uw, vw, pw = products[1:4] - products[4:7]  # of w = p − q
    (uu, vv, uuvv), (per_uu, per_vv) = pairs.squared, pairs.inverse
    # `capsules.nearest_shares`, where lengths are known before.
    s = np.minimum(np.maximum((uv * vw - uw * vv) / np.maximum(uuvv - uv * uv, TINY), 0.0), 1.0)
    t = np.minimum(np.maximum((uv * s + vw) * per_vv, 0.0), 1.0)
    over = uv * t - uw
    s = np.minimum(np.maximum(over * per_uu, 0.0), 1.0)
    squared = pw - pq + qq + s * (s * uu - over - over) + t * (t * vv - vw - vw)
    return Meeting(axes, np.maximum(squared, 0.0), (s, t))


def points_on(axes: np.ndarray, start: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(..., 3) m: points on capsules that `start` (...) among the axes, `along` (...) of the way."""
    return axes.take(start, axis=0) + along[..., None] * axes.take(start + COUNT, axis=0)
