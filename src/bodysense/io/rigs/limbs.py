"""Legs and arms of a tree: by the names of their joints, else by structure; and the joints at their ends.

Names decide if they tell all six joints of both limbs and the tree agrees. Else a limb is a pair of chains that mirror
each other, whose lengths and bends are those of a leg or an arm. Lengths are medians over frames, so neither the rest
pose nor a stretching bone matters.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations
from typing import Literal

import numpy as np

from bodysense.body.hand import FINGERS
from bodysense.io.rigs.figure import Tree
from bodysense.io.rigs.names import every_part, first_is_left, is_end, is_helper, parts, words

Kind = Literal["leg", "arm"]
Pair = tuple[tuple[int, ...], tuple[int, ...]]  # chains of points of two mirrored limbs
ROLES: dict[Kind, tuple[str, str, str]] = {"leg": ("hip", "knee", "ankle"), "arm": ("shoulder", "elbow", "wrist")}

_ALIKE = 0.25  # share by which the bones of a left and a right limb may differ
_SHORTEST = 0.12  # of the longest path down from the root; shorter chains are not limbs
_FINGERS = 4  # chains on one joint that mark it as the end of a limb
_LONGEST_CHAIN = 18  # points of a limb
_ASIDE = 0.1  # of a branch's length, by which ends and helpers count as shorter
# Usual proportions, and weights of the penalty for each excess.
_NARROWEST: dict[Kind, float] = {"leg": 0.08, "arm": 0.3}  # of a limb's length: between the first joints of a pair
_RATIO: dict[Kind, tuple[float, float]] = {"leg": (1.0, 0.25), "arm": (1.05, 0.3)}  # upper to lower bone; log deviation
_BEFORE: dict[Kind, tuple[float, float]] = {"leg": (0.6, 4.0), "arm": (1.2, 3.0)}  # of the upper bone: limit; weight
_AFTER: dict[Kind, float] = {"leg": 0.8, "arm": 1.2}  # of the lower bone: longest chain after it
_METACARPAL = 0.75  # of the next bone: a first joint closer to the wrist is inside the palm
_MOST = 8  # most chains of a hand
_HELD = 2.0  # longer than most chains below a wrist by this factor: an object in the hand


@dataclass(frozen=True, eq=False)
class Limb:
    """A pair of limbs: the three joints of each, and their chains."""

    tree: Tree = field(repr=False)
    hub: int  # the joint where both begin
    chains: Pair
    joints: tuple[tuple[int, ...], tuple[int, ...]]  # hip, knee, ankle or shoulder, elbow, wrist
    lengths: tuple[float, float]  # of the two bones
    side: int  # 1 if the first of the pair is left by its names, -1 if it is right, 0 if unknown
    penalty: float = 0.0  # how unlike a leg or an arm it is

    @property
    def length(self) -> float:
        """Sum of the two bone lengths."""
        return sum(self.lengths)

    @property
    def points(self) -> set[int]:
        """The points of both chains."""
        return {point for chain in self.chains for point in chain}

    @property
    def width(self) -> float:
        """Distance of the first joints of both limbs."""
        return self.tree.distance(self.joints[0][0], self.joints[1][0])

    @property
    def middle(self) -> np.ndarray:
        """Midpoint (S, 3) of the first joints of both limbs."""
        return (self.tree.place[:, self.joints[0][0]] + self.tree.place[:, self.joints[1][0]]) / 2

    @property
    def across(self) -> np.ndarray:
        """Vector (S, 3) from the first joint of the second limb to that of the first."""
        return self.tree.place[:, self.joints[0][0]] - self.tree.place[:, self.joints[1][0]]

    def before(self, which: int) -> tuple[int, ...]:
        """Return the points between the hub and the first of the three joints."""
        return self.chains[which][: self.chains[which].index(self.joints[which][0])]

    def after(self, which: int) -> tuple[int, ...]:
        """Return the points after the last of the three joints, along the chain."""
        return self.chains[which][self.chains[which].index(self.joints[which][2]) + 1 :]


def named_limb(tree: Tree, points: Mapping[str, int], kind: Kind) -> Limb | None:
    """Return the legs or arms that names tell ({ours: point}); None if one is missing or the tree contradicts."""
    names = [[f"{side}_{role}" for role in ROLES[kind]] for side in ("left", "right")]
    if not {name for side in names for name in side} <= points.keys():
        return None
    joints = [tuple(points[name] for name in side) for side in names]
    above = [tree.figure.above(side[2]) for side in joints]
    if any(list(side) != [k for k in way[::-1] if k in side] for side, way in zip(joints, above, strict=True)):
        return None
    hub = next((k for k in above[0] if k in above[1]), None)
    if hub is None or any(side[0] not in way[: way.index(hub)] for side, way in zip(joints, above, strict=True)):
        return None
    bones = np.array([[tree.distance(side[k], side[k + 1]) for k in (0, 1)] for side in joints])
    if not bones.all() or (np.abs(bones[0] - bones[1]) > 2 * _ALIKE * bones.max(axis=0)).any():
        return None
    one, other = ((*way[: way.index(hub)][::-1], *_onward(tree, way[0])) for way in above)
    upper, lower = bones.mean(axis=0)
    return Limb(tree, hub, (one, other), (joints[0], joints[1]), (float(upper), float(lower)), side=1)


def _onward(tree: Tree, point: int) -> list[int]:
    """Return the longest chain below a point; helpers and ends count as shorter."""
    chain: list[int] = []
    while below := tree.figure.children[chain[-1] if chain else point]:
        chain.append(max(below, key=lambda k: (tree.length[k] + tree.reach[k]) * (1 - _ASIDE * tree.is_aside(k))))
    return chain


def mirrored_chains(tree: Tree) -> list[tuple[int, Pair]]:
    """Return every hub with two mirrored branches, and the chains down both."""
    least = _SHORTEST * max(tree.reach[0], 1e-9)
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


def _mirrored(tree: Tree, hub: int, a: int, b: int) -> Pair:
    """Return the longest chains down two branches whose bones are alike, pair by pair."""
    one: list[int] = []
    other: list[int] = []
    choices = [(a, b)]
    while choices and len(one) < _LONGEST_CHAIN:
        above = (one[-1], other[-1]) if one else (hub, hub)
        fitting = _alike(tree, above, choices, tree.reach[hub])
        if not fitting and one:  # one side may have an additional joint that does not bend, a twist
            more = [(c, y) for x, y in choices for c in tree.branches(x) if tree.is_straight(above[0], x, c)]
            more += [(x, d) for x, y in choices for d in tree.branches(y) if tree.is_straight(above[1], y, d)]
            fitting = _alike(tree, above, more, tree.reach[hub])
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
        if abs(p - q) <= _ALIKE * max(p, q) + 0.01 * scale:
            way = min(p + tree.reach[x], q + tree.reach[y])
            unlike = abs(p - q) + 0.3 * min(abs(tree.reach[x] - tree.reach[y]), 0.25 * way)  # one hand may hold a sword
            aside = tree.is_aside(x) + tree.is_aside(y)
            fitting.append((way - 2 * unlike - _ASIDE * aside * way, x, y))
    return fitting


def limb_of_chains(tree: Tree, hub: int, chains: Pair, kind: Kind) -> Limb | None:
    """Return the three joints of a pair of chains that fit a leg or an arm best; None if nothing fits."""
    pairs = list(zip(*chains, strict=True))
    joints = sum(max(pair) < len(tree.figure.joints) for pair in pairs)
    branches = [sum(tree.reach[k] > 0 for k in tree.figure.children[point]) for point, _ in pairs]
    hand = next((k for k, count in enumerate(branches) if count >= _FINGERS), len(pairs))
    last = hand if hand >= 2 else len(pairs)
    side = first_is_left(*([tree.name(k) for k in chain] for chain in chains))
    # Distances (N, N) of the points of both chains, the hub among them: their median and least over time.
    place = [tree.place[:, [hub, *chain]] for chain in chains]
    apart = [np.linalg.norm(p[:, :, None] - p[:, None], axis=-1) for p in place]
    median, least = np.mean([np.median(a, axis=0) for a in apart], axis=0), np.min([a.min(axis=0) for a in apart], 0)
    way = np.concatenate([[0.0], np.cumsum(np.diagonal(median, offset=1))])  # (N,) from the hub along the chain
    best: Limb | None = None
    for picks in combinations(range(len(pairs)), 3):
        if picks[1] >= joints:
            break
        first, second, third = (k + 1 for k in picks)  # the tables begin with the hub
        upper, lower = float(median[first, second]), float(median[second, third])
        if picks[2] > last or min(upper, lower) < 0.08 * way[-1]:
            continue
        one, other = (tuple(chain[k] for k in picks) for chain in chains)
        if any(_is_shifted(tree, side, kind) for side in (one, other)):
            continue
        usual, spread = _RATIO[kind]
        limit, weight = _BEFORE[kind]
        penalty = (np.log(upper / lower / usual) / spread) ** 2
        penalty += 5 * max(0.0, 1 - tree.distance(one[0], other[0]) / (upper + lower) / _NARROWEST[kind])
        penalty += weight * max(0.0, median[0, first] / upper - limit)
        penalty += 5 * max(0.0, (way[-1] - way[third]) / lower - _AFTER[kind])
        for a, b in ((first, second), (second, third)):  # a joint between two of the three should not bend
            if b - a > 1:
                penalty += 20 * max(0.0, 0.97 - least[a, b] / max(way[b] - way[a], 1e-9))
        # If joints coincide, the last hip or knee carries the whole rotation, but the first ankle or wrist does.
        penalty -= 1e-4 * (picks[0] + picks[1] - picks[2])
        if best is None or penalty < best.penalty - 1e-6:
            best = Limb(tree, hub, chains, (one, other), (upper, lower), side, float(penalty))
    return best


def _is_shifted(tree: Tree, joints: tuple[int, ...], kind: Kind) -> bool:
    """Whether names mean that a joint is missing: a forearm is taken for a wrist, or an upper arm for an elbow."""
    said = [set[str]() if tree.is_aside(k) else every_part(tree.name(k)) for k in joints]
    one, two, three = ROLES[kind]
    is_third = three not in said[2] and bool(said[2] & {one, two})
    return is_third or (said[1] == {one} and bool(said[0] - {one}))


# --- the ends of limbs ---


def collar_of(arm: Limb, which: int) -> dict[str, int]:
    """Return the joint that carries a shoulder: one named so, or the first that is closer to it than the elbow."""
    tree, shoulder = arm.tree, arm.joints[which][0]
    before = [k for k in arm.before(which) if k < len(tree.figure.joints)]
    named = [k for k in before if tree.means(k, "collar")]
    near = [k for k in before if 0.05 * arm.lengths[0] < tree.distance(k, shoulder) < 0.9 * arm.lengths[0]]
    return {"collar": (named or near)[0]} if named or near else {}


def foot_of(leg: Limb, which: int, zero: float) -> dict[str, int]:
    """Return the ball of the foot and the tip of the toes; points closer than `zero` coincide."""
    tree, ankle = leg.tree, leg.joints[which][2]
    chain = [k for k in leg.after(which) if tree.distance(k, ankle) > zero]
    named = [k for k in chain if tree.means(k, "foot") and not is_end(tree.name(k))]
    balls = [k for k in named or chain if k < len(tree.figure.joints)]
    if not balls:
        return {}
    sure = [k for k in balls if named and not tree.means(k, "ankle") and k != chain[-1]]
    ball = (sure or balls)[0]
    tips = [k for k in chain[chain.index(ball) + 1 :] if tree.distance(k, ball) > zero]
    return {"foot": ball, "toe": tips[-1]} if tips else {"foot": ball}


def fingers_of(tree: Tree, wrist: int) -> dict[str, int]:
    """Return joints and tips of the fingers below a wrist: 'index1', 'index2', 'index3', 'index_tip' …

    Fingers are identified by their names, their numbers, or their positions on the hand.
    """
    count = len(tree.figure.joints)
    found: dict[str, int] = {}
    for finger, chain in _which(tree, wrist, _finger_chains(tree, wrist)).items():
        joints = [k for k in chain if k < count]
        joints = joints[_begins_in_palm(tree, wrist, finger, chain, joints) :][:3]
        if len(joints) < 2:
            continue
        found |= {f"{finger}{k}": joint for k, joint in enumerate(joints, start=1)}
        tips = chain[chain.index(joints[-1]) + 1 :]
        if len(joints) == 3 and tips and tree.length[tips[0]] > 0:
            found[f"{finger}_tip"] = tips[0]
    return found


def _finger_chains(tree: Tree, wrist: int) -> list[list[int]]:
    """Return the branches below a wrist without further branching, from the wrist on."""
    figure, leaves, todo = tree.figure, list[int](), [wrist]
    while todo:
        point = todo.pop()
        children = [k for k in figure.children[point] if not is_helper(tree.name(k))]
        todo += children
        if not children and point != wrist:
            leaves.append(point)
    if len(leaves) > 4 * _MOST:
        return []
    ways = [way[: way.index(wrist)][::-1] for way in map(figure.above, leaves)]
    shared = Counter(k for way in ways for k in way)
    chains = [[k for k in way if shared[k] == 1] for way in ways]
    return [chain for chain in chains if sum(k < len(figure.joints) for k in chain) >= 2][:_MOST]


def _which(tree: Tree, wrist: int, chains: list[list[int]]) -> dict[str, list[int]]:
    """Return the chain of each finger."""
    named: dict[str, list[int]] = {}
    for chain in chains:
        said = [part for k in chain for part in parts(tree.name(k)) if part in FINGERS]
        if said and said.count(said[0]) > 1:
            named.setdefault(said[0], chain)
    if named:
        return named
    numbered = [chain for chain in chains if any(tree.means(k, "finger") for k in chain)]
    if len(numbered) in (4, 5):
        return dict(zip(FINGERS, sorted(numbered, key=lambda chain: tree.name(chain[0])), strict=False))
    usual = np.median([tree.way(wrist, chain) for chain in chains]) if chains else 0.0
    chains = [chain for chain in chains if tree.way(wrist, chain) < _HELD * usual]
    if len(chains) not in (4, 5):
        return {}
    ways = np.stack([tree.place[:, chain[-1]] - tree.place[:, wrist] for chain in chains])
    ways /= np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)
    rest = (ways.sum(axis=0) - ways) / (len(chains) - 1)
    apart = np.median((ways * rest).sum(-1), axis=1)  # the thumb points elsewhere
    thumb = chains.pop(int(np.argmin(apart)))
    knuckles = np.stack([tree.place[:, chain[0]] - tree.place[:, wrist] for chain in chains])
    along = knuckles.mean(axis=0)
    base = tree.place[:, thumb[0]] - tree.place[:, wrist]
    share = (base * along).sum(-1) / np.maximum((along * along).sum(-1), 1e-12)
    across = base - share[:, None] * along  # over the palm, towards the thumb
    ranks = -np.median((knuckles * across).sum(-1), axis=1)
    return dict(zip(FINGERS, [thumb, *(chains[k] for k in np.argsort(ranks))], strict=False))


def _begins_in_palm(tree: Tree, wrist: int, finger: str, chain: list[int], joints: list[int]) -> bool:
    """Whether the first joint of a finger does not bend: a bone inside the palm, by name or distance to the wrist."""
    if len(joints) > 3 and len(chain) > len(joints):  # four joints and a tip
        return True
    if finger == "thumb" or len(joints) < 3:
        return False
    said = words(tree.name(joints[0]))
    if "carpal" in "".join(said) or "mc" in said:
        return True
    return len(chain) > 3 and bool(tree.distance(wrist, joints[0]) < _METACARPAL * tree.length[joints[1]])
