"""Figure: a tree of joints as a file holds it, in the file's own units and axes, with its motion.

Tree: its measured lengths, by which a body is recognised.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from bodysense.body.pose import tree_kinematics
from bodysense.body.skeleton import chain_to_root
from bodysense.geometry.rotation import quaternion_multiply, quaternion_rotate
from bodysense.io.rigs.names import is_end, is_helper, parts

_MIRROR, _MIRRORED_TURN = np.array([-1.0, 1.0, 1.0]), np.array([1.0, 1.0, -1.0, -1.0])  # of places; of wxyz
SAMPLE = 120  # frames, evenly spaced, in which lengths are measured


LONG = 8192  # frames; rotations of a longer motion are computed when they are taken
BLOCK = 2048  # frames of a long motion that are computed at once


@dataclass(frozen=True, eq=False)
class LazyRotation:
    """Local rotations (T, J, 4) of a long motion, computed when frames of it are taken."""

    shape: tuple[int, int, int]
    take: Callable[[np.ndarray], np.ndarray] = field(repr=False)  # frames (N,) → (N, J, 4)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, frames: slice | np.ndarray) -> np.ndarray:
        return self.take(np.arange(len(self))[frames])


Rotation = np.ndarray | LazyRotation
Index = slice | np.ndarray


def _changed(rotation: Rotation, joints: int, change: Callable[[np.ndarray, Index], np.ndarray]) -> Rotation:
    """Return rotations (T, joints, 4) after a change, which gets rotations (N, J, 4) and their frames."""
    if isinstance(rotation, np.ndarray):
        return change(rotation, slice(None))
    return LazyRotation((len(rotation), joints, 4), lambda frames: change(rotation[frames], frames))


def blocks_of(frames: int) -> list[slice]:
    """Return consecutive slices of some frames."""
    return [slice(start, min(start + BLOCK, frames)) for start in range(0, frames, BLOCK)]


@dataclass(frozen=True, eq=False)
class Figure:
    """One tree of a file. Points are the joints, then the end sites; parents come before their children."""

    name: str  # of the file, for messages
    joints: tuple[str, ...]  # the file's names, made unique
    end_sites: tuple[str, ...]
    parents: tuple[int, ...]  # one per point; -1 for the root
    offset: np.ndarray = field(repr=False)  # (P, 3) file units, from the parent, all rotations zero
    rotation: Rotation = field(repr=False)  # (T, J, 4) parent ← joint
    position: dict[int, np.ndarray] = field(repr=False)  # (T, 3) file units, of joints with channels
    frame_rate: float  # Hz
    nodes: tuple[int, ...] = field(repr=False)  # which node of the file each point is

    def __len__(self) -> int:
        return len(self.rotation)

    @cached_property
    def points(self) -> tuple[str, ...]:
        """Names of all points: joints, then end sites."""
        return self.joints + self.end_sites

    @cached_property
    def children(self) -> list[list[int]]:
        """Children of each point."""
        found: list[list[int]] = [[] for _ in self.parents]
        for point, parent in enumerate(self.parents):
            if parent >= 0:
                found[parent].append(point)
        return found

    @cached_property
    def bone(self) -> np.ndarray:
        """(P, 3) offset of each point from its parent at rest, file units: the median of a varying one."""
        bone = self.offset.copy()
        for joint, place in self.position.items():
            if joint:
                bone[joint] = np.median(place, axis=0)
        return bone

    @cached_property
    def turns(self) -> bool:
        """Whether any joint turns; otherwise the motion is in positions alone."""
        return any(bool(np.any(self.rotation[block][..., 1:])) for block in blocks_of(len(self)))

    def frames(self, frames: Index) -> Figure:
        """Return the figure in some frames."""
        position = {joint: place[frames] for joint, place in self.position.items()}
        return replace(self, rotation=self.rotation[frames], position=position)

    def above(self, point: int) -> list[int]:
        """Return a point and its ancestors up to the root."""
        return chain_to_root(self.parents, point)

    def under(self, top: int) -> list[int]:
        """Return a point and its descendants, parents first."""
        found = [top]
        for point in found:
            found += self.children[point]
        return sorted(found)

    def below(self, root: int) -> Figure:
        """Return the tree below a joint, which becomes the root and keeps its world position."""
        return self.only(self.under(root))

    def only(self, keep: list[int]) -> Figure:
        """Return the figure of some points: the first is above all others, and points between them are included."""
        place, turn = self.world([keep[0]])
        index = {point: new for new, point in enumerate(keep)}
        joints = [point for point in keep if point < len(self.joints)]

        def kept(rotation: np.ndarray, frames: Index) -> np.ndarray:
            kept = rotation[:, joints].copy()
            kept[:, 0] = turn[frames, 0]
            return kept

        offset = self.offset[keep].copy()
        position = {index[joint]: p for joint, p in self.position.items() if joint in index}
        return Figure(
            name=self.name,
            joints=tuple(self.points[point] for point in joints),
            end_sites=tuple(self.points[point] for point in keep if point >= len(self.joints)),
            parents=tuple(-1 if point == keep[0] else index[self.parents[point]] for point in keep),
            offset=offset,
            rotation=_changed(self.rotation, len(joints), kept),
            position=position | {0: place[:, 0]},
            frame_rate=self.frame_rate,
            nodes=tuple(self.nodes[point] for point in keep),
        )

    def mirrored(self) -> Figure:
        """Return the figure with its x axis reversed: that of a left-handed world."""
        return replace(
            self,
            offset=self.offset * _MIRROR,
            rotation=_changed(self.rotation, len(self.joints), lambda rotation, _: rotation * _MIRRORED_TURN),
            position={joint: place * _MIRROR for joint, place in self.position.items()},
        )

    def with_joints(self, names: list[str]) -> Figure:
        """Return the figure with some end sites (a hand or foot) as joints that do not turn."""
        count = len(self.joints)
        turned = [point for point in range(count, len(self.parents)) if self.points[point] in names]
        order = [*range(count), *turned, *(p for p in range(count, len(self.parents)) if p not in turned)]
        index = {point: new for new, point in enumerate(order)}
        still = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(turned), 1))

        def extended(rotation: np.ndarray, _: Index) -> np.ndarray:
            return np.concatenate([rotation, np.repeat(still, len(rotation), axis=0)], axis=1)

        return replace(
            self,
            joints=self.joints + tuple(self.points[point] for point in turned),
            end_sites=tuple(self.points[point] for point in order[count + len(turned) :]),
            parents=tuple(-1 if self.parents[p] < 0 else index[self.parents[p]] for p in order),
            offset=self.offset[order],
            rotation=_changed(self.rotation, count + len(turned), extended),
            nodes=tuple(self.nodes[point] for point in order),
        )

    def world(self, points: list[int] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return world positions (T, P, 3), file units, and rotations (T, P, 4) of some points, or of all.

        An end site has its joint's rotation.
        """
        if not isinstance(self.rotation, np.ndarray):
            parts = [self.frames(block).world(points) for block in blocks_of(len(self))]
            places, turns = zip(*parts, strict=True)
            return np.concatenate(places), np.concatenate(turns)
        wanted = list(range(len(self.parents))) if points is None else points
        count = len(self.joints)
        if not self.position.keys() - {0}:
            root = self.position[0] if 0 in self.position else self.offset[0]
            at, turned = tree_kinematics(self.parents, self.offset, root, self.rotation)
            carried = [k if k < count else self.parents[k] for k in wanted]
            return at[:, wanted], turned[:, carried]
        place: dict[int, np.ndarray] = {}
        turn: dict[int, np.ndarray] = {}
        for k in sorted({above for point in points for above in self.above(point)}) if points else wanted:
            at = self.position.get(k, np.broadcast_to(self.offset[k], (len(self), 3)))
            if (parent := self.parents[k]) < 0:
                place[k], turn[k] = at, self.rotation[:, k]
                continue
            place[k] = place[parent] + quaternion_rotate(turn[parent], at)
            turn[k] = quaternion_multiply(turn[parent], self.rotation[:, k]) if k < count else turn[parent]
        return np.stack([place[k] for k in wanted], 1), np.stack([turn[k] for k in wanted], 1)


