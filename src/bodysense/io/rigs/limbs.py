"""Limbs: pairs of mirrored chains, and the joints along them where a leg or an arm bends.

Lengths are medians over frames, so neither the rest pose nor a stretching bone matters. Names only add evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np

from bodysense.io.rigs import words
from bodysense.io.rigs.figure import Figure

ALIKE = 0.25  # share by which the bones of a left and a right limb may differ
SHORTEST = 0.12  # of the longest path down from the root; shorter chains are not limbs
_BRANCHES = 12  # longest branches of a joint that are searched
_FINGERS = 4  # chains on one joint that mark it as the end of a limb
_LONGEST_CHAIN = 18  # points of a limb
_HINT, _CONTRADICTION, _HELPER = 1.5, 1.5, 4.0  # evidence from names

Kind = Literal["leg", "arm"]
NARROWEST: dict[Kind, float] = {"leg": 0.08, "arm": 0.3}  # of a limb's length, between the first joints
ROLES: dict[Kind, tuple[str, str, str]] = {"leg": ("hip", "knee", "ankle"), "arm": ("shoulder", "elbow", "wrist")}


@dataclass(frozen=True, eq=False)
class Tree:
    """A figure in some of its frames, with measured lengths."""

    figure: Figure
    place: np.ndarray  # (S, P, 3) file units

    @cached_property
    def length(self) -> np.ndarray:
        """(P,) median distance from the parent."""
        parents = np.maximum(self.figure.parents, 0)
        return np.median(np.linalg.norm(self.place - self.place[:, parents], axis=-1), axis=0)

    @cached_property
    def reach(self) -> np.ndarray:
        """(P,) longest path down from each point."""
        reach = np.zeros(len(self.length))
        for point in range(len(reach) - 1, 0, -1):  # end sites come last and have no children
            if point >= len(self.figure.joints):
                parent = self.figure.parents[point]
                reach[parent] = max(reach[parent], self.length[point])
        for point in range(len(self.figure.joints) - 1, 0, -1):
            parent = self.figure.parents[point]
            reach[parent] = max(reach[parent], reach[point] + self.length[point])
        return reach

    def distance(self, a: int, b: int) -> float:
        """Return the median distance of two points."""
        return float(np.median(np.linalg.norm(self.place[:, a] - self.place[:, b], axis=-1)))

    def way(self, start: int, chain: Sequence[int]) -> float:
        """Return the length of a chain from the point that carries it."""
        return self.distance(start, chain[0]) + float(sum(self.length[k] for k in chain[1:]))

    def is_straight(self, a: int, b: int, c: int) -> bool:
        """Whether three consecutive points of a chain stay in one line."""
        straight = np.linalg.norm(self.place[:, a] - self.place[:, c], axis=-1).min()
        return bool(straight > 0.97 * (self.length[b] + self.length[c]))

    def parts(self, point: int) -> bool:
        """Whether many chains hang on a point, as fingers on a wrist and toes on a foot."""
        names, children = self.figure.points, self.figure.children[point]
        return sum(self.reach[k] > 0 and not words.is_helper(names[k]) for k in children) >= _FINGERS

    def branches(self, point: int) -> list[int]:
        """Return the longest branches below a point."""
        found = sorted(self.figure.children[point], key=lambda child: -(self.length[child] + self.reach[child]))
        return found[:_BRANCHES]


@dataclass(frozen=True)
class Limb:
    """A pair of mirrored limbs: the three joints of each, and their chains."""

    hub: int  # the joint where both begin
    chains: tuple[tuple[int, ...], tuple[int, ...]]
    picks: tuple[int, int, int]  # indices in the chains of hip, knee, ankle or of shoulder, elbow, wrist
    lengths: tuple[float, float]  # of the two bones
    penalty: float

    @property
    def length(self) -> float:
        """Sum of the two bone lengths."""
        return sum(self.lengths)

    def joints(self, which: int) -> tuple[int, int, int]:
        """Return the three joints of one of the two limbs."""
        first, second, third = self.picks
        chain = self.chains[which]
        return chain[first], chain[second], chain[third]

    def before(self, which: int) -> tuple[int, ...]:
        """Return the points between the hub and the first of the three joints."""
        return self.chains[which][: self.picks[0]]

    def after(self, which: int) -> tuple[int, ...]:
        """Return the points after the last of the three joints, along the chain."""
        return self.chains[which][self.picks[2] + 1 :]


def pairs_of(tree: Tree) -> list[tuple[int, tuple[tuple[int, ...], tuple[int, ...]]]]:
    """Return every hub with two mirrored branches, and the chains down both."""
    least = SHORTEST * max(tree.reach[0], 1e-9)
    found = []
    for hub in range(len(tree.figure.joints)):
        if tree.reach[hub] < least:
            continue
        long = [c for c in tree.branches(hub) if tree.length[c] + tree.reach[c] >= least]
        for a, b in combinations(long, 2):
            chains = _mirrored(tree, hub, a, b)
            if sum(tree.length[k] for k in chains[0]) >= least and len(chains[0]) >= 3:
                found.append((hub, chains))
    return found


def _mirrored(tree: Tree, hub: int, a: int, b: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the longest chains down two branches whose bones are alike, pair by pair."""
    scale = tree.reach[hub]
    one: list[int] = []
    other: list[int] = []
    choices = [(a, b)]
    while choices and len(one) < _LONGEST_CHAIN:
        above = (one[-1], other[-1]) if one else (hub, hub)
        fitting = _alike(tree, above, choices, scale)
        if not fitting and one:  # one side may have an additional joint that does not bend, a twist
            more = [(c, y) for x, y in choices for c in tree.branches(x) if tree.is_straight(above[0], x, c)]
            more += [(x, d) for x, y in choices for d in tree.branches(y) if tree.is_straight(above[1], y, d)]
            fitting = _alike(tree, above, more, scale)
        if not fitting:
            break
        _, x, y = max(fitting)
        one.append(x)
        other.append(y)
        choices = [(c, d) for c in tree.branches(x) for d in tree.branches(y)]
    return tuple(one), tuple(other)


