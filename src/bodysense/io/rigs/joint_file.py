"""JointFile: a motion file's joints and the numbers of its frames, whatever its format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import accumulate
from pathlib import Path
from typing import Self

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import euler_to_quaternion, quaternion_canonical, quaternion_to_euler, swing_twist
from bodysense.io.rigs.figure import LONG
from bodysense.observing.world_axes import UpAxis

_BLOCK = 256  # frames converted at once


@dataclass
class Node:
    """A joint or End Site of the HIERARCHY section."""

    name: str
    parent: int  # among the nodes; -1 for a root
    is_site: bool
    offset: tuple[float, ...] | None = None
    channels: tuple[str, ...] = ()  # 'Xposition' …


@dataclass(frozen=True, eq=False)
class JointFile(ABC):
    """The joints of a motion file, parents before children, and its motion in file units and degrees.

    A joint's channels turn it in the order they are listed; position channels replace its offset. End sites are in
    `tree` alone.
    """

    path: Path
    tree: tuple[Node, ...]  # joints and end sites, parents before children
    nodes: tuple[int, ...]  # which node of the tree each joint is
    joints: tuple[str, ...]
    parents: tuple[int, ...]  # the joint above each; -1 for a root
    offset: np.ndarray  # (J, 3) from the parent, file units
    channels: tuple[tuple[str, ...], ...]  # of each joint, 'Xposition' …, in the file's order
    values: np.ndarray  # (T, C); NaN where the file's value is not a number
    frame_rate: float  # Hz
    warnings: tuple[str, ...] = field(default=(), kw_only=True)  # doubts about the file

    @property
    def unit(self) -> str | None:
        """Length unit that the format states, as an option has it; None if it states none."""
        return None

    @property
    def up(self) -> UpAxis | None:
        """Upward axis that the format states; None if it states none."""
        return None

    @abstractmethod
    def with_values(self, values: np.ndarray, changed: np.ndarray) -> Self:
        """Return the file with numbers (T, C) that differ from its own only where `changed` (T, C)."""

    @abstractmethod
    def with_frames(self, row: np.ndarray, count: int, frame_rate: float) -> Self:
        """Return the file with `count` frames of one row (C,) of values."""

    @abstractmethod
    def write(self, path: str | Path) -> None:
        """Write the file; it appears whole or not at all."""

    @cached_property
    def columns(self) -> tuple[range, ...]:
        """Each joint's columns in a frame."""
        starts = [0, *accumulate(len(node.channels) for node in self.tree)]  # an End Site may have channels, too
        return tuple(range(starts[k], starts[k + 1]) for k in self.nodes)

    @cached_property
    def order(self) -> tuple[str, ...]:
        """The axes that each joint turns about, 'ZXY', in the order of its channels; '' for one that cannot turn."""
        return tuple("".join(c[0] for c in channels if c.endswith("rotation")) for channels in self.channels)

    def columns_of(self, joint: int, kind: str) -> list[int]:
        """Return the columns of a joint's channels of one kind, 'rotation' or 'position'."""
        return [k for k, name in zip(self.columns[joint], self.channels[joint], strict=True) if name.endswith(kind)]

    def axes_of(self, joint: int) -> list[int]:
        """Return the axes of a joint's position channels, in their order."""
        return ["XYZ".index(channel[0]) for channel in self.channels[joint] if channel.endswith("position")]

    @property
    def has_number(self) -> np.ndarray:
        """(T, J) bool: all channels of a joint are numbers."""
        number = np.isfinite(self.values)
        return np.stack([number[:, list(columns)].all(axis=1) for columns in self.columns], axis=1)

    @cached_property
    def mended(self) -> Self:
        """The file with missing numbers interpolated linearly between their neighbours.

        A channel without any number is zero, or for a position the joint's offset.
        """
        values, missing = self.values.copy(), ~np.isfinite(self.values)
        if not missing.any():
            return self
        rest = np.zeros(values.shape[1])
        for joint, offset in enumerate(self.offset):
            rest[self.columns_of(joint, "position")] = offset[self.axes_of(joint)]
        for column in np.flatnonzero(missing.any(axis=0)).tolist():
            known = np.flatnonzero(~missing[:, column])
            there = np.interp(np.arange(len(values)), known, values[known, column]) if known.size else rest[column]
            values[:, column] = there
        return self.with_values(values, missing)

    @cached_property
    def rotation(self) -> np.ndarray:
        """(T, J, 4) local rotations of the mended file."""
        return self._converted(slice(None), range(len(self.joints)))

    def rotation_in(self, frames: slice | np.ndarray, joints: Sequence[int] | None = None) -> np.ndarray:
        """Return the local rotations (N, J, 4) of the mended file in some frames, of all joints or the given ones."""
        chosen = range(len(self.joints)) if joints is None else joints
        if len(self.values) <= LONG:
            return np.array(self.rotation[frames][:, list(chosen)])
        return self._converted(frames, chosen)

    def _converted(self, frames: slice | np.ndarray, chosen: Sequence[int]) -> np.ndarray:
        values = self.mended.values[frames]
        rotation = np.zeros((len(values), len(chosen), 4))
        rotation[..., 0] = 1
        for order in {self.order[joint] for joint in chosen} - {""}:
            places = [place for place, joint in enumerate(chosen) if self.order[joint] == order]
            columns = [self.columns_of(chosen[place], "rotation") for place in places]
            for start in range(0, len(values), _BLOCK):  # in blocks that stay in the processor's cache
                block = slice(start, start + _BLOCK)
                angles = np.deg2rad(values[block][:, columns])
                rotation[block][:, places] = quaternion_canonical(euler_to_quaternion(angles, order))
        return rotation

    def place(self, joint: int) -> np.ndarray:
        """Return a joint's position channels (T, 3) of the mended file; its offset along axes without a channel."""
        place = np.tile(self.offset[joint], (len(self.values), 1))
        place[:, self.axes_of(joint)] = self.mended.values[:, self.columns_of(joint, "position")]
        return place

    def without_places(self, gone: np.ndarray) -> Self:
        """Return the file without the positions of joints where `gone` (T, J)."""
        values = self.values.copy()
        for joint in np.flatnonzero(gone.any(axis=0)).tolist():
            for column in self.columns_of(joint, "position"):
                values[gone[:, joint], column] = np.nan
        return replace(self, values=values)

    def with_rotation(self, rotation: Mapping[int, np.ndarray], changed: np.ndarray) -> Self:
        """Return the file with other local rotations (T, 4) of joints, by index, where `changed` (T, J).

        Angles are those nearest to the frame before. A joint with one or two axes gets the nearest possible rotation.
        """
        values, columns_changed = self.values.copy(), np.zeros(self.values.shape, dtype=bool)
        for joint in np.flatnonzero(changed.any(axis=0)).tolist():
            order, columns, frames = self.order[joint], self.columns_of(joint, "rotation"), changed[:, joint]
            if not order:
                continue
            turns = rotation[joint]
            if len(order) == 1:
                turns = swing_twist(turns, np.eye(3)["XYZ".index(order)])[1]
            for first, end in runs(frames):
                before = np.deg2rad(self.mended.values[first - 1, columns]) if first else np.zeros(len(order))
                values[first:end, columns] = np.rad2deg(euler_near(turns[first:end], order, before))
            columns_changed[:, columns] = frames[:, None]
        return self.with_values(values, columns_changed)

    def check_finite(self, values: np.ndarray) -> None:
        """Raise BodysenseError for numbers to be written that are not finite."""
        if not np.isfinite(values).all():
            raise BodysenseError(f"{self.path}: numbers to be written are not finite")


def euler_near(rotation: np.ndarray, order: str, before: np.ndarray) -> np.ndarray:
    """Return angles (T, n) of rotations (T, 4), each nearest to the frame before, the first to `before` (n,); radians.

    A rotation has two triples of angles, and an angle may have whole turns added; the choice moves least. For fewer
    than three axes, the angles about the others are dropped.
    """
    one = quaternion_to_euler(rotation, order + "".join(axis for axis in "XYZ" if axis not in order))
    other = np.array([1, -1, 1]) * one + np.pi
    start = np.pad(before, (0, 3 - len(order)))[None]
    last = np.concatenate([start, one[:-1]])
    path, other_path = (np.abs((way - last + np.pi) % (2 * np.pi) - np.pi).sum(axis=1) for way in (one, other))
    is_other = np.cumsum(other_path < path) % 2 == 1  # they change from one triple to the other
    angles = np.where(is_other[:, None], other, one)
    return np.unwrap(np.concatenate([start, angles]), axis=0)[1:, : len(order)]
