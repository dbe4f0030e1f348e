"""Legs and arms of a tree: their joints by name, and those that no name tells but the chain between known ones does.

Lengths are medians over frames, so neither the rest pose nor a stretching bone matters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bodysense.io.rigs.figure import Tree, usual_length
from bodysense.io.rigs.names import joints_of

Kind = Literal["leg", "arm"]
Pair = tuple[tuple[int, ...], tuple[int, ...]]  # chains of points of two mirrored limbs
ROLES: dict[Kind, tuple[str, str, str]] = {"leg": ("hip", "knee", "ankle"), "arm": ("shoulder", "elbow", "wrist")}
ALIKE = 0.25  # share by which the bones of a left and a right limb may differ
ASIDE = 0.1  # of a branch's length, by which ends and helpers count as shorter


@dataclass(frozen=True, eq=False)
class Limb:
    """A pair of limbs, the left one first: the three joints of each, and their chains."""

    tree: Tree = field(repr=False)
    hub: int  # the joint where both begin
    chains: Pair
    joints: tuple[tuple[int, ...], tuple[int, ...]]  # hip, knee, ankle or shoulder, elbow, wrist
    lengths: tuple[float, float]  # of the two bones

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
        return usual_length(self.across)

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


def named_points(tree: Tree) -> dict[str, int]:
    """Return the points that are ours by name, {ours: index}."""
    index = {name: point for point, name in enumerate(tree.figure.points)}
    return {ours: index[given] for given, ours in joints_of(tree.figure.points).items()}


def with_chains(tree: Tree, points: Mapping[str, int], kind: Kind) -> dict[str, int]:
    """Return named points, {ours: point}, and the joints of legs or arms that no name tells but the chain does.

    A joint between two that are known is the one that divides their chain as a person's is divided; the first joint of
    a limb carries the second, and the last is carried by it. A side without a known joint stays so.
    """
    found, taken = dict(points), set(points.values())
    first, second, third = ROLES[kind]
    for side in ("left", "right"):
        names = [f"{side}_{role}" for role in (first, second, third)]
        known = [found[name] for name in names if name in found]
        if not known or (len(known) == len(names) and not tree.means(known[0], "collar")):
            continue
        other = "right" if side == "left" else "left"
        there = (points[f"{other}_{role}"] for role in (first, second, third) if f"{other}_{role}" in points)
        opposite = {above for point in there for above in tree.figure.above(point)}
        end = found.get(names[2])
        if end is None:
            after = [found[name] for name in (f"{side}_foot", f"{side}_toe") if kind == "leg" and name in found]
            knee = found.get(names[1])
            if after:
                end = tree.figure.parents[after[0]]
            elif knee is not None:
                below = longest_chain(tree, knee)
                site = below[0] if below and below[0] >= len(tree.figure.joints) else None  # of an arm without a hand
                end = next((k for k in below if not tree.is_aside(k)), site)
        if end is None or end in taken - {found.get(names[2])}:
            continue
        way = tree.figure.above(end)
        start, middle = found.get(names[0]), found.get(names[1])
        # 'Leg' is the thigh in some rigs and the shin in others; nothing is between a shin and its foot.
        if start in way and middle is None and all(tree.is_aside(k) for k in way[1 : way.index(start)]):
            start, middle = None, start
        if start is None:  # the highest joint of this side alone that is no collar
            own = [k for k in way if k not in opposite]
            above = own[own.index(middle) + 1 :] if middle in own else own[2:]
            above = [k for k in above if k not in taken and not tree.is_aside(k)]
            start = above[0] if above else None
        if start is None or start not in way:
            continue
        chain = [start, *(k for k in way[1 : way.index(start)][::-1] if not tree.is_aside(k))]
        # 'Shoulder' is the collar in some rigs, and then a further joint of the chain is the shoulder.
        firsts = chain if tree.means(start, "collar") else chain[:1]
        middles = chain[1:] if middle is None else [middle]
        pairs = [(a, b) for a in firsts for b in middles if b in chain and chain.index(a) < chain.index(b)]
        if not pairs:
            continue
        lengths = np.array([(tree.distance(a, b), tree.distance(b, end)) for a, b in pairs])
        uneven = np.abs(np.diff(np.log(np.maximum(lengths, 1e-9))))[:, 0]  # the logarithm of the bones' ratio
        start, middle = pairs[int(np.argmin(uneven))]
        found |= dict(zip(names, (start, middle, end), strict=True))
    return found


def named_limb(tree: Tree, points: Mapping[str, int], kind: Kind) -> Limb | None:
    """Return the legs or arms that names give ({ours: point}); None if one is missing or the tree contradicts."""
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
    if not bones.all() or (np.abs(bones[0] - bones[1]) > 2 * ALIKE * bones.max(axis=0)).any():
        return None
    one, other = ((*way[: way.index(hub)][::-1], *longest_chain(tree, way[0])) for way in above)
    upper, lower = bones.mean(axis=0)
    return Limb(tree, hub, (one, other), (joints[0], joints[1]), (float(upper), float(lower)))


def longest_chain(tree: Tree, point: int) -> list[int]:
    """Return the longest chain below a point; helpers and ends count as shorter."""
    chain: list[int] = []
    while below := tree.figure.children[chain[-1] if chain else point]:
        chain.append(max(below, key=lambda k: (tree.length[k] + tree.reach[k]) * (1 - ASIDE * tree.is_aside(k))))
    return chain