def _alike(
    tree: Tree, above: tuple[int, int], choices: list[tuple[int, int]], scale: float
) -> list[tuple[float, int, int]]:
    """Return pairs of points at equal distances from their parents, each with a score for continuing the chain."""
    fitting = []
    for x, y in choices:
        p, q = tree.distance(above[0], x), tree.distance(above[1], y)
        if abs(p - q) <= ALIKE * max(p, q) + 0.01 * scale:
            way = min(p + tree.reach[x], q + tree.reach[y])
            unlike = abs(p - q) + 0.3 * min(abs(tree.reach[x] - tree.reach[y]), 0.25 * way)  # one hand may hold a sword
            names = [tree.figure.points[k] for k in (x, y)]
            aside = sum(words.is_helper(name) or words.is_end(name) for name in names)
            fitting.append((way - 2 * unlike - 0.1 * aside * way, x, y))
    return fitting


def as_limb(tree: Tree, hub: int, chains: tuple[tuple[int, ...], tuple[int, ...]], kind: Kind) -> Limb | None:
    """Return the three joints of a pair of chains that fit a leg or an arm best; None if nothing fits."""
    joints = sum(1 for a, b in zip(*chains, strict=True) if max(a, b) < len(tree.figure.joints))
    last = next((k for k, (point, _) in enumerate(zip(*chains, strict=True)) if tree.parts(point)), len(chains[0]))
    straight = _Straight(tree, hub, chains)
    best: Limb | None = None
    for first, second, third in combinations(range(len(chains[0])), 3):
        if second >= joints:
            break
        if third > last >= 2:
            continue
        limb = _fit(tree, straight, hub, chains, (first, second, third), kind)
        if limb is not None and (best is None or limb.penalty < best.penalty - 1e-6):
            best = limb
    return best