@dataclass(frozen=True, eq=False)
class Tree:
    """A figure with measured lengths, in file units."""

    figure: Figure
    place: np.ndarray = field(repr=False)  # (S, P, 3) in some of its frames

    @cached_property
    def length(self) -> np.ndarray:
        """(P,) median distance from the parent."""
        parents = np.maximum(self.figure.parents, 0)
        return np.median(np.linalg.norm(self.place - self.place[:, parents], axis=-1), axis=0)

    @cached_property
    def reach(self) -> np.ndarray:
        """(P,) longest path down from each point."""
        reach, count = np.zeros(len(self.length)), len(self.figure.joints)
        for point in (*range(count, len(reach)), *range(count - 1, 0, -1)):  # end sites come last, without children
            parent = self.figure.parents[point]
            reach[parent] = max(reach[parent], reach[point] + self.length[point])
        return reach

    def distance(self, a: int, b: int) -> float:
        """Return the median distance of two points."""
        return usual_length(self.place[:, a] - self.place[:, b])

    def way(self, start: int, chain: Sequence[int]) -> float:
        """Return the length of a chain from the point that carries it."""
        return self.distance(start, chain[0]) + float(sum(self.length[k] for k in chain[1:]))

    def name(self, point: int) -> str:
        """Return the name of a point."""
        return self.figure.points[point]

    def means(self, point: int, *some: str) -> bool:
        """Whether a point's name may mean one of some parts of a body."""
        return not parts(self.name(point)).isdisjoint(some)

    def is_aside(self, point: int) -> bool:
        """Whether a point's name means a helper or the end of something."""
        return is_helper(self.name(point)) or is_end(self.name(point))


def usual_length(vectors: np.ndarray) -> float:
    """Return the median length of vectors (S, 3)."""
    return float(np.median(np.linalg.norm(vectors, axis=-1)))


def measured(figure: Figure) -> Tree:
    """Return the tree of a figure, measured in some of its frames."""
    frames = np.unique(np.linspace(0, len(figure) - 1, SAMPLE).astype(int))
    return Tree(figure, figure.frames(frames).world()[0])


def positions_in_parent(position: dict[int, np.ndarray], offset: np.ndarray) -> dict[int, np.ndarray]:
    """Return positions (T, 3) in the parent of each joint that has position channels.

    In files of MotionBuilder and Blender these replace the joint's offset; some programs write small values to be added
    to it. A joint whose channels are all zero is treated as most of the others are.
    """
    small = {
        joint
        for joint, place in position.items()
        if joint > 0 and np.linalg.norm(place, axis=1).max() < 0.2 * np.linalg.norm(offset[joint])
    }
    nonzero = [joint for joint in position if joint > 0 and (np.any(position[joint]) or not np.any(offset[joint]))]
    if 2 * sum(joint not in small for joint in nonzero) > len(position) - 1:
        small = {joint for joint in small if np.any(position[joint])}
    return {
        joint: place + offset[joint] if joint in small else place
        for joint, place in position.items()
        if joint not in small or np.any(place)
    }
