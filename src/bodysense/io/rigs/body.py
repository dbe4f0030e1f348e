"""Body: the joints of a tree that are ours: limbs, and between and above them pelvis, spine, neck and head.

Names decide first, limb by limb. If they do not tell the legs or the arms, structure does: tree shape, symmetry,
lengths and directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.hand import FINGERS
from bodysense.errors import BodysenseError
from bodysense.io.rigs import words
from bodysense.io.rigs.figure import Tree
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
from bodysense.io.rigs.names import joints_of

NO_BODY = "not a humanoid: two legs and two arms were not found"
WORST = 16.0  # largest penalty of a body that structure tells
_CANDIDATES = 24  # legs and arms that are combined
_WITH_HEAD = 8  # best combinations that are searched for a head
_HEADLESS = 6.0  # penalty of a body without a head
_HIGH_HUB = 0.3  # of the distance to the shoulders: a joint this far from the hips is not a pelvis
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


def find_body(tree: Tree) -> Body:
    """Return the body in a tree. Raises BodysenseError if there is no body."""
    index = {name: point for point, name in enumerate(tree.figure.points)}
    points = {ours: index[given] for given, ours in joints_of(tree.figure.points).items()}
    named: dict[Kind, Limb] = {kind: limb for kind in ROLES if (limb := named_limb(tree, points, kind))}
    limbs = {kind: [limb] for kind, limb in named.items()}
    pairs = mirrored_chains(tree) if len(named) < len(ROLES) else []
    pairs = [(hub, chains) for hub, chains in pairs if not _is_on_head(tree, hub)]
    for kind in ROLES.keys() - named.keys():
        found = [limb for hub, chains in pairs if (limb := limb_of_chains(tree, hub, chains, kind))]
        limbs[kind] = sorted(found, key=lambda limb: limb.penalty)[:_CANDIDATES]
    legs = limbs["leg"]
    choices = [(_unlikeness(tree, a, b, legs), a, b) for a in legs for b in limbs["arm"] if _disjoint(a, b)]
    choices = sorted(choices, key=lambda choice: choice[0])[:_WITH_HEAD]
    choices = [(penalty + (0 if _head_of(tree, a, b) else _HEADLESS), a, b) for penalty, a, b in choices]
    for penalty, leg, arm in sorted(choices, key=lambda choice: choice[0])[:1]:
        is_likely = len(named) == len(ROLES) or (
            penalty <= WORST
            and not _is_named_otherwise(tree, leg, arm)
            and not _is_splayed(tree, leg)
            and not _has_more_limbs(tree, leg, arm, pairs)
        )
        if is_likely and not _is_animal(tree, leg, arm, legs):
            return _body(tree, leg, arm, penalty)
    return _half(tree, points, named, pairs)


def _half(tree: Tree, points: dict[str, int], named: dict[Kind, Limb], pairs: list[tuple[int, Pair]]) -> Body:
    """Return the upper or lower half of a body, by names. Raises BodysenseError if there are more limbs, or none."""
    names = tree.figure.points
    kind: Kind = "arm" if "arm" in named else "leg"
    other: Kind = "leg" if kind == "arm" else "arm"
    if kind not in named or all(any(role in words.parts(name) for name in names) for role in ROLES[other]):
        needed = [f"{side}_{role}" for role in (*ROLES["leg"], *ROLES["arm"]) for side in ("left", "right")]
        gone = [name for name in needed if name not in points]
        lacking = f", by name it has no {', '.join(gone)}" if 2 * len(gone) < len(needed) and gone else ""
        raise BodysenseError(NO_BODY + lacking)
    limb = named[kind]
    if more := _more_limbs(tree, limb, pairs):
        begin = " and ".join(repr(names[k]) for k in more)
        raise BodysenseError(f"not a humanoid: {begin} begin limbs, besides its {kind}s, that are no {other}s by name")
    end = _other_end(tree, limb, "pelvis" if kind == "arm" else "spine")
    stub = Limb(end, ((end,), (end,)), ((end,) * 3, (end,) * 3), (limb.length / 2, limb.length / 2), side=1)
    body = _body(tree, *((stub, limb) if kind == "arm" else (limb, stub)), penalty=0.0)
    gone = [name for name in body.points if name.partition("_")[2].rstrip("123").removesuffix("_tip") in _OF[other]]
    return Body({name: point for name, point in body.points.items() if name not in gone}, 0.0, body.remarks)


def _is_on_head(tree: Tree, hub: int) -> bool:
    """Whether a joint is a head or hangs on one, as hair does; a root named so is no head."""
    return any("head" in words.words(tree.figure.points[k]) for k in tree.figure.above(hub)[:-1])


def _more_limbs(tree: Tree, limb: Limb, pairs: list[tuple[int, Pair]]) -> tuple[int, int] | None:
    """Return where a pair of limbs begins on a body with named arms or legs alone."""
    figure = tree.figure
    for hub, chains in pairs:
        above = figure.above(hub)
        if not limb.points.isdisjoint((*above, *chains[0], *chains[1])):
            continue
        whole = sum(tree.length[k] for k in limb.chains[0])
        shortest = _SKIRT * whole if hub == limb.hub else _LIMB * limb.length
        if sum(tree.length[k] for k in chains[0]) > shortest and not words.is_helper(figure.points[chains[0][0]]):
            return chains[0][0], chains[1][0]
    return None


def _is_splayed(tree: Tree, leg: Limb) -> bool:
    """Whether the feet are as far apart as a crab's, at most times."""
    hips, ankles = (tree.distance(leg.joints[0][k], leg.joints[1][k]) for k in (0, 2))
    return ankles > hips + _SPLAYED * leg.length


