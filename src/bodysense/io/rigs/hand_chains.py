"""Fingers below a wrist: identified by their names, their numbers, or their positions on the hand."""

from __future__ import annotations

from collections import Counter

import numpy as np

from bodysense.body.hands.hand import FINGERS
from bodysense.io.rigs.figure import Tree
from bodysense.io.rigs.names import is_helper, parts, words

_METACARPAL = 0.75  # of the next bone: a first joint closer to the wrist is inside the palm
_MOST = 8  # most chains of a hand
_HELD = 2.0  # longer than most chains below a wrist by this factor: an object in the hand


def fingers_of(tree: Tree, wrist: int) -> dict[str, int]:
    """Return joints and tips of the fingers below a wrist: 'index1', 'index2', 'index3', 'index_tip' …

    Fingers are identified by their names, their numbers, or their positions on the hand.
    """
    count = len(tree.figure.joints)
    found: dict[str, int] = {}
    for finger, chain in _chain_of_each_finger(tree, wrist, _finger_chains(tree, wrist)).items():
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


def _chain_of_each_finger(tree: Tree, wrist: int, chains: list[list[int]]) -> dict[str, list[int]]:
    """Return the chain of each finger."""
    named: dict[str, list[int]] = {}
    for chain in chains:
        fingers = [part for k in chain for part in parts(tree.name(k)) if part in FINGERS]
        if fingers and fingers.count(fingers[0]) > 1:
            named.setdefault(fingers[0], chain)
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
    label = words(tree.name(joints[0]))
    if "carpal" in "".join(label) or "mc" in label:
        return True
    return len(chain) > 3 and bool(tree.distance(wrist, joints[0]) < _METACARPAL * tree.length[joints[1]])
