"""Fingers: which chains below a wrist are which, by their names, their numbers, or where they begin."""

from __future__ import annotations

import numpy as np

from bodysense.io.rigs import words
from bodysense.io.rigs.limbs import Tree
from bodysense.io.rigs.words import FINGERS

_METACARPAL = 0.75  # of the next bone: a first one that begins nearer to the wrist is inside the palm
_MOST = 8  # chains that a hand may have
_HELD = 2.0  # times as long as most chains below a wrist: something that the hand holds


def fingers_of(tree: Tree, wrist: int) -> dict[str, int]:
    """Joints and tips of the fingers below a wrist: 'index1', 'index2', 'index3', 'index_tip' …"""
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
    """The branches below a wrist that do not part again, from the wrist on."""
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
    """The finger that each chain is."""
    names = tree.figure.points
    told: dict[str, list[int]] = {}
    for chain in chains:
        hinted = [part for k in chain for part in words.parts(names[k]) if part in FINGERS]
        if hinted and hinted.count(hinted[0]) > 1:
            told.setdefault(hinted[0], chain)
    if told:
        return told
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
    """The three joints that bend: without a bone inside the palm, named so or too near to the wrist."""
    names = tree.figure.points
    if len(joints) > 3 and len(chain) > len(joints):  # four that bend and a tip: the first is inside the palm
        return joints[1:]
    if finger == "thumb" or len(joints) < 3:
        return joints
    if "carpal" in "".join(words.words(names[joints[0]])) or (names[joints[0]].endswith("MC")):
        return joints[1:]
    near = tree.distance(wrist, joints[0]) < _METACARPAL * tree.length[joints[1]]
    return joints[1:] if near and len(chain) > 3 else joints
