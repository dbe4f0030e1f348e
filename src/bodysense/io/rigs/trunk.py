"""The trunk: spine, pelvis, neck and head between the limbs; and the fingers.

Fingers are identified by their names, their numbers, or their positions on the hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.io.rigs import words
from bodysense.io.rigs.limbs import Limb, Tree
from bodysense.io.rigs.words import FINGERS

HEAD_HEIGHT = 0.40  # of the trunk's length: height of a head joint over the shoulders
_NECK_HEIGHT = 0.3  # a lower joint is a neck if there is more above it
_NAMED_NECK_HEIGHT = 0.36  # the limit for joints named as a neck
_TOP_HEIGHT = 0.55  # a last joint above this is the top of the head
_BESIDE = 0.35  # of the trunk's length; points farther from the middle are not a head


@dataclass(frozen=True)
class Head:
    """The joints over the shoulders."""

    head: int | None  # if a joint is at that height
    neck: int | None
    top: int | None
    spine: tuple[int, ...]  # joints below the neck that do not carry the arms


def head_of(tree: Tree, leg: Limb, arm: Limb) -> Head | None:
    """Return the head of a body with these limbs; None if nothing is over its shoulders."""
    figure = tree.figure
    hips, shoulders = ((tree.place[:, limb.joints(0)[0]] + tree.place[:, limb.joints(1)[0]]) / 2 for limb in (leg, arm))
    trunk = shoulders - hips
    length = np.maximum(np.linalg.norm(trunk, axis=-1, keepdims=True), 1e-9)
    up = trunk / length
    across = tree.place[:, arm.joints(0)[0]] - tree.place[:, arm.joints(1)[0]]
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)

    def height(point: int) -> float:
        return float(np.median(((tree.place[:, point] - shoulders) * up).sum(-1) / length[:, 0]))

    def beside(point: int) -> float:
        return abs(float(np.median(((tree.place[:, point] - shoulders) * across).sum(-1) / length[:, 0])))

    limbs = {k for limb in (leg, arm) for chain in limb.chains for k in chain}
    way_up = figure.above(arm.hub)
    hubs = [arm.hub, *way_up[1:]] if leg.hub not in way_up else way_up[: way_up.index(leg.hub) + 1]
    found: list[tuple[float, list[int]]] = []
    for rank, hub in enumerate(hubs):
        for child in figure.children[hub]:
            if child not in limbs and child not in way_up and leg.hub not in _below_few(tree, child, leg.hub):
                chain = _upward(tree, child, height, beside)
                of_head = [k for k in chain if words.parts(figure.points[k]) & {"neck", "head"}]
                named = bool(of_head)
                tip = max(height(k) for k in chain)
                # An end site behind a named head may point anywhere.
                if (named or tip > 0.12) and beside((of_head or chain)[-1]) < _BESIDE:
                    found.append((3.0 * named + min(tip, 1.0) - 0.3 * rank, chain))
        if found:
            break
    if not found:
        return None
    return _split(tree, max(found, key=lambda pair: pair[0])[1], height)


def _below_few(tree: Tree, point: int, wanted: int) -> tuple[int, ...]:
    """Return the wanted point as a tuple if it is below another, else an empty tuple."""
    return (wanted,) if point in tree.figure.above(wanted) else ()


def _upward(tree: Tree, start: int, height, beside) -> list[int]:
    """Return the chain from a joint up to a leaf, along head or neck by name, else the most central and highest."""
    chain = [start]
    while children := [k for k in tree.figure.children[chain[-1]] if not _is_aside(tree.figure.points[k])]:
        best = max(
            children,
            key=lambda k: (
                bool(words.parts(tree.figure.points[k]) & {"neck", "head"}),
                height(k) - 2 * beside(k) + (tree.reach[k] > 0) * 1e-3,
            ),
        )
        if chain and "head" in words.parts(tree.figure.points[chain[-1]]) and len(children) > 4:
            break  # a face
        chain.append(best)
    return chain


def _is_aside(name: str) -> bool:
    """Whether a name means a helper outside the neck; NeckTwist02 is part of it."""
    return words.is_helper(name) and not words.parts(name) & {"neck"}


def _split(tree: Tree, chain: list[int], height) -> Head | None:
    """Split a chain above the shoulders into spine, neck, head and top of the head."""
    figure = tree.figure
    joints = [k for k in chain if k < len(figure.joints)]
    if not joints:
        return None

    def hinted(k: int, part: str) -> bool:
        return part in words.parts(figure.points[k]) and not words.is_end(figure.points[k])

    spine = [k for k in joints if hinted(k, "spine")]
    if not any(hinted(k, part) for k in joints for part in ("neck", "head")):
        spine = [k for k in joints[:-2] if height(k) < -0.05]
    joints = [k for k in joints if k not in spine]
    if not joints:
        return None
    heads = [k for k in joints if hinted(k, "head")]
    if not heads and all(hinted(k, "spine") for k in joints):
        heads = joints[-1:]  # spine.006 of Rigify
    necks = [k for k in joints if hinted(k, "neck")]
    alone, tip = len(joints) == 1, height(joints[-1])
    is_neck = alone and tip < _NECK_HEIGHT and not tree.reach[joints[0]]
    if not heads and (is_neck or (necks == joints and (alone or tip < _NAMED_NECK_HEIGHT))):
        end = chain[-1] if chain[-1] not in joints else joints[0]
        return _on_neck(joints[0], end, height(end), tuple(spine))
    if not heads:
        heads = [k for k in joints if k not in necks] or joints[-1:]
        high = [k for k in heads if height(k) > _NECK_HEIGHT]
        if not necks and len(high) > 1 and height(heads[-1]) > _TOP_HEIGHT and not tree.reach[heads[-1]]:
            high = high[:-1]
        heads = [min(high or heads, key=lambda k: abs(height(k) - HEAD_HEIGHT))]
    head = heads[0]
    before = joints[: joints.index(head)]
    above = [k for k in chain[chain.index(head) + 1 :] if tree.distance(k, head) > 0.02 * tree.reach[0] / 2]
    tops = [k for k in above if words.is_end(figure.points[k]) or k >= len(figure.joints)] or above
    named = [k for k in before if hinted(k, "neck")]
    top = tops[-1] if tops and height(tops[-1]) > height(head) else None
    return Head(head, (named or before or [None])[0], top, tuple(spine))


def _on_neck(neck: int, tip: int, height: float, spine: tuple[int, ...]) -> Head:
    """Classify the tip of a neck without further joints: nothing, a head or its top, by its height."""
    if tip == neck or height < _NECK_HEIGHT:
        return Head(None, neck, None, spine)
    return Head(None, neck, tip, spine) if height > _TOP_HEIGHT else Head(tip, neck, None, spine)


def spine_of(tree: Tree, leg: Limb, arm: Limb, zero: float) -> tuple[list[int], int, int | None]:
    """Return the joints of the spine from below, the pelvis, and the neck if it carries the arms."""
    figure = tree.figure
    from_arms, from_legs = figure.above(arm.hub), figure.above(leg.hub)
    meet = next(k for k in from_arms if k in from_legs)
    down = from_legs[: from_legs.index(meet) + 1]  # from the legs' hub up to where both meet
    path = [*down, *reversed(from_arms[: from_arms.index(meet)])]
    named = [
        k for k in [*from_legs[1:4], *path[:3]] if "pelvis" in words.parts(figure.points[k]) and _is_near(tree, k, leg)
    ]
    pelvis = leg.hub
    if named and "pelvis" not in words.parts(figure.points[leg.hub]):
        pelvis = named[0]
    if pelvis in path:
        path = path[path.index(pelvis) + 1 :] if path.index(pelvis) >= path.index(leg.hub) else path
    spine = [
        k for k in path if k != pelvis and not words.is_helper(figure.points[k]) and tree.distance(k, pelvis) > zero
    ]
    neck = None
    if spine and "neck" in words.parts(figure.points[spine[-1]]):
        neck = spine.pop()
    return spine, pelvis, neck


def _is_near(tree: Tree, point: int, leg: Limb) -> bool:
    """Whether a joint is close enough to the hips for a pelvis."""
    hips = (tree.place[:, leg.joints(0)[0]] + tree.place[:, leg.joints(1)[0]]) / 2
    return float(np.median(np.linalg.norm(tree.place[:, point] - hips, axis=-1))) < 0.45 * leg.length


_METACARPAL = 0.75  # of the next bone: a first joint closer to the wrist is inside the palm
_MOST = 8  # most chains of a hand
_HELD = 2.0  # longer than most chains below a wrist by this factor: an object in the hand


def fingers_of(tree: Tree, wrist: int) -> dict[str, int]:
    """Return joints and tips of the fingers below a wrist: 'index1', 'index2', 'index3', 'index_tip' …"""
    if wrist >= len(tree.figure.joints):
        return {}
    found: dict[str, int] = {}
    for finger, chain in _which(tree, wrist, _chains(tree, wrist)).items():
        joints = [k for k in chain if k < len(tree.figure.joints)]
        joints = _without_metacarpal(tree, wrist, finger, chain, joints)[:3]
        if len(joints) < 2:
            continue
        found |= {f"{finger}{k}": joint for k, joint in enumerate(joints, start=1)}
        tips = chain[chain.index(joints[-1]) + 1 :]
        if len(joints) == 3 and tips and tree.length[tips[0]] > 0:
            found[f"{finger}_tip"] = tips[0]
    return found


def _chains(tree: Tree, wrist: int) -> list[list[int]]:
    """Return the branches below a wrist without further branching, from the wrist on."""
    figure = tree.figure
    leaves = []
    todo = [wrist]
    while todo:
        point = todo.pop()
        children = [k for k in figure.children[point] if not words.is_helper(figure.points[k])]
        todo += children
        if not children and point != wrist:
            leaves.append(point)
    if len(leaves) > 4 * _MOST:
        return []
    chains = []
    for leaf in leaves:
        above = figure.above(leaf)
        chain = list(reversed(above[: above.index(wrist)]))
        alone = [k for k in chain if sum(k in figure.above(other) for other in leaves) == 1]
        if alone:
            chains.append(alone)
    return [chain for chain in chains if len([k for k in chain if k < len(figure.joints)]) >= 2][:_MOST]


def _which(tree: Tree, wrist: int, chains: list[list[int]]) -> dict[str, list[int]]:
    """Return the chain of each finger."""
    names = tree.figure.points
    hinted_chains: dict[str, list[int]] = {}
    for chain in chains:
        hinted = [part for k in chain for part in words.parts(names[k]) if part in FINGERS]
        if hinted and hinted.count(hinted[0]) > 1:
            hinted_chains.setdefault(hinted[0], chain)
    if hinted_chains:
        return hinted_chains
    numbered = [chain for chain in chains if any(words.parts(names[k]) & {"finger"} for k in chain)]
    if len(numbered) in (4, 5):
        return dict(zip(FINGERS, sorted(numbered, key=lambda chain: names[chain[0]]), strict=False))
    usual = np.median([tree.way(wrist, chain) for chain in chains]) if chains else 0.0
    chains = [chain for chain in chains if tree.way(wrist, chain) < _HELD * usual]
    if len(chains) not in (4, 5):
        return {}
    ways = np.stack([tree.place[:, chain[-1]] - tree.place[:, wrist] for chain in chains])
    ways /= np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)
    rest = (ways.sum(axis=0) - ways) / (len(chains) - 1)
    apart = np.median((ways * rest).sum(-1), axis=1)  # the thumb points elsewhere
    thumb = chains[int(np.argmin(apart))]
    others = [chain for chain in chains if chain is not thumb]
    knuckles = np.stack([tree.place[:, chain[0]] - tree.place[:, wrist] for chain in others])
    along = knuckles.mean(axis=0)
    base = tree.place[:, thumb[0]] - tree.place[:, wrist]
    share = (base * along).sum(-1) / np.maximum((along * along).sum(-1), 1e-12)
    across = base - share[:, None] * along  # over the palm, towards the thumb
    ranks = -np.median((knuckles * across).sum(-1), axis=1)
    others = [others[k] for k in np.argsort(ranks)]
    return dict(zip(FINGERS, [thumb, *others], strict=False))


def _without_metacarpal(tree: Tree, wrist: int, finger: str, chain: list[int], joints: list[int]) -> list[int]:
    """Return the three bending joints: without a bone inside the palm, known by name or by distance to the wrist."""
    names = tree.figure.points
    if len(joints) > 3 and len(chain) > len(joints):  # four joints and a tip: the first is inside the palm
        return joints[1:]
    if finger == "thumb" or len(joints) < 3:
        return joints
    if "carpal" in "".join(words.words(names[joints[0]])) or (names[joints[0]].endswith("MC")):
        return joints[1:]
    near = tree.distance(wrist, joints[0]) < _METACARPAL * tree.length[joints[1]]
    return joints[1:] if near and len(chain) > 3 else joints
