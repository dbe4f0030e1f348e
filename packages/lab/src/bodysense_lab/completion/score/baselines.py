"""Baseline for hidden joints: the mean body of people whose head has a similar height and pitch.

For joints that cameras never saw, it is a better baseline than the last known position, that of a standing body.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.ndimage import convolve1d

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import cache_folder, make_folder, written_beside
from bodysense.geometry.rotation import heading, quaternion_conjugate, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense.io.resample import resample
from bodysense_lab.completion.score.sight.wearers import rest_heights
from bodysense_lab.data.clips import count_clips, open_clips

FORMAT = "bodysense-mean-body-2"
HEIGHTS = np.linspace(0.1, 1.3, 25)  # heights of the head, divided by its height in the rest pose
PITCHES = np.radians(np.linspace(-90, 90, 19))  # radians, downward pitch of the head
_RATE = 5.0  # Hz at which training motion is read
_KERNEL = np.array([0.25, 1.0, 0.25])  # weights of neighbouring cells


@dataclass(frozen=True, eq=False)
class MeanBody:
    """Mean positions of all points relative to the head, by the head's height and pitch."""

    # (H, K, P, 3) relative to the head, in the frame of its heading, divided by its rest height
    place: np.ndarray = field(repr=False)

    def positions(self, position: np.ndarray, rotation: np.ndarray, skeleton: Skeleton) -> np.ndarray:
        """Return world positions (T, P, 3) m of the body under a head at `position` (T, 3) m with `rotation` (T, 4)."""
        rows, weights = _cells(position, rotation, skeleton)
        flat = self.place.reshape(-1, *self.place.shape[2:])
        place = np.einsum("kt,ktpc->tpc", weights, flat[np.stack(rows)])
        turn = heading(rotation)[:, None, :]
        return position[:, None] + _rest_height(skeleton) * np.asarray(quaternion_rotate(turn, place))


def fit_mean_body(clips: Iterable[Clip]) -> MeanBody:
    """Average the bodies of canonical clips. Raises BodysenseError if there are no clips."""
    total, count = np.zeros(0), np.zeros(len(HEIGHTS) * len(PITCHES))
    for clip in (resample(clip, _RATE) for clip in clips):
        skeleton = clip.pose.skeleton
        position, rotation = (np.asarray(part) for part in forward_kinematics(clip.pose))
        head = skeleton.index("head")
        turn = quaternion_conjugate(heading(rotation[:, head]))[:, None, :]
        place = np.asarray(quaternion_rotate(turn, position - position[:, [head]])) / _rest_height(skeleton)
        total = total if total.size else np.zeros((len(count), *place.shape[1:]))
        for row, weight in zip(*_cells(position[:, head], rotation[:, head], skeleton), strict=True):
            np.add.at(total, row, weight[:, None, None] * place)
            np.add.at(count, row, weight)
    if not total.size:
        raise BodysenseError("a mean body needs motion; give at least one clip")
    shape = (len(HEIGHTS), len(PITCHES))
    overall = 1e-3 * total.sum(axis=0) / count.sum()
    total, count = _smooth(total.reshape(*shape, *total.shape[1:])), _smooth(count.reshape(shape))
    return MeanBody((total + overall) / (count + 1e-3)[..., None, None])


def cached_mean_body(data: Path, advance: Callable[[Clip], None] = lambda clip: None) -> MeanBody | None:
    """Return the mean body of the train split of a folder or store, or None if it has no train split.

    The body is cached in the user's cache folder. `advance` is called for every clip that is read.
    """
    count = count_of_split(data, "train")
    if count is None:
        return None
    digest = hashlib.sha256(f"{FORMAT} {data.resolve()} {count}".encode()).hexdigest()[:16]
    path = cache_folder() / f"mean-body-{digest}.npz"
    if path.is_file():
        with np.load(path, allow_pickle=False) as stored:
            return MeanBody(stored["place"])

    def read() -> Iterable[Clip]:
        for clip in open_clips(data, "train"):
            yield clip
            advance(clip)

    body = fit_mean_body(read())
    make_folder(path.parent)
    with written_beside(path) as beside, beside.open("wb") as file:
        np.savez(file, place=body.place)
    return body


def count_of_split(data: Path, split: Split) -> int | None:
    """Return the number of clips of a split of a folder or store, or None if there is no such split."""
    try:
        return count_clips(data, split)
    except BodysenseError:
        return None


def _rest_height(skeleton: Skeleton) -> float:
    """Return the height of the head joint over the floor in the rest pose, m."""
    return float(rest_heights(skeleton)[skeleton.index("head")])


def _cells(
    position: np.ndarray, rotation: np.ndarray, skeleton: Skeleton
) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return flat indices (T,) of the four cells around a head's height and pitch, and their weights (T,)."""
    ahead = np.asarray(quaternion_rotate(rotation, np.broadcast_to([0.0, 0.0, 1.0], position.shape)))
    row, high = _grid_position(HEIGHTS, position[:, 1] / _rest_height(skeleton))
    column, far = _grid_position(PITCHES, -np.arcsin(np.clip(ahead[:, 1], -1, 1)))
    cell = row * len(PITCHES) + column
    weights = ((1 - high) * (1 - far), (1 - high) * far, high * (1 - far), high * far)
    return (cell, cell + 1, cell + len(PITCHES), cell + len(PITCHES) + 1), weights


def _grid_position(grid: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the index of the grid line below each value, and the fraction of the step to the next line."""
    place = np.clip((value - grid[0]) / (grid[1] - grid[0]), 0, len(grid) - 1 - 1e-9)
    return place.astype(int), place - np.floor(place)


def _smooth(table: np.ndarray) -> np.ndarray:
    """Add to each cell of a table its neighbours, with less weight."""
    for axis in (0, 1):
        table = convolve1d(table, _KERNEL, axis, mode="constant")
    return table