def _is_named_otherwise(tree: Tree, leg: Limb, arm: Limb) -> bool:
    """Whether the names of all joints of a leg mean something else, or joints of a limb are a wing's or a paw's."""
    names = tree.figure.points
    said = [(role, words.parts(names[k])) for role, k in zip(ROLES["leg"], leg.joints[0], strict=True)]
    animal = any(words.is_animal(names[k]) for limb in (leg, arm) for joints in limb.joints for k in joints)
    return animal or all(parts and role not in parts for role, parts in said)


def _other_end(tree: Tree, limb: Limb, part: str) -> int:
    """Return the joint at the end of the trunk without limbs: the one named so, or the farthest possible."""
    figure = tree.figure
    trunk = figure.above(limb.hub) if part == "pelvis" else list(range(len(figure.joints)))
    named = [
        k
        for k in trunk
        if k not in limb.points and part in words.parts(figure.points[k]) and not words.is_helper(figure.points[k])
    ]
    return (named or trunk[-1:])[0] if part == "pelvis" else (named or [limb.hub])[-1]


def _disjoint(leg: Limb, arm: Limb) -> bool:
    """Whether a pair of legs and a pair of arms are four limbs."""
    return not leg.points & arm.points and leg.hub not in arm.points and arm.hub not in leg.points


def _unlikeness(tree: Tree, leg: Limb, arm: Limb, legs: list[Limb]) -> float:
    """Return the penalty of combining legs and arms in one body."""
    trunk = float(np.median(np.linalg.norm(arm.middle(tree) - leg.middle(tree), axis=-1)))
    hip_width, shoulder_width = (tree.distance(limb.joints[0][0], limb.joints[1][0]) for limb in (leg, arm))
    penalty = leg.penalty + arm.penalty + 4 * (1 - leg.length / max(limb.length for limb in legs))
    for ratio, (usual, spread) in (
        (leg.length / arm.length, _LEGS_OVER_ARMS),
        (max(trunk / leg.length, 1e-3), _TRUNK_OVER_LEGS),
    ):
        penalty += (np.log(ratio / usual) / spread) ** 2
    penalty += 8 * max(0.0, hip_width / leg.length - 0.6) + 6 * max(0.0, shoulder_width / arm.length - 1.6)
    fingers = [sum(tree.length[c] > 0 for c in tree.figure.children[limb.joints[0][2]]) for limb in (leg, arm)]
    return float(penalty - (fingers[1] > 2) + (fingers[0] > 2))


def _has_more_limbs(tree: Tree, leg: Limb, arm: Limb, pairs: list[tuple[int, Pair]]) -> bool:
    """Whether another pair of limbs hangs on the trunk, as of a crab; a pair at the hips may be a skirt."""
    figure, taken = tree.figure, leg.points | arm.points
    trunk = {leg.hub, *figure.above(leg.hub), arm.hub, *figure.above(arm.hub)} - taken
    if leg.hub == arm.hub:  # no joint is certainly above the arms, where hair hangs
        trunk = set(range(len(figure.joints))) - taken
    trunk |= {k for limb in (leg, arm) for which in (0, 1) for k in (*limb.before(which), limb.joints[which][0])}
    whole = sum(tree.length[k] for k in leg.chains[0])
    for hub, chains in pairs:
        if hub not in trunk or not taken.isdisjoint((*chains[0], *chains[1])):
            continue
        shortest = _SKIRT * whole if hub == leg.hub else _LIMB * min(leg.length, arm.length)
        if sum(tree.length[k] for k in chains[0]) > shortest and not words.is_helper(figure.points[chains[0][0]]):
            return True
    return False


