"""Frames of the 22-joint body of many clips in flat arrays, as HMD-VAE is trained and tested on them (section 5.1).

Recordings come to 30 Hz exactly (`io.resample`). One at a whole multiple of it, 60 or 120 Hz, loses frames and no
other changes, as in the paper. One at any other rate is interpolated, rotations by slerp: the paper would thin 100 Hz
to 33.3 Hz and still count 1/30 s between frames, and ours is at 24 and 12 Hz, where nothing can be thinned.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.body_joints import body_pose
from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.data.windows import Windows, find_windows

RATE = 30.0
TRAIN_LENGTH, TEST_LENGTH, STRIDE = 16, 64, 4  # frames
HELD_OUT = 0.05  # share of the sequences of each data set


@dataclass(frozen=True, eq=False)
class BodyFrames:
    """All frames of all clips, one after the other; a row a clip of what belongs to a clip."""

    position: np.ndarray  # (N, 22, 3) float32 m, world
    rotation: np.ndarray  # (N, 22, 4) float32 wxyz, world ← joint
    rest_offset: np.ndarray  # (C, 22, 3) float32 m
    start: np.ndarray  # (C,) first frame
    length: np.ndarray  # (C,) frames
    person: tuple[str, ...]  # (C,)
    category: tuple[str, ...]  # (C,)

    def __len__(self) -> int:
        return len(self.start)

    @property
    def minutes(self) -> float:
        """Length of all clips together."""
        return float(self.length.sum()) / RATE / 60

    def windows(self, length: int, stride: int = STRIDE, clips: np.ndarray | None = None) -> Windows:
        """Return windows of `length` frames in every clip, or in the clips of rows `clips`."""
        chosen = np.arange(len(self)) if clips is None else clips
        found = find_windows(self.start[chosen], self.length[chosen], length=length, stride=stride)
        return replace(found, clip=chosen[found.clip])


def read_body_frames(clips: Iterable[Clip]) -> BodyFrames:
    """Read clips at 30 Hz and drop those shorter than 64 frames. Raises BodysenseError if all are shorter."""
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, str, str]] = []
    for clip in clips:
        # Clips that give fewer than 64 frames need not be computed.
        if clip.seconds * RATE < TEST_LENGTH - 1:
            continue
        body = body_pose(resample(clip, RATE).pose)
        if len(body.root_position) >= TEST_LENGTH:
            position, rotation = (values.astype(np.float32) for values in forward_kinematics(body))
            parts.append((position, rotation, body.skeleton.rest_offset, clip.person, clip.category))
    if not parts:
        raise BodysenseError(f"none of the clips has {TEST_LENGTH} frames at {RATE:g} Hz; give longer recordings")
    position, rotation, rest_offset, person, category = zip(*parts, strict=True)
    length = np.array([len(one) for one in position])
    return BodyFrames(
        position=np.concatenate(position),
        rotation=np.concatenate(rotation),
        rest_offset=np.stack(rest_offset).astype(np.float32),
        start=np.cumsum(length) - length,
        length=length,
        person=tuple(person),
        category=tuple(category),
    )


def held_out(person: Iterable[str], rng: np.random.Generator) -> np.ndarray:
    """(C,) bool: about 5 % of the clips of each data set, at least one; a set is a person's name up to its last '_'.

    'cmu_07' is of 'cmu', 'MPI_HDM05_dg' of 'MPI_HDM05'; a name without '_' is of a set with all others like it.
    This is the within-person test of the paper; the other test is by person.
    """
    names = np.array([name.rpartition("_")[0] for name in person])
    chosen = np.zeros(len(names), dtype=bool)
    for name in np.unique(names):
        rows = np.flatnonzero(names == name)
        if len(rows) > 1:
            chosen[rng.choice(rows, max(1, round(HELD_OUT * len(rows))), replace=False)] = True
    return chosen
