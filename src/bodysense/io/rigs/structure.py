"""Structure: the body in a tree without useful names, found by tree shape, symmetry, lengths and directions.

A limb is a pair of chains that mirror each other, whose lengths and bends are those of a leg or an arm. Names count as
evidence, and half a body is one by names alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from bodysense.body.hands.hand import FINGERS
from bodysense.errors import BodysenseError
from bodysense.io.rigs.body import (
    ALIKE,
    ASIDE,
    HEADLESS,
    NO_BODY,
    ROLES,
    WORST,
    Body,
    Kind,
    Limb,
    Limbs,
    Pair,
    body_of,
    named_limb,
    named_points,
    stands_on_arms,
    unlikeness,
)
from bodysense.io.rigs.figure import Tree
from bodysense.io.rigs.names import every_part, first_is_left, is_animal, is_helper, parts, words

_CANDIDATES = 24  # legs and arms that are combined
_WITH_HEAD = 8  # best combinations that are searched for a head
_OF: dict[Kind, tuple[str, ...]] = {  # points of a limb
    "leg": ("hip", "knee", "ankle", "foot", "toe"),
    "arm": ("collar", "shoulder", "elbow", "wrist", *FINGERS),
}
_LIMB = 0.5  # of the shorter limb: a longer pair of chains on the trunk is a pair of limbs
_SKIRT = 0.8  # of a leg with its foot: a shorter pair of chains at the hips may be a skirt
_SPLAYED = 1.0  # of a leg's length: feet farther apart than hips by more than this belong to a crab

_SHORTEST = 0.12  # of the longest path down from the root; shorter chains are not limbs
_FINGERS = 4  # chains on one joint that mark it as the end of a limb
_LONGEST_CHAIN = 18  # points of a limb
# Usual proportions, and weights of the penalty for each excess.
_NARROWEST: dict[Kind, float] = {"leg": 0.08, "arm": 0.3}  # of a limb's length: between the first joints of a pair
_RATIO: dict[Kind, tuple[float, float]] = {"leg": (1.0, 0.25), "arm": (1.05, 0.3)}  # upper to lower bone; log deviation
_BEFORE: dict[Kind, tuple[float, float]] = {"leg": (0.6, 4.0), "arm": (1.2, 3.0)}  # of the upper bone: limit; weight
_AFTER: dict[Kind, float] = {"leg": 0.8, "arm": 1.2}  # of the lower bone: longest chain after it


def searched_body(tree: Tree) -> Body:
    """Return the body in a tree. Raises BodysenseError if there is no body."""
    points, pairs = named_points(tree), _mirrored_pairs(tree)
    named: dict[Kind, Limb] = {kind: limb for kind in ROLES if (limb := named_limb(tree, points, kind))}
    if len(named) < len(ROLES):  # otherwise names gave a body that is not a person's
        legs, arms = ([named[kind]] if kind in named else _candidates(tree, pairs, kind) for kind in ROLES)
        if found := _best(legs, arms, pairs):
            limbs, penalty = found
            return body_of(limbs, points, penalty)
    return _half(tree, points, named, pairs)


def _candidates(tree: Tree, pairs: list[tuple[int, Pair]], kind: Kind) -> list[Limb]:
    """Return the likeliest legs or arms among mirrored chains."""
    found = [limb for hub, chains in pairs if (limb := _limb_of_chains(tree, hub, chains, kind))]
    return sorted(found, key=lambda limb: limb.penalty)[:_CANDIDATES]


def _best(legs: list[Limb], arms: list[Limb], pairs: list[tuple[int, Pair]]) -> tuple[Limbs, float] | None:
    """Return the likeliest legs and arms, and how unlike a human body they are; None if they are not a person's."""
    bodies = [limbs for leg in legs for arm in arms if (limbs := Limbs(leg, arm)).are_four]
    longest = max((leg.length for leg in legs), default=0.0)
    ranked = [(limbs, unlikeness(limbs) + 4 * (1 - limbs.leg.length / longest)) for limbs in bodies]
    ranked = sorted(ranked, key=lambda pair: pair[1])[:_WITH_HEAD]
    ranked = [(limbs, penalty + (0 if limbs.head else HEADLESS)) for limbs, penalty in ranked]
    if not ranked:
        return None
    limbs, penalty = min(ranked, key=lambda pair: pair[1])
    if penalty > WORST or _is_named_otherwise(limbs) or _is_crab(limbs, pairs) or stands_on_arms(limbs):
        return None
    return limbs, penalty