class _Straight:
    """Distances along and across a pair of chains, the mean of both."""

    def __init__(self, tree: Tree, hub: int, chains: tuple[tuple[int, ...], tuple[int, ...]]) -> None:
        self._places = [tree.place[:, [hub, *chain]] for chain in chains]
        pairs = [zip((hub, *chain), chain, strict=False) for chain in chains]
        lengths = np.mean([[tree.distance(a, b) for a, b in pair] for pair in pairs], axis=0)
        self.way = np.concatenate([[0.0], np.cumsum(lengths)])  # from the hub

    @cached_property
    def _tables(self) -> tuple[np.ndarray, np.ndarray]:
        apart = [np.linalg.norm(p[:, :, None] - p[:, None], axis=-1) for p in self._places]
        return np.mean([np.median(a, axis=0) for a in apart], axis=0), np.min([a.min(axis=0) for a in apart], axis=0)

    def median(self, a: int, b: int) -> float:
        return float(self._tables[0][a, b])

    def least(self, a: int, b: int) -> float:
        return float(self._tables[1][a, b])


def _fit(
    tree: Tree,
    straight: _Straight,
    hub: int,
    chains: tuple[tuple[int, ...], tuple[int, ...]],
    picks: tuple[int, int, int],
    kind: Kind,
) -> Limb | None:
    """Score three points of a pair of chains as the joints of a limb; None if they cannot be."""
    first, second, third = (k + 1 for k in picks)  # the tables begin with the hub
    upper, lower = straight.median(first, second), straight.median(second, third)
    longest = straight.way[-1]
    if min(upper, lower) < 0.08 * longest:
        return None
    before, after = straight.median(0, first), straight.way[-1] - straight.way[third]
    apart = tree.distance(chains[0][picks[0]], chains[1][picks[0]]) / (upper + lower)
    narrowest = NARROWEST[kind]
    penalty = 5 * max(0.0, 1 - apart / narrowest)  # limbs do not begin in one point
    if kind == "leg":
        penalty += (np.log(upper / lower) / 0.25) ** 2 + 4 * max(0.0, before / upper - 0.6)
        penalty += 5 * max(0.0, after / lower - 0.8)
    else:
        penalty += (np.log(upper / lower / 1.05) / 0.3) ** 2 + 3 * max(0.0, before / upper - 1.2)
        penalty += 5 * max(0.0, after / lower - 1.2)
    for a, b in ((first, second), (second, third)):  # a joint between two of the three should not bend
        if b - a > 1:
            way = straight.way[b] - straight.way[a]
            penalty += 20 * max(0.0, 0.97 - straight.least(a, b) / max(way, 1e-9))
    penalty += _hints(tree, chains, picks, kind)
    # If joints coincide, the last hip or knee carries the whole rotation, but the first ankle or wrist does.
    penalty -= 1e-4 * (picks[0] + picks[1] - picks[2])
    return Limb(hub, chains, picks, (upper, lower), float(penalty))


def _hints(
    tree: Tree, chains: tuple[tuple[int, ...], tuple[int, ...]], picks: tuple[int, int, int], kind: Kind
) -> float:
    """Return the penalty of three joints from names; below zero if the names agree."""
    penalty = 0.0
    for role, pick in zip(ROLES[kind], picks, strict=True):
        for chain in chains:
            name = tree.figure.points[chain[pick]]
            hinted = words.parts(name)
            if words.is_helper(name):
                penalty += _HELPER / 2
            elif role in hinted:
                penalty -= _HINT / 2 / (1 + 0.2 * (len(hinted) - 1))
            elif hinted:
                penalty += _CONTRADICTION / 2
            if words.is_end(name) and pick == picks[1]:
                penalty += _CONTRADICTION / 2
    return penalty
