"""Body: the joints of a tree that match ours. Pelvis, spine, neck and head follow from its legs and arms."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.hands.hand import FINGERS
from bodysense.errors import BodysenseError
from bodysense.io.fingers import is_finger
from bodysense.io.rigs.figure import Tree, usual_length
from bodysense.io.rigs.hand_chains import fingers_of
from bodysense.io.rigs.limbs import ROLES, Limb, named_limb, named_points, with_chains
from bodysense.io.rigs.names import is_animal, is_end, is_helper, spread

Head = tuple[list[int], dict[str, int]]  # joints of the spine that do not carry the arms; neck, head and its top
WORST = 16.0  # penalty at which the confidence in a body is 0
NO_BODY = "not a humanoid: two legs and two arms were not found"
HEADLESS = 6.0  # penalty of a body without a head
_HIGH_HUB = 0.3  # of the distance to the shoulders: a joint this far from the hips is not a pelvis
_NEAR_HIPS = 0.45  # of a leg's length: a joint farther from the hips is not a pelvis
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


@dataclass(frozen=True, eq=False)
class Limbs:
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
    def head(self) -> Head | None:
        """Joints over the shoulders, or None."""
        return _head_of(self)

    def over_hips(self, point: int) -> float:
        """Return the median distance of a point from the middle of the hips."""
        return usual_length(self.tree.place[:, point] - self.leg.middle)


def named_body(tree: Tree) -> Body | None:
    """Return the body in a tree whose names give legs and arms; None if they do not, or if it is not a person's."""
    points = named_points(tree)
    leg, arm = (named_limb(tree, with_chains(tree, points, kind), kind) for kind in ROLES)
    if leg is None or arm is None:
        return None
    limbs = Limbs(leg, arm)
    if not limbs.are_four or stands_on_arms(limbs):
        return None
    return body_of(limbs, points, unlikeness(limbs) + (0 if limbs.head else HEADLESS))


# --- how unlike a person's body ---


def unlikeness(limbs: Limbs) -> float:
    """Return the penalty of combining legs and arms in one body."""
    tree, leg, arm = limbs.tree, limbs.leg, limbs.arm
    penalty = 0.0
    for ratio, (usual, deviation) in (
        (leg.length / arm.length, _LEGS_OVER_ARMS),
        (max(limbs.trunk_length / leg.length, 1e-3), _TRUNK_OVER_LEGS),
    ):
        penalty += (np.log(ratio / usual) / deviation) ** 2
    penalty += 8 * max(0.0, leg.width / leg.length - 0.6) + 6 * max(0.0, arm.width / arm.length - 1.6)
    fingers = [sum(tree.length[c] > 0 for c in tree.figure.children[limb.joints[0][2]]) for limb in (leg, arm)]
    return float(penalty - (fingers[1] > 2) + (fingers[0] > 2))


def stands_on_arms(limbs: Limbs) -> bool:
    """Whether it stands on its arms as an animal does, with legs perpendicular to its trunk, or has tiny arms."""
    tree, leg, arm = limbs.tree, limbs.leg, limbs.arm
    down, forth = (
        np.sum([tree.place[:, third] - tree.place[:, first] for first, _, third in limb.joints], axis=0)
        for limb in (leg, arm)
    )
    square = np.abs(cosine(down, limbs.trunk)) < 0.5
    on_all_fours = (np.abs(cosine(forth, limbs.trunk)) < 0.6) & (cosine(down, forth) > 0.7)
    if float((square & on_all_fours).mean()) > 0.7 and arm.length > 0.62 * leg.length:
        return True
    is_odd = sum(map(is_animal, tree.figure.points)) > 4 and bool(square.mean() > 0.5)
    return is_odd or arm.length < 0.25 * leg.length


def cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return cosines (S,) of the angles between vectors (S, 3)."""
    return (a * b).sum(-1) / np.maximum(np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1), 1e-9)


# --- the points of a body ---


def body_of(limbs: Limbs, named: Mapping[str, int], penalty: float) -> Body:
    """Return the points of a body with these limbs; `named` are points that are ours by name."""
    leg, arm = limbs.leg, limbs.arm
    zero = _ZERO * leg.length
    spine, pelvis, neck = _spine_of(limbs, zero)
    points: dict[str, int] = {"pelvis": pelvis}
    if arm.chains[0] != arm.chains[1] and limbs.over_hips(pelvis) > _HIGH_HUB * limbs.trunk_length:
        points = {}  # the legs hang on the middle of the trunk, as in OpenNI
        spine = [pelvis, *spine]
    more_spine, head = limbs.head or ([], {})
    points |= spread([*spine, *more_spine]) | ({} if neck is None else {"neck": neck}) | head
    for k, side in enumerate(("left", "right")):
        own = dict(zip(ROLES["leg"], leg.joints[k], strict=True)) | dict(zip(ROLES["arm"], arm.joints[k], strict=True))
        own |= _collar_of(arm, k) | _foot_of(leg, k, zero)
        points |= {f"{side}_{part}": point for part, point in own.items()}
        points |= _fingers_of(limbs.tree, side, own["wrist"], named)
    joints = len(limbs.tree.figure.joints)
    sited = [name for name, k in points.items() if k >= joints and not name.endswith(("_top", "_toe", "_tip"))]
    if any(name == "pelvis" or "shoulder" in name or "hip" in name for name in sited):
        raise BodysenseError(NO_BODY)
    gone = [name for name in sited if not name.endswith(("head", "wrist", "ankle"))]
    return Body({name: k for name, k in points.items() if name not in gone}, penalty)


def _collar_of(arm: Limb, which: int) -> dict[str, int]:
    """Return the joint that carries a shoulder: one named so, or the first that is closer to it than the elbow."""
    tree, shoulder = arm.tree, arm.joints[which][0]
    before = [k for k in arm.before(which) if k < len(tree.figure.joints)]
    named = [k for k in before if tree.means(k, "collar")]
    near = [k for k in before if 0.05 * arm.lengths[0] < tree.distance(k, shoulder) < 0.9 * arm.lengths[0]]
    return {"collar": (named or near)[0]} if named or near else {}


def _foot_of(leg: Limb, which: int, zero: float) -> dict[str, int]:
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


def _fingers_of(tree: Tree, side: str, wrist: int, named: Mapping[str, int]) -> dict[str, int]:
    """Return joints and tips of a side's fingers: by name if every finger joint below the wrist has a known name."""
    figure = tree.figure
    below = figure.under(wrist)[1:]
    own = {name: k for name, k in named.items() if name.startswith(side) and is_finger(name.removesuffix("_tip"))}
    found = {name: k for name, k in own.items() if k in below}
    finger_joints = {k for k in below if k < len(figure.joints) and tree.means(k, "finger", *FINGERS)}
    if found and finger_joints <= set(found.values()):
        return {name: k for name, k in found.items() if not name.endswith("_tip") or tree.length[k] > 0}
    if not any(tree.reach[k] > 0 for k in figure.children[wrist]):
        return {}
    return {f"{side}_{part}": point for part, point in fingers_of(tree, wrist).items()}


def _spine_of(limbs: Limbs, zero: float) -> tuple[list[int], int, int | None]:
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


def _head_of(limbs: Limbs) -> Head | None:
    """Return the joints over the shoulders of a body with these limbs; None without such joints."""
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


def _split(tree: Tree, chain: list[int], height: np.ndarray, trunk: float) -> Head | None:
    """Split a chain above the shoulders into spine, and neck, head and top of the head."""
    joints = [k for k in chain if k < len(tree.figure.joints)]
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
    is_alone, tip = len(joints) == 1, height[joints[-1]]
    is_low = is_alone and tip < _NECK_HEIGHT and not tree.reach[joints[0]]
    if not heads and (is_low or (necks == joints and (is_alone or tip < _NAMED_NECK_HEIGHT))):
        ends = [k for k in chain[-1:] if k not in joints and height[k] >= _NECK_HEIGHT]
        return spine, {"neck": joints[0], **{"head_top" if height[k] > _TOP_HEIGHT else "head": k for k in ends}}
    if not heads:
        heads = [k for k in joints if k not in necks] or joints[-1:]
        high = [k for k in heads if height[k] > _NECK_HEIGHT]
        heads = [min(high or heads, key=lambda k: abs(height[k] - _HEAD_HEIGHT))]
    head = heads[0]
    points, before = {"head": head}, joints[: joints.index(head)]
    if before:
        points["neck"] = next((k for k in before if k in necks), before[0])
    above = [k for k in chain[chain.index(head) + 1 :] if tree.distance(k, head) > 0.01 * tree.reach[0]]
    # Some programs put the end of a head in front of it or at its side.
    if above and (height[above[-1]] - height[head]) * trunk >= _UPWARD * tree.distance(above[-1], head):
        points["head_top"] = above[-1]
    return spine, points