def _is_animal(tree: Tree, leg: Limb, arm: Limb, legs: list[Limb]) -> bool:
    """Whether it stands on its arms, with legs perpendicular to its trunk, or has more than two legs."""
    trunk = arm.middle(tree) - leg.middle(tree)
    down, forth = (
        np.sum([tree.place[:, third] - tree.place[:, first] for first, _, third in limb.joints], axis=0)
        for limb in (leg, arm)
    )
    square = np.abs(_cosine(down, trunk)) < 0.5
    on_all_fours = (np.abs(_cosine(forth, trunk)) < 0.6) & (_cosine(down, forth) > 0.7)
    stands_on_arms = float((square & on_all_fours).mean()) > 0.7 and arm.length > 0.62 * leg.length
    odd = sum(words.is_animal(name) for name in tree.figure.points)
    more = [one for one in legs if one.hub == leg.hub and abs(np.log(one.length / leg.length)) < 0.35]
    crowd = {knee for one in more for _, knee, _ in one.joints} - leg.points - arm.points
    tiny = arm.length < 0.25 * leg.length
    return stands_on_arms or len(crowd) > 2 or tiny or (odd > 4 and bool(square.mean() > 0.5))


def _cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-9)


def _body(tree: Tree, leg: Limb, arm: Limb, penalty: float) -> Body:
    """Return the points of a body with these limbs."""
    left_leg, left_arm, remarks = _left(tree, leg, arm)
    zero = _ZERO * leg.length
    spine, pelvis, neck_below = _spine_of(tree, leg, arm, zero)
    points: dict[str, int] = {"pelvis": pelvis}
    trunk = np.median(np.linalg.norm(arm.middle(tree) - leg.middle(tree), axis=-1))
    over_hips = np.median(np.linalg.norm(tree.place[:, pelvis] - leg.middle(tree), axis=-1))
    if arm.chains[0] != arm.chains[1] and over_hips > _HIGH_HUB * trunk:
        points = {}  # the legs hang on the middle of the trunk, as in OpenNI
        spine = [pelvis, *spine]
    head = _head_of(tree, leg, arm) or _Head(None, None, None, ())
    spine = [*spine, *head.spine]
    if len(spine) > 2:
        points |= {"spine1": spine[0], "spine2": spine[len(spine) // 2], "spine3": spine[-1]}
    else:
        points |= dict(zip(("spine1", "spine3"), spine, strict=False))
    above = {"neck": neck_below if head.neck is None else head.neck, "head": head.head, "head_top": head.top}
    points |= {name: point for name, point in above.items() if point is not None}
    for side, a, b in (("left", left_leg, left_arm), ("right", 1 - left_leg, 1 - left_arm)):
        own = dict(zip(ROLES["leg"], leg.joints[a], strict=True)) | dict(zip(ROLES["arm"], arm.joints[b], strict=True))
        own |= collar_of(tree, arm, b) | foot_of(tree, leg, a, zero) | fingers_of(tree, own["wrist"])
        points |= {f"{side}_{part}": point for part, point in own.items()}
    joints = len(tree.figure.joints)
    sited = [name for name, k in points.items() if k >= joints and not name.endswith(("_top", "_toe", "_tip"))]
    if any(name == "pelvis" or "shoulder" in name or "hip" in name for name in sited):
        raise BodysenseError(NO_BODY)
    gone = [name for name in sited if not name.endswith(("head", "wrist", "ankle"))]
    return Body({name: k for name, k in points.items() if name not in gone}, penalty, remarks)


# --- left and right ---


def _left(tree: Tree, leg: Limb, arm: Limb) -> tuple[int, int, tuple[str, ...]]:
    """Return the index of the left leg and of the left arm, and remarks."""
    if leg.side and arm.side:
        return int(leg.side < 0), int(arm.side < 0), ()
    crossed = float(_cosine(leg.across(tree), arm.across(tree)).mean()) < 0
    seen, sure = _anatomical(tree, leg, arm)
    named = leg.side or (-arm.side if crossed else arm.side)
    remarks: tuple[str, ...] = ()
    if named and sure > 1 and named != seen:
        remarks = ("left and right are as its names say, though its feet point backward",)
    elif not named and sure < _GUESS:
        remarks = ("which side is left is a guess: no name, foot or knee tells",)
    left_leg = int((named or seen) < 0)
    return left_leg, 1 - left_leg if crossed else left_leg, remarks


def _anatomical(tree: Tree, leg: Limb, arm: Limb) -> tuple[int, float]:
    """Return 1 if the first leg is the left one by feet and knees, else -1; and the confidence, 0 to 6."""
    up, across = arm.middle(tree) - leg.middle(tree), leg.across(tree)
    votes = np.zeros(len(up))
    for which in (0, 1):
        hip, knee, ankle = (tree.place[:, k] for k in leg.joints[which])
        toes = [k for k in leg.after(which) if tree.distance(k, leg.joints[which][2]) > 0.1 * leg.lengths[1]]
        if toes:  # feet point forward, perpendicular to the shin
            votes += 2 * _cosine(np.cross(knee - ankle, tree.place[:, toes[-1]] - ankle), across)
        bend = knee - (hip + ankle) / 2
        bent = np.linalg.norm(bend, axis=-1) / leg.length
        votes += np.minimum(10 * bent, 1.0) * _cosine(np.cross(up, bend), across)
    mean = float(votes.mean())
    return (1 if mean > 0 else -1), abs(mean)


# --- trunk and head ---


@dataclass(frozen=True)
class _Head:
    """The joints over the shoulders."""

    head: int | None  # if a joint is at that height
    neck: int | None
    top: int | None
    spine: tuple[int, ...]  # joints below the neck that do not carry the arms


def _spine_of(tree: Tree, leg: Limb, arm: Limb, zero: float) -> tuple[list[int], int, int | None]:
    """Return the joints of the spine from below, the pelvis, and the neck if it carries the arms."""
    figure = tree.figure
    from_arms, from_legs = figure.above(arm.hub), figure.above(leg.hub)
    meet = next(k for k in from_arms if k in from_legs)
    down = from_legs[: from_legs.index(meet) + 1]  # from the legs' hub up to where both meet
    path = [*down, *reversed(from_arms[: from_arms.index(meet)])]
    pelvis = leg.hub
    if "pelvis" not in words.parts(figure.points[leg.hub]):
        near = [k for k in [*from_legs[1:4], *path[:3]] if _is_near(tree, k, leg)]
        pelvis = next((k for k in near if "pelvis" in words.parts(figure.points[k])), leg.hub)
    if pelvis in path and path.index(pelvis) >= path.index(leg.hub):
        path = path[path.index(pelvis) + 1 :]
    spine = [
        k for k in path if k != pelvis and not words.is_helper(figure.points[k]) and tree.distance(k, pelvis) > zero
    ]
    neck = spine.pop() if spine and "neck" in words.parts(figure.points[spine[-1]]) else None
    return spine, pelvis, neck


def _is_near(tree: Tree, point: int, leg: Limb) -> bool:
    """Whether a joint is close enough to the hips for a pelvis."""
    return float(np.median(np.linalg.norm(tree.place[:, point] - leg.middle(tree), axis=-1))) < 0.45 * leg.length


def _head_of(tree: Tree, leg: Limb, arm: Limb) -> _Head | None:
    """Return the head of a body with these limbs; None if nothing is over its shoulders."""
    figure, limbs = tree.figure, leg.points | arm.points
    height, beside = _over_shoulders(tree, leg, arm)
    way_up, from_legs = figure.above(arm.hub), figure.above(leg.hub)
    hubs = way_up[: way_up.index(leg.hub) + 1] if leg.hub in way_up else way_up
    for hub in hubs:
        found: list[tuple[float, list[int]]] = []
        for child in figure.children[hub]:
            if child in limbs or child in way_up or child in from_legs:
                continue
            chain = _upward(tree, child, height - 2 * beside)
            named = [k for k in chain if words.parts(figure.points[k]) & {"neck", "head"}]
            of_head = [k for k in named if not words.is_end(figure.points[k])]
            tip = float(height[chain].max())
            # An end site behind a named head may point anywhere.
            if (of_head or tip > _LEAST_HEIGHT) and beside[(of_head or chain)[-1]] < _BESIDE:
                found.append((3.0 * bool(of_head) + min(tip, 1.0), chain))
        if found:
            trunk = float(np.median(np.linalg.norm(arm.middle(tree) - leg.middle(tree), axis=-1)))
            return _split(tree, max(found, key=lambda pair: pair[0])[1], height, trunk)
    return None


def _over_shoulders(tree: Tree, leg: Limb, arm: Limb) -> tuple[np.ndarray, np.ndarray]:
    """Return the height (P,) of all points over the shoulders and their distance (P,) from the middle.

    Both in lengths of the trunk, along it and across it.
    """
    shoulders = arm.middle(tree)
    trunk, across = shoulders - leg.middle(tree), arm.across(tree)
    length = np.maximum(np.linalg.norm(trunk, axis=-1, keepdims=True), 1e-9)
    width = np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    place = (tree.place - shoulders[:, None]) / length[:, None]
    height, beside = (np.median((place * way[:, None]).sum(-1), axis=0) for way in (trunk / length, across / width))
    return height, np.abs(beside)


def _upward(tree: Tree, start: int, score: np.ndarray) -> list[int]:
    """Return the chain from a joint up to a leaf: along neck and head by name, else the points of the best score."""
    names, chain = tree.figure.points, [start]
    while children := [
        k
        for k in tree.figure.children[chain[-1]]
        if not words.is_helper(names[k]) or "neck" in words.parts(names[k])  # NeckTwist02 is part of the neck
    ]:
        if "head" in words.parts(names[chain[-1]]) and len(children) > 4:
            break  # a face
        chain.append(
            max(
                children,
                key=lambda k: (
                    bool(words.parts(names[k]) & {"neck", "head"}),
                    score[k] + (tree.reach[k] > 0) * 1e-3,
                ),
            )
        )
    return chain


def _split(tree: Tree, chain: list[int], height: np.ndarray, trunk: float) -> _Head | None:
    """Split a chain above the shoulders into spine, neck, head and top of the head."""
    names, count = tree.figure.points, len(tree.figure.joints)
    joints = [k for k in chain if k < count]

    def named(part: str) -> list[int]:
        return [k for k in joints if part in words.parts(names[k]) and not words.is_end(names[k])]

    spine, necks, heads = named("spine"), named("neck"), named("head")
    if not necks and not heads:
        spine = [k for k in joints[:-2] if height[k] < -0.05]
    joints = [k for k in joints if k not in spine]
    if not joints:
        return None
    if not heads and all("spine" in words.parts(names[k]) for k in joints):
        heads = joints[-1:]  # spine.006 of Rigify
    alone, tip = len(joints) == 1, height[joints[-1]]
    is_neck = alone and tip < _NECK_HEIGHT and not tree.reach[joints[0]]
    if not heads and (is_neck or (necks == joints and (alone or tip < _NAMED_NECK_HEIGHT))):
        end = chain[-1] if chain[-1] not in joints else joints[0]
        return _on_neck(joints[0], end, height[end], tuple(spine))
    if not heads:
        heads = [k for k in joints if k not in necks] or joints[-1:]
        high = [k for k in heads if height[k] > _NECK_HEIGHT]
        if not necks and len(high) > 1 and height[heads[-1]] > _TOP_HEIGHT and not tree.reach[heads[-1]]:
            high = high[:-1]
        heads = [min(high or heads, key=lambda k: abs(height[k] - _HEAD_HEIGHT))]
    head = heads[0]
    before = joints[: joints.index(head)]
    above = [k for k in chain[chain.index(head) + 1 :] if tree.distance(k, head) > 0.02 * tree.reach[0] / 2]
    tops = [k for k in above if words.is_end(names[k]) or k >= count] or above
    neck = next((k for k in before if k in necks), before[0] if before else None)
    top = tops[-1] if tops else None
    if top is not None and (height[top] - height[head]) * trunk < _UPWARD * tree.distance(top, head):
        top = None  # some programs put the end of a head in front of it or at its side
    return _Head(head, neck, top, tuple(spine))


def _on_neck(neck: int, tip: int, height: float, spine: tuple[int, ...]) -> _Head:
    """Classify the tip of a neck without further joints: nothing, a head or its top, by its height."""
    if tip == neck or height < _NECK_HEIGHT:
        return _Head(None, neck, None, spine)
    return _Head(None, neck, tip, spine) if height > _TOP_HEIGHT else _Head(tip, neck, None, spine)
