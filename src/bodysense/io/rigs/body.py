"""Body: the joints of a tree that are ours: limbs, and between and above them pelvis, spine, neck and head.

Names decide first, limb by limb. If they do not tell the legs or the arms, structure does: tree shape, symmetry,
lengths and directions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.hand import FINGERS
from bodysense.errors import BodysenseError
from bodysense.io.rigs.figure import Tree, usual_length
from bodysense.io.rigs.limbs import (
    ROLES,
    Kind,
    Limb,
    Pair,
    collar_of,
    fingers_of,
    foot_of,
    limb_of_chains,
    mirrored_chains,
    named_limb,
)
from bodysense.io.rigs.names import is_animal, is_end, is_helper, joints_of, parts, spread, words

WORST = 16.0  # largest penalty of a body that structure tells
_NO_BODY = "not a humanoid: two legs and two arms were not found"
_CANDIDATES = 24  # legs and arms that are combined
_WITH_HEAD = 8  # best combinations that are searched for a head
_HEADLESS = 6.0  # penalty of a body without a head
_HIGH_HUB = 0.3  # of the distance to the shoulders: a joint this far from the hips is not a pelvis
_NEAR_HIPS = 0.45  # of a leg's length: a joint farther from the hips is not a pelvis
_GUESS = 0.4  # of 6: below it, missing feet and straight knees do not decide left and right
_OF: dict[Kind, tuple[str, ...]] = {  # points of a limb
    "leg": ("hip", "knee", "ankle", "foot", "toe"),
    "arm": ("collar", "shoulder", "elbow", "wrist", *FINGERS),
}
_LIMB = 0.5  # of the shorter limb: a longer pair of chains on the trunk is a pair of limbs
_SKIRT = 0.8  # of a leg with its foot: a shorter pair of chains at the hips may be a skirt
_SPLAYED = 1.0  # of a leg's length: feet farther apart than hips by more than this belong to a crab
_ZERO = 0.01  # of a leg's length: closer points coincide

# Usual ratios of a body and the standard deviations of their logarithms: legs to arms, trunk to legs.
_LEGS_OVER_ARMS, _TRUNK_OVER_LEGS = (1.5, 0.4), (0.58, 0.4)

# Heights over the shoulders, of the trunk's length.
_HEAD_HEIGHT = 0.40  # usual, of a head joint
_NECK_HEIGHT = 0.3  # a lower joint is a neck if there is more above it
_NAMED_NECK_HEIGHT = 0.36  # the limit for joints named as a neck
_TOP_HEIGHT = 0.55  # a last joint above this is the top of the head
_UPWARD = 0.5  # of the distance between them: how high the top of a head is over the head, at least
_LEAST_HEIGHT = 0.12  # of an unnamed head
_BESIDE = 0.35  # of the trunk's length: points farther from the middle are not a head


@dataclass(frozen=True)
class Body:
    """The points of a figure that a body has: {ours: index in the figure}; `penalty`: how unlike a human body it is."""

    points: dict[str, int]
    penalty: float
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class _Limbs:
    """Legs and arms of a body that may be one."""

    leg: Limb
    arm: Limb

    @property
    def tree(self) -> Tree:
        """The tree that both are in."""
        return self.leg.tree

    @property
    def points(self) -> set[int]:
        """The points of all four."""
        return self.leg.points | self.arm.points

    @property
    def are_four(self) -> bool:
        """Whether no joint is in both pairs, and no pair begins in the other."""
        leg, arm = self.leg, self.arm
        return leg.points.isdisjoint((arm.hub, *arm.points)) and leg.hub not in arm.points

    @cached_property
    def trunk(self) -> np.ndarray:
        """Vector (S, 3) from the middle of the hips to that of the shoulders."""
        return self.arm.middle - self.leg.middle

    @cached_property
    def trunk_length(self) -> float:
        """Median length of the trunk."""
        return usual_length(self.trunk)

    @cached_property
    def head(self) -> _Head | None:
        """The head; None if nothing is over the shoulders."""
        return _head_of(self)

    def over_hips(self, point: int) -> float:
        """Return the median distance of a point from the middle of the hips."""
        return usual_length(self.tree.place[:, point] - self.leg.middle)


def find_body(tree: Tree) -> Body:
    """Return the body in a tree. Raises BodysenseError if there is no body."""
    index = {name: point for point, name in enumerate(tree.figure.points)}
    points = {ours: index[given] for given, ours in joints_of(tree.figure.points).items()}
    named: dict[Kind, Limb] = {kind: limb for kind in ROLES if (limb := named_limb(tree, points, kind))}
    choices = {kind: [limb] for kind, limb in named.items()}
    pairs = mirrored_chains(tree) if len(named) < len(ROLES) else []
    on_head = {hub for hub, _ in pairs if any("head" in words(tree.name(k)) for k in tree.figure.above(hub)[:-1])}
    pairs = [(hub, chains) for hub, chains in pairs if hub not in on_head]  # hair; a root named so is no head
    for kind in ROLES.keys() - named.keys():
        found = [limb for hub, chains in pairs if (limb := limb_of_chains(tree, hub, chains, kind))]
        choices[kind] = sorted(found, key=lambda limb: limb.penalty)[:_CANDIDATES]
    legs = choices["leg"]
    longest = max((leg.length for leg in legs), default=0.0)
    bodies = [limbs for leg in legs for arm in choices["arm"] if (limbs := _Limbs(leg, arm)).are_four]
    ranked = sorted(((_unlikeness(limbs, longest), limbs) for limbs in bodies), key=lambda pair: pair[0])[:_WITH_HEAD]
    ranked = [(penalty + (0 if limbs.head else _HEADLESS), limbs) for penalty, limbs in ranked]
    if ranked:
        penalty, limbs = min(ranked, key=lambda pair: pair[0])
        is_likely = len(named) == len(ROLES) or (
            penalty <= WORST and not _is_named_otherwise(limbs) and not _is_crab(limbs, pairs)
        )
        if is_likely and not _is_animal(limbs, legs):
            return _body(limbs, penalty)
    return _half(tree, points, named, pairs)


def _half(tree: Tree, points: dict[str, int], named: dict[Kind, Limb], pairs: list[tuple[int, Pair]]) -> Body:
    """Return the upper or lower half of a body, by names. Raises BodysenseError if there are more limbs, or none."""
    count, joints = len(tree.figure.points), len(tree.figure.joints)
    kind: Kind = "arm" if "arm" in named else "leg"
    other: Kind = "leg" if kind == "arm" else "arm"
    if kind not in named or all(any(tree.means(k, role) for k in range(count)) for role in ROLES[other]):
        needed = [f"{side}_{role}" for role in (*ROLES["leg"], *ROLES["arm"]) for side in ("left", "right")]
        gone = [name for name in needed if name not in points]
        lacking = f", by name it has no {', '.join(gone)}" if 2 * len(gone) < len(needed) and gone else ""
        raise BodysenseError(_NO_BODY + lacking)
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
    body = _body(_Limbs(stub, limb) if kind == "arm" else _Limbs(limb, stub), penalty=0.0)
    gone = [name for name in body.points if name.partition("_")[2].rstrip("123").removesuffix("_tip") in _OF[other]]
    return Body({name: point for name, point in body.points.items() if name not in gone}, 0.0, body.remarks)


# --- refusals ---


def _unlikeness(limbs: _Limbs, longest: float) -> float:
    """Return the penalty of combining legs and arms in one body; `longest` is the longest leg possible."""
    tree, leg, arm = limbs.tree, limbs.leg, limbs.arm
    penalty = leg.penalty + arm.penalty + 4 * (1 - leg.length / longest)
    for ratio, (usual, deviation) in (
        (leg.length / arm.length, _LEGS_OVER_ARMS),
        (max(limbs.trunk_length / leg.length, 1e-3), _TRUNK_OVER_LEGS),
    ):
        penalty += (np.log(ratio / usual) / deviation) ** 2
    penalty += 8 * max(0.0, leg.width / leg.length - 0.6) + 6 * max(0.0, arm.width / arm.length - 1.6)
    fingers = [sum(tree.length[c] > 0 for c in tree.figure.children[limb.joints[0][2]]) for limb in (leg, arm)]
    return float(penalty - (fingers[1] > 2) + (fingers[0] > 2))


def _is_named_otherwise(limbs: _Limbs) -> bool:
    """Whether the names of all joints of a leg mean something else, or joints of a limb are a wing's or a paw's."""
    name = limbs.tree.name
    said = [(role, parts(name(k))) for role, k in zip(ROLES["leg"], limbs.leg.joints[0], strict=True)]
    animal = any(is_animal(name(k)) for limb in (limbs.leg, limbs.arm) for joints in limb.joints for k in joints)
    return animal or all(meant and role not in meant for role, meant in said)


def _is_crab(limbs: _Limbs, pairs: list[tuple[int, Pair]]) -> bool:
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


def _is_animal(limbs: _Limbs, legs: list[Limb]) -> bool:
    """Whether it stands on its arms, with legs perpendicular to its trunk, or has more than two legs."""
    tree, leg, arm = limbs.tree, limbs.leg, limbs.arm
    down, forth = (
        np.sum([tree.place[:, third] - tree.place[:, first] for first, _, third in limb.joints], axis=0)
        for limb in (leg, arm)
    )
    square = np.abs(_cosine(down, limbs.trunk)) < 0.5
    on_all_fours = (np.abs(_cosine(forth, limbs.trunk)) < 0.6) & (_cosine(down, forth) > 0.7)
    stands_on_arms = float((square & on_all_fours).mean()) > 0.7 and arm.length > 0.62 * leg.length
    odd = sum(is_animal(name) for name in tree.figure.points)
    more = [one for one in legs if one.hub == leg.hub and abs(np.log(one.length / leg.length)) < 0.35]
    crowd = {knee for one in more for _, knee, _ in one.joints} - limbs.points
    tiny = arm.length < 0.25 * leg.length
    return stands_on_arms or len(crowd) > 2 or tiny or (odd > 4 and bool(square.mean() > 0.5))


def _cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-9)


# --- the points of a body ---


def _body(limbs: _Limbs, penalty: float) -> Body:
    """Return the points of a body with these limbs."""
    leg, arm = limbs.leg, limbs.arm
    left_leg, left_arm, remarks = _left(limbs)
    zero = _ZERO * leg.length
    spine, pelvis, neck = _spine_of(limbs, zero)
    points: dict[str, int] = {"pelvis": pelvis}
    if arm.chains[0] != arm.chains[1] and limbs.over_hips(pelvis) > _HIGH_HUB * limbs.trunk_length:
        points = {}  # the legs hang on the middle of the trunk, as in OpenNI
        spine = [pelvis, *spine]
    head = limbs.head or _Head(None, None, None, ())
    points |= spread([*spine, *head.spine])
    above = {"neck": neck if head.neck is None else head.neck, "head": head.head, "head_top": head.top}
    points |= {name: point for name, point in above.items() if point is not None}
    for side, a, b in (("left", left_leg, left_arm), ("right", 1 - left_leg, 1 - left_arm)):
        own = dict(zip(ROLES["leg"], leg.joints[a], strict=True)) | dict(zip(ROLES["arm"], arm.joints[b], strict=True))
        own |= collar_of(arm, b) | foot_of(leg, a, zero) | fingers_of(limbs.tree, own["wrist"])
        points |= {f"{side}_{part}": point for part, point in own.items()}
    joints = len(limbs.tree.figure.joints)
    sited = [name for name, k in points.items() if k >= joints and not name.endswith(("_top", "_toe", "_tip"))]
    if any(name == "pelvis" or "shoulder" in name or "hip" in name for name in sited):
        raise BodysenseError(_NO_BODY)
    gone = [name for name in sited if not name.endswith(("head", "wrist", "ankle"))]
    return Body({name: k for name, k in points.items() if name not in gone}, penalty, remarks)


def _left(limbs: _Limbs) -> tuple[int, int, tuple[str, ...]]:
    """Return the index of the left leg and of the left arm, and remarks."""
    leg, arm = limbs.leg, limbs.arm
    if leg.side and arm.side:
        return int(leg.side < 0), int(arm.side < 0), ()
    crossed = float(_cosine(leg.across, arm.across).mean()) < 0
    seen = _anatomical(limbs)
    named = leg.side or (-arm.side if crossed else arm.side)
    remarks: tuple[str, ...] = ()
    if named and abs(seen) > 1 and (named > 0) != (seen > 0):
        remarks = ("left and right are as its names say, though its feet point backward",)
    elif not named and abs(seen) < _GUESS:
        remarks = ("which side is left is a guess: no name, foot or knee tells",)
    left_leg = int(named < 0 if named else seen <= 0)
    return left_leg, 1 - left_leg if crossed else left_leg, remarks


def _anatomical(limbs: _Limbs) -> float:
    """Return the confidence, 0 to 6, that by feet and knees the first leg is the left one; negative: the right one."""
    tree, leg = limbs.tree, limbs.leg
    votes = np.zeros(len(limbs.trunk))
    for which in (0, 1):
        hip, knee, ankle = (tree.place[:, k] for k in leg.joints[which])
        toes = [k for k in leg.after(which) if tree.distance(k, leg.joints[which][2]) > 0.1 * leg.lengths[1]]
        if toes:  # feet point forward, perpendicular to the shin
            votes += 2 * _cosine(np.cross(knee - ankle, tree.place[:, toes[-1]] - ankle), leg.across)
        bend = knee - (hip + ankle) / 2
        bent = np.linalg.norm(bend, axis=-1) / leg.length
        votes += np.minimum(10 * bent, 1.0) * _cosine(np.cross(limbs.trunk, bend), leg.across)
    return float(votes.mean())


def _spine_of(limbs: _Limbs, zero: float) -> tuple[list[int], int, int | None]:
    """Return the joints of the spine from below, the pelvis, and the neck if it carries the arms."""
    tree, hub = limbs.tree, limbs.leg.hub
    from_arms, from_legs = tree.figure.above(limbs.arm.hub), tree.figure.above(hub)
    meet = next(k for k in from_arms if k in from_legs)
    down = from_legs[: from_legs.index(meet) + 1]  # from the legs' hub up to where both meet
    path = [*down, *reversed(from_arms[: from_arms.index(meet)])]
    pelvis = hub
    if not tree.means(hub, "pelvis"):
        near = [k for k in [*from_legs[1:4], *path[:3]] if limbs.over_hips(k) < _NEAR_HIPS * limbs.leg.length]
        pelvis = next((k for k in near if tree.means(k, "pelvis")), hub)
    if pelvis in path and path.index(pelvis) >= path.index(hub):
        path = path[path.index(pelvis) + 1 :]
    spine = [k for k in path if k != pelvis and not is_helper(tree.name(k)) and tree.distance(k, pelvis) > zero]
    neck = spine.pop() if spine and tree.means(spine[-1], "neck") else None
    return spine, pelvis, neck


@dataclass(frozen=True)
class _Head:
    """The joints over the shoulders."""

    head: int | None  # if a joint is at that height
    neck: int | None
    top: int | None
    spine: tuple[int, ...]  # joints below the neck that do not carry the arms


def _head_of(limbs: _Limbs) -> _Head | None:
    """Return the head of a body with these limbs; None if nothing is over its shoulders."""
    tree, figure, taken = limbs.tree, limbs.tree.figure, limbs.points
    # Heights (P,) of all points over the shoulders and distances (P,) from the middle, in lengths of the trunk.
    length = np.maximum(np.linalg.norm(limbs.trunk, axis=-1, keepdims=True), 1e-9)
    width = np.maximum(np.linalg.norm(limbs.arm.across, axis=-1, keepdims=True), 1e-9)
    place = (tree.place - limbs.arm.middle[:, None]) / length[:, None]
    axes = (limbs.trunk / length, limbs.arm.across / width)
    height, beside = (np.median((place * axis[:, None]).sum(-1), axis=0) for axis in axes)
    beside = np.abs(beside)
    way_up, from_legs = figure.above(limbs.arm.hub), figure.above(limbs.leg.hub)
    hubs = way_up[: way_up.index(limbs.leg.hub) + 1] if limbs.leg.hub in way_up else way_up
    for hub in hubs:
        found: list[tuple[float, list[int]]] = []
        for child in figure.children[hub]:
            if child in taken or child in way_up or child in from_legs:
                continue
            chain = _upward(tree, child, height - 2 * beside)
            of_head = [k for k in chain if tree.means(k, "neck", "head") and not is_end(tree.name(k))]
            tip = float(height[chain].max())
            # An end site behind a named head may point anywhere.
            if (of_head or tip > _LEAST_HEIGHT) and beside[(of_head or chain)[-1]] < _BESIDE:
                found.append((3.0 * bool(of_head) + min(tip, 1.0), chain))
        if found:
            return _split(tree, max(found, key=lambda pair: pair[0])[1], height, limbs.trunk_length)
    return None


def _upward(tree: Tree, start: int, score: np.ndarray) -> list[int]:
    """Return the chain from a joint up to a leaf: along neck and head by name, else the points of the best score."""
    chain = [start]
    while children := [
        k
        for k in tree.figure.children[chain[-1]]
        if not is_helper(tree.name(k)) or tree.means(k, "neck")  # NeckTwist02 is part of the neck
    ]:
        if tree.means(chain[-1], "head") and len(children) > 4:
            break  # a face
        best = max(children, key=lambda k: (tree.means(k, "neck", "head"), score[k] + (tree.reach[k] > 0) * 1e-3))
        chain.append(best)
    return chain


def _split(tree: Tree, chain: list[int], height: np.ndarray, trunk: float) -> _Head | None:
    """Split a chain above the shoulders into spine, neck, head and top of the head."""
    count = len(tree.figure.joints)
    joints = [k for k in chain if k < count]
    spine, necks, heads = (
        [k for k in joints if tree.means(k, part) and not is_end(tree.name(k))] for part in ("spine", "neck", "head")
    )
    if not necks and not heads:
        spine = [k for k in joints[:-2] if height[k] < -0.05]
    joints = [k for k in joints if k not in spine]
    if not joints:
        return None
    if not heads and all(tree.means(k, "spine") for k in joints):
        heads = joints[-1:]  # spine.006 of Rigify
    alone, tip = len(joints) == 1, height[joints[-1]]
    is_neck = alone and tip < _NECK_HEIGHT and not tree.reach[joints[0]]
    if not heads and (is_neck or (necks == joints and (alone or tip < _NAMED_NECK_HEIGHT))):
        end = chain[-1] if chain[-1] not in joints else joints[0]
        is_more, is_top = end != joints[0] and height[end] >= _NECK_HEIGHT, height[end] > _TOP_HEIGHT
        head, top = end if is_more and not is_top else None, end if is_more and is_top else None
        return _Head(head, joints[0], top, tuple(spine))
    if not heads:
        heads = [k for k in joints if k not in necks] or joints[-1:]
        high = [k for k in heads if height[k] > _NECK_HEIGHT]
        if not necks and len(high) > 1 and height[heads[-1]] > _TOP_HEIGHT and not tree.reach[heads[-1]]:
            high = high[:-1]
        heads = [min(high or heads, key=lambda k: abs(height[k] - _HEAD_HEIGHT))]
    head = heads[0]
    before = joints[: joints.index(head)]
    above = [k for k in chain[chain.index(head) + 1 :] if tree.distance(k, head) > 0.02 * tree.reach[0] / 2]
    tops = [k for k in above if is_end(tree.name(k)) or k >= count] or above
    neck = next((k for k in before if k in necks), before[0] if before else None)
    top = tops[-1] if tops else None
    if top is not None and (height[top] - height[head]) * trunk < _UPWARD * tree.distance(top, head):
        top = None  # some programs put the end of a head in front of it or at its side
    return _Head(head, neck, top, tuple(spine))
