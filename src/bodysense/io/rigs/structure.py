"""Structure: which joints of a tree form a body, by tree shape, symmetry, lengths and directions, then by names."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.io.rigs import words
from bodysense.io.rigs.limbs import ROLES, Kind, Limb, Tree, as_limb, pairs_of
from bodysense.io.rigs.trunk import Head, fingers_of, head_of, spine_of

NO_BODY = "not a humanoid: two legs and two arms were not found"
WORST = 16.0  # largest penalty of a body
_CANDIDATES = 24  # legs and arms that are combined
_WITH_HEAD = 8  # best combinations that are searched for a head
_HEADLESS = 6.0
HIGH_HUB = 0.3  # of the distance to the shoulders: a joint this far from the hips is not a pelvis
_GUESS = 0.4  # of 6: below it, missing feet and straight knees do not decide left and right
_OF: dict[Kind, tuple[str, ...]] = {  # points of a limb
    "leg": ("hip", "knee", "ankle", "foot", "toe"),
    "arm": ("collar", "shoulder", "elbow", "wrist", *words.FINGERS),
}
_ZERO = 0.01  # of a leg's length: closer points coincide

# Usual ratios of a body and the standard deviations of their logarithms: legs to arms, trunk to legs.
_LEGS_OVER_ARMS, _TRUNK_OVER_LEGS = (1.5, 0.4), (0.58, 0.4)


@dataclass(frozen=True)
class Structure:
    """The points of a figure that a body has: {ours: index in the figure}; `penalty`: how unlike a human body it is."""

    points: dict[str, int]
    penalty: float
    sides: str  # evidence for left and right: 'names' or 'the feet'
    remarks: tuple[str, ...] = ()


def find_body(tree: Tree) -> Structure:
    """Return the body in a tree. Raises BodysenseError if there is no body."""
    pairs = pairs_of(tree)
    legs = [limb for hub, chains in pairs if (limb := as_limb(tree, hub, chains, "leg"))]
    arms = [limb for hub, chains in pairs if (limb := as_limb(tree, hub, chains, "arm"))]
    longest = max((limb.length for limb in legs), default=0.0)
    legs, arms = (sorted(limbs, key=lambda limb: limb.penalty)[:_CANDIDATES] for limbs in (legs, arms))
    choices = [(_together(tree, a, b, longest), a, b) for a in legs for b in arms if _disjoint(a, b)]
    if not choices:
        return _half(tree, legs, arms)
    choices = sorted(choices, key=lambda choice: choice[0])[:_WITH_HEAD]
    choices = [(penalty + (0 if head_of(tree, a, b) else _HEADLESS), a, b) for penalty, a, b in choices]
    penalty, leg, arm = min(choices, key=lambda choice: choice[0])
    if penalty > WORST or _is_animal(tree, leg, arm, legs) or _says_other(tree, leg, "leg"):
        return _half(tree, legs, arms)
    return _named(tree, leg, arm, penalty)


def _half(tree: Tree, legs: list[Limb], arms: list[Limb]) -> Structure:
    """Return the upper or lower half of a body, by names. Raises BodysenseError if names do not identify one."""
    names = tree.figure.points
    named: dict[Kind, list[Limb]] = {
        "leg": [one for one in legs if _says(tree, one, "leg")],
        "arm": [one for one in arms if _says(tree, one, "arm")],
    }
    kind: Kind = "arm" if named["arm"] else "leg"
    other: Kind = "leg" if kind == "arm" else "arm"
    if not named[kind] or all(any(role in words.parts(name) for name in names) for role in ROLES[other]):
        raise BodysenseError(NO_BODY)
    found = min(named[kind], key=lambda limb: limb.penalty)
    end = _other_end(tree, found, "pelvis" if kind == "arm" else "spine")
    stub = Limb(end, ((end,), (end,)), (0, 0, 0), (found.length / 2, found.length / 2), 0.0)
    body = _named(tree, *((stub, found) if kind == "arm" else (found, stub)), found.penalty)
    gone = [name for name in body.points if name.partition("_")[2].rstrip("123").removesuffix("_tip") in _OF[other]]
    return replace(body, points={name: point for name, point in body.points.items() if name not in gone})


def _says(tree: Tree, limb: Limb, kind: Kind) -> bool:
    """Whether the names of both limbs identify them as legs or arms, and left and right."""
    names = tree.figure.points
    said = all(
        role in words.parts(names[k]) for n in (0, 1) for role, k in zip(ROLES[kind], limb.joints(n), strict=True)
    )
    return said and words.side(*([names[k] for k in chain] for chain in limb.chains)) != 0


def _says_other(tree: Tree, limb: Limb, kind: Kind) -> bool:
    """Whether the names of all joints of a limb identify it as something else."""
    said = [(role, words.parts(tree.figure.points[k])) for role, k in zip(ROLES[kind], limb.joints(0), strict=True)]
    return all(parts and role not in parts for role, parts in said)


def _other_end(tree: Tree, limb: Limb, part: str) -> int:
    """Return the joint at the end of the trunk without limbs: the one named so, or the farthest possible."""
    figure = tree.figure
    own = {k for chain in limb.chains for k in chain}
    trunk = figure.above(limb.hub) if part == "pelvis" else [k for k in range(len(figure.joints)) if k not in own]
    named = [k for k in trunk if part in words.parts(figure.points[k]) and not words.is_helper(figure.points[k])]
    if part == "pelvis":
        return (named or trunk[-1:])[0]
    return (named or [limb.hub])[-1]


def _disjoint(leg: Limb, arm: Limb) -> bool:
    """Whether a pair of legs and a pair of arms are four limbs."""
    mine, theirs = ({k for chain in limb.chains for k in chain} for limb in (leg, arm))
    return not mine & theirs and leg.hub not in theirs and arm.hub not in mine


def _together(tree: Tree, leg: Limb, arm: Limb, longest: float) -> float:
    """Return the penalty of combining legs and arms in one body."""
    hips, shoulders = (_middle(tree, limb) for limb in (leg, arm))
    trunk = float(np.median(np.linalg.norm(shoulders - hips, axis=-1)))
    hip_width, shoulder_width = (tree.distance(limb.joints(0)[0], limb.joints(1)[0]) for limb in (leg, arm))
    penalty = leg.penalty + arm.penalty + 4 * (1 - leg.length / longest)
    for ratio, (usual, spread) in (
        (leg.length / arm.length, _LEGS_OVER_ARMS),
        (max(trunk, 1e-3 * leg.length) / leg.length, _TRUNK_OVER_LEGS),
    ):
        penalty += (np.log(ratio / usual) / spread) ** 2
    penalty += 8 * max(0.0, hip_width / leg.length - 0.6) + 6 * max(0.0, shoulder_width / arm.length - 1.6)
    fingers = [sum(1 for c in tree.figure.children[limb.joints(0)[2]] if tree.length[c] > 0) for limb in (leg, arm)]
    return float(penalty - (fingers[1] > 2) + (fingers[0] > 2))


def _middle(tree: Tree, limb: Limb) -> np.ndarray:
    """Return the midpoint (S, 3) of the first joints of two limbs."""
    return (tree.place[:, limb.joints(0)[0]] + tree.place[:, limb.joints(1)[0]]) / 2


def _is_animal(tree: Tree, leg: Limb, arm: Limb, legs: list[Limb]) -> bool:
    """Whether it stands on its arms, with legs perpendicular to its trunk, or has more than two legs."""
    trunk = _middle(tree, arm) - _middle(tree, leg)

    def along(limb: Limb) -> np.ndarray:
        ways = [tree.place[:, limb.joints(k)[2]] - tree.place[:, limb.joints(k)[0]] for k in (0, 1)]
        return ways[0] + ways[1]

    down, forth = along(leg), along(arm)
    square = np.abs(_cosine(down, trunk)) < 0.5
    on_all_fours = (np.abs(_cosine(forth, trunk)) < 0.6) & (_cosine(down, forth) > 0.7)
    stands_on_arms = float((square & on_all_fours).mean()) > 0.7 and arm.length > 0.62 * leg.length
    odd = sum(words.is_animal(name) for name in tree.figure.points)
    more = [one for one in legs if one.hub == leg.hub and abs(np.log(one.length / leg.length)) < 0.35]
    own = {k for limb in (leg, arm) for chain in limb.chains for k in chain}
    crowd = {one.joints(k)[1] for one in more for k in (0, 1)} - own
    tiny = arm.length < 0.25 * leg.length
    return stands_on_arms or len(crowd) > 2 or tiny or (odd > 4 and bool(square.mean() > 0.5))


def _cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-9)


def _named(tree: Tree, leg: Limb, arm: Limb, penalty: float) -> Structure:
    """Return the points of a body with these limbs."""
    figure = tree.figure
    left_leg, left_arm, sides, remarks = _left(tree, leg, arm)
    zero = _ZERO * leg.length
    spine, pelvis, neck_below = spine_of(tree, leg, arm, zero)
    points: dict[str, int] = {"pelvis": pelvis}
    hips = _middle(tree, leg)
    trunk = np.linalg.norm(_middle(tree, arm) - hips, axis=-1)
    over_hips = np.median(np.linalg.norm(tree.place[:, pelvis] - hips, axis=-1))
    if arm.chains[0] != arm.chains[1] and over_hips > HIGH_HUB * np.median(trunk):
        points = {}  # the legs hang on the middle of the trunk, as in OpenNI
        spine = [pelvis, *spine]
    head = head_of(tree, leg, arm) or Head(None, None, None, ())
    spine = [*spine, *head.spine]
    if len(spine) > 2:
        spine = [spine[0], spine[len(spine) // 2], spine[-1]]
    for name, point in zip(
        ("spine1", "spine2", "spine3") if len(spine) > 2 else ("spine1", "spine3"), spine, strict=False
    ):
        points[name] = point
    neck = head.neck if head.neck is not None else neck_below
    if neck is not None:
        points["neck"] = neck
    if head.head is not None:
        points["head"] = head.head
    if head.top is not None:
        points["head_top"] = head.top
    for side, a, b in (("left", left_leg, left_arm), ("right", 1 - left_leg, 1 - left_arm)):
        points |= {f"{side}_{role}": k for role, k in zip(("hip", "knee", "ankle"), leg.joints(a), strict=True)}
        points |= {f"{side}_{role}": k for role, k in zip(("shoulder", "elbow", "wrist"), arm.joints(b), strict=True)}
        collar = _collar(tree, arm, b)
        if collar is not None:
            points[f"{side}_collar"] = collar
        points |= {f"{side}_{part}": k for part, k in _foot(tree, points[f"{side}_ankle"], leg.after(a), zero).items()}
        points |= {f"{side}_{part}": k for part, k in fingers_of(tree, points[f"{side}_wrist"]).items()}
    joints = len(figure.joints)
    sited = [name for name, k in points.items() if k >= joints and not name.endswith(("_top", "_toe", "_tip"))]
    if any(name == "pelvis" or "shoulder" in name or "hip" in name for name in sited):
        raise BodysenseError(NO_BODY)
    return Structure(
        {name: k for name, k in points.items() if name not in sited or name.endswith(("head", "wrist", "ankle"))},
        penalty,
        sides,
        remarks,
    )


def _collar(tree: Tree, arm: Limb, which: int) -> int | None:
    """Return the joint that carries a shoulder: one named so, or the first that is closer to it than the elbow."""
    shoulder = arm.joints(which)[0]
    before = [k for k in arm.before(which) if k < len(tree.figure.joints)]
    named = [k for k in before if "collar" in words.parts(tree.figure.points[k])]
    near = [k for k in before if 0.05 * arm.lengths[0] < tree.distance(k, shoulder) < 0.9 * arm.lengths[0]]
    return (named or near or [None])[0]


def _foot(tree: Tree, ankle: int, after: tuple[int, ...], zero: float) -> dict[str, int]:
    """Return the ball of the foot and the tip of the toes."""
    joints = len(tree.figure.joints)
    chain = [k for k in after if tree.distance(k, ankle) > zero]
    named = [
        k for k in chain if "foot" in words.parts(tree.figure.points[k]) and not words.is_end(tree.figure.points[k])
    ]
    balls = [k for k in named or chain if k < joints]
    if not balls:
        return {}
    sure = [k for k in balls if "ankle" not in words.parts(tree.figure.points[k]) and k != chain[-1]]
    ball = (sure if named and sure else balls)[0]
    tips = [k for k in chain[chain.index(ball) + 1 :] if tree.distance(k, ball) > zero]
    if not tips:
        return {"foot": ball}
    return {"foot": ball, "toe": tips[-1]}


def _left(tree: Tree, leg: Limb, arm: Limb) -> tuple[int, int, str, tuple[str, ...]]:
    """Return the index of the left leg and of the left arm, the evidence, and remarks."""
    hips, shoulders = (tree.place[:, limb.joints(0)[0]] - tree.place[:, limb.joints(1)[0]] for limb in (leg, arm))
    crossed = float(_cosine(hips, shoulders).mean()) < 0
    named = [words.side(*([tree.figure.points[k] for k in chain] for chain in limb.chains)) for limb in (leg, arm)]
    if all(named):
        return int(named[0] < 0), int(named[1] < 0), "names", ()
    seen, sure = _anatomical(tree, leg, arm)
    named_side = named[0] or (-named[1] if crossed else named[1])
    remarks: tuple[str, ...] = ()
    if named_side and sure > 1 and named_side != seen:
        remarks = ("left and right are as its names say, though its feet point backward",)
    elif not named_side and sure < _GUESS:
        remarks = ("which side is left is a guess: no name, foot or knee tells",)
    left_leg = int((named_side or seen) < 0)
    return left_leg, 1 - left_leg if crossed else left_leg, "names" if named_side else "the feet", remarks


def _anatomical(tree: Tree, leg: Limb, arm: Limb) -> tuple[int, float]:
    """Return 1 if the first leg is the left one by feet and knees, else -1; and the confidence, 0 to 6."""
    up = _middle(tree, arm) - _middle(tree, leg)
    across = tree.place[:, leg.joints(0)[0]] - tree.place[:, leg.joints(1)[0]]
    votes = np.zeros(len(up))
    for which in (0, 1):
        hip, knee, ankle = (tree.place[:, k] for k in leg.joints(which))
        toes = [k for k in leg.after(which) if tree.distance(k, leg.joints(which)[2]) > 0.1 * leg.lengths[1]]
        shin = ankle - knee
        if toes:  # feet point forward, perpendicular to the shin
            foot = tree.place[:, toes[-1]] - ankle
            votes += 2 * _turn(-shin, foot, across)
        bend = knee - (hip + ankle) / 2
        bent = np.linalg.norm(bend, axis=-1) / leg.length
        votes += np.minimum(10 * bent, 1.0) * _turn(up, bend, across)
    mean = float(votes.mean())
    return (1 if mean > 0 else -1), abs(mean)


def _turn(up: np.ndarray, forward: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Return the cosine (S,) between `across` and the left of a body that faces `forward`."""
    return _cosine(np.cross(up, forward), across)