def _half(tree: Tree, points: dict[str, int], named: dict[Kind, Limb], pairs: list[tuple[int, Pair]]) -> Body:
    """Return the upper or lower half of a body, by names. Raises BodysenseError if there are more limbs, or none."""
    count, joints = len(tree.figure.points), len(tree.figure.joints)
    kind: Kind = "arm" if "arm" in named else "leg"
    other: Kind = "leg" if kind == "arm" else "arm"
    if kind not in named or all(any(tree.means(k, role) for k in range(count)) for role in ROLES[other]):
        needed = [f"{side}_{role}" for role in (*ROLES["leg"], *ROLES["arm"]) for side in ("left", "right")]
        gone = [name for name in needed if name not in points]
        lacking = f", by name it has no {', '.join(gone)}" if 2 * len(gone) < len(needed) and gone else ""
        raise BodysenseError(NO_BODY + lacking)
    limb = named[kind]
    hubs = {k for k in range(joints) if limb.points.isdisjoint(tree.figure.above(k))}
    if more := _more_limbs(pairs, (limb,), hubs):
        begin = " and ".join(repr(tree.name(chain[0])) for chain in more)
        raise BodysenseError(f"not a humanoid: {begin} begin limbs, besides its {kind}s, that are no {other}s by name")
    # The end of the trunk without limbs: the joint named so, or the farthest possible.
    trunk, part = (tree.figure.above(limb.hub), "pelvis") if kind == "arm" else (list(range(joints)), "spine")
    ends = [k for k in trunk if k not in limb.points and tree.means(k, part) and not is_helper(tree.name(k))]
    end = (ends or trunk[-1:])[0] if kind == "arm" else (ends or [limb.hub])[-1]
    stub = Limb(tree, end, ((end,), (end,)), ((end,) * 3, (end,) * 3), (limb.length / 2, limb.length / 2), side=1)
    body = body_of(Limbs(stub, limb) if kind == "arm" else Limbs(limb, stub), points, penalty=0.0)
    gone = [name for name in body.points if name.partition("_")[2].rstrip("123").removesuffix("_tip") in _OF[other]]
    return Body({name: point for name, point in body.points.items() if name not in gone}, 0.0, body.remarks)


def _mirrored_pairs(tree: Tree) -> list[tuple[int, Pair]]:
    """Return every hub with two mirrored branches, and the chains down both; hair on a head is left out."""
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
    on_head = {hub for hub, _ in found if any("head" in words(tree.name(k)) for k in tree.figure.above(hub)[:-1])}
    return [(hub, chains) for hub, chains in found if hub not in on_head]  # a root named so is no head


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
        if abs(p - q) <= ALIKE * max(p, q) + 0.01 * scale:
            way = min(p + tree.reach[x], q + tree.reach[y])
            unlike = abs(p - q) + 0.3 * min(abs(tree.reach[x] - tree.reach[y]), 0.25 * way)  # one hand may hold a sword
            aside = tree.is_aside(x) + tree.is_aside(y)
            fitting.append((way - 2 * unlike - ASIDE * aside * way, x, y))
    return fitting


def _limb_of_chains(tree: Tree, hub: int, chains: Pair, kind: Kind) -> Limb | None:
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
    meanings = [set[str]() if tree.is_aside(k) else every_part(tree.name(k)) for k in joints]
    one, two, three = ROLES[kind]
    is_third = three not in meanings[2] and bool(meanings[2] & {one, two})
    return is_third or (meanings[1] == {one} and bool(meanings[0] - {one}))


def _is_named_otherwise(limbs: Limbs) -> bool:
    """Whether the names of all joints of a leg mean something else, or joints of a limb are a wing's or a paw's."""
    name = limbs.tree.name
    meanings = [(role, parts(name(k))) for role, k in zip(ROLES["leg"], limbs.leg.joints[0], strict=True)]
    animal = any(is_animal(name(k)) for limb in (limbs.leg, limbs.arm) for joints in limb.joints for k in joints)
    return animal or all(meant and role not in meant for role, meant in meanings)


def _is_crab(limbs: Limbs, pairs: list[tuple[int, Pair]]) -> bool:
    """Whether its feet are far apart at most times, or a further pair of limbs begins on its trunk."""
    splay = limbs.tree.distance(limbs.leg.joints[0][2], limbs.leg.joints[1][2]) - limbs.leg.width
    if splay > _SPLAYED * limbs.leg.length:
        return True
    figure, leg, arm = limbs.tree.figure, limbs.leg, limbs.arm
    trunk = set(figure.above(leg.hub)) | set(figure.above(arm.hub))
    if leg.hub == arm.hub:  # no joint is certainly above the arms, where hair hangs
        trunk = set(range(len(figure.joints)))
    before = {k for limb in (leg, arm) for which in (0, 1) for k in (*limb.before(which), limb.joints[which][0])}
    return _more_limbs(pairs, (leg, arm), (trunk - limbs.points) | before) is not None


def _more_limbs(pairs: list[tuple[int, Pair]], limbs: Sequence[Limb], hubs: set[int]) -> Pair | None:
    """Return a further pair of chains on some hubs that is as long as limbs; at the hips a skirt may be longer."""
    first, tree = limbs[0], limbs[0].tree
    taken = set[int]().union(*(limb.points for limb in limbs))
    skirt, limb = _SKIRT * sum(tree.length[k] for k in first.chains[0]), _LIMB * min(limb.length for limb in limbs)
    for hub, chains in pairs:
        if hub not in hubs or not taken.isdisjoint((*chains[0], *chains[1])) or is_helper(tree.name(chains[0][0])):
            continue
        if sum(tree.length[k] for k in chains[0]) > (skirt if hub == first.hub else limb):
            return chains
    return None
