"""Clip: a recorded motion, a Pose over time with its metadata."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import Pose

# Large parts of a body that a recording may lack, and their joints without sides; the first must be there.
PARTS = {
    "head": ("head", "neck"),
    "legs": ("hip", "knee", "ankle", "foot"),
    "arms": ("shoulder", "elbow", "wrist", "collar"),
}


@dataclass(frozen=True, eq=False)
class Clip:
    """One recording of one person."""

    name: str
    pose: Pose  # (T, …) NumPy float64, world +Y up, metres
    frame_rate: float  # Hz
    person: str = ""  # name of the performer; splits are by person
    category: str = ""  # activity, if the data set names it
    has_fingers: bool = True  # False: not recorded, filled in with a relaxed hand
    lacks: tuple[str, ...] = ()  # parts of `PARTS` that were not recorded: their legs and arms keep still
    warnings: tuple[str, ...] = ()  # doubts about the file that it was read from, with the option that settles each

    def __repr__(self) -> str:
        lacks = f", without {' and '.join(self.lacks)}" if self.lacks else ""
        return f"Clip({self.name!r}, {len(self)} frames at {self.frame_rate:g} Hz, {self.seconds:.1f} s{lacks})"

    def __len__(self) -> int:
        return int(self.pose.root_position.shape[0])

    @property
    def seconds(self) -> float:
        """Length of the recording in seconds."""
        return len(self) / self.frame_rate

    @property
    def time(self) -> np.ndarray:
        """(T,) s, from 0."""
        return np.arange(len(self)) / self.frame_rate


def at_height(clip: Clip, height: float) -> Clip:
    """Scale the body to `height` m at unchanged proportions and rotations; the root's path is scaled with it."""
    skeleton = clip.pose.skeleton.scaled(height)
    root = clip.pose.root_position * (skeleton.extent / clip.pose.skeleton.extent)
    return replace(clip, pose=Pose(skeleton, root, clip.pose.rotation))


def parts_lacking(joints: Collection[str]) -> tuple[str, ...]:
    """Return the names of `PARTS` whose joints are missing among `joints` of the default skeleton."""
    known = {name.rpartition("_")[2] for name in joints}
    return tuple(part for part, (first, *_) in PARTS.items() if first not in known)


def part_joints(parts: Collection[str], joints: Collection[str]) -> list[str]:
    """Return the joints of the default skeleton that belong to some of `PARTS`."""
    own = {name for part in parts for name in PARTS[part]}
    return [name for name in joints if name.rpartition("_")[2] in own]
