"""The layout of a body's markers: what is constant for a person and a system, and points of any frames by it.

A take's layout is learned from all its frames (`body.body_of`), a live stream's from its first seconds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_multiply
from bodysense.io.markers.centres import (
    Lengths,
    Places,
    axes_of,
    centre_of,
    is_on_other_side,
    lengths_of,
    turns_of,
)
from bodysense.io.markers.marker_sets import MarkerSet
from bodysense.io.markers.raw_markers import FileWorld
from bodysense.observing.observation import Observation

_SMALLEST = 0.5  # of an adult's size, below which the accuracy of a joint improves no further


@dataclass(frozen=True, eq=False)
class MarkerLayout:
    """How the points of a body follow from the markers of a frame. It has no state, so frames may come in any order."""

    markers: MarkerSet
    columns: Mapping[str, int]  # labels in use → index among the markers of a frame
    size: float  # factor of an adult's
    lengths: Mapping[str, Lengths]  # m, of the recipe of each point
    mirrored: Collection[int]  # indices of segments whose markers are on the other side
    accuracy: Mapping[str, float]  # m, of the points that are observed
    world: FileWorld
    turn: np.ndarray | None = None  # (4,) wxyz, our axes ← the file's, if the rotations of bones are used

    @property
    def is_on_skin(self) -> bool:
        """Whether the markers are on the skin, so that joints follow by more than means, not joints or bodies."""
        return self.turn is None and any(recipe.how != "mean" for recipe in self.markers.points)

    def observe(self, position: np.ndarray, rotation: np.ndarray | None, time: np.ndarray) -> Observation:
        """Return the points of frames.

        Args:
            position: (T, M, 3) of all markers, in the stream's unit and axes; NaN where hidden.
            rotation: (T, M, 4) wxyz of rigid bodies and bones, or None.
            time: (T,) s.
        """
        ours = self.world.to_ours(position[:, list(self.columns.values())])
        places: Places = {name: ours[:, k] for k, name in enumerate(self.columns)}
        with np.errstate(invalid="ignore", divide="ignore"):
            segments = segment_axes(self.markers, places, self.mirrored)
            add_centres(self.markers, places, segments.axes, self.size, self.lengths)
            turned: dict[str, np.ndarray] = {}
            if self.turn is not None and rotation is not None:
                turned = bone_rotations(self.markers, self.columns, rotation, self.turn)
            segments = segment_axes(self.markers, places, self.mirrored, segments)
            turned |= segment_rotations(self.markers, segments.axes, turned)
        return observed_points(time, places, turned, self.accuracy)


class Segments(NamedTuple):
    """Axes of segments in some frames."""

    axes: dict[str, np.ndarray]  # (T, 3, 3) by name
    recipe: dict[str, int]  # index of the recipe of each
    mirrored: frozenset[int]  # recipes whose markers are on the other side


def segment_axes(
    markers: MarkerSet, places: Places, mirrored: Collection[int] | None = None, before: Segments | None = None
) -> Segments:
    """Return the axes of every segment whose markers are present, by the first recipe that applies.

    Args:
        markers: the set.
        places: (T, 3) m of markers and points.
        mirrored: recipes whose markers are on the other side; found from these frames if omitted.
        before: axes of the same frames with fewer points, which are kept where the recipe is the same.
    """
    axes, recipe = dict[str, np.ndarray](), dict[str, int]()
    found: set[int] = set() if mirrored is None else set(mirrored)
    for k, frame in enumerate(markers.frames):
        needed = [name for _, start, end in frame.axes for name in (*start, *end)]
        if frame.name in axes or not all(name in places for name in needed):
            continue
        recipe[frame.name] = k
        if before is not None and before.recipe.get(frame.name) == k:
            axes[frame.name] = before.axes[frame.name]
            continue
        if mirrored is None and is_on_other_side(frame, places, axes):
            found.add(k)
        axes[frame.name] = axes_of(frame, places, k in found)
    return Segments(axes, recipe, frozenset(found))


def add_centres(
    markers: MarkerSet,
    places: Places,
    axes: Mapping[str, np.ndarray],
    size: float,
    lengths: Mapping[str, Lengths] | None = None,
) -> tuple[dict[str, float], dict[str, Lengths]]:
    """Add the points that follow from the markers to `places`. Return their accuracy and lengths, m.

    `axes` are those of segments (`segment_axes`); `lengths` are found from these frames if omitted.
    """
    accuracy, found = dict[str, float](), dict[str, Lengths]()
    for recipe in markers.points:
        has_axes = recipe.how == "hinge" or all(name in axes for name in recipe.frames)  # a hinge needs no segment
        if recipe.name in accuracy or not has_axes or not all(name in places for name in recipe.markers):
            continue
        found[recipe.name] = lengths_of(recipe, places) if lengths is None else lengths[recipe.name]
        places[recipe.name] = centre_of(recipe, places, axes, size, found[recipe.name])
        accuracy[recipe.name] = recipe.accuracy * max(size, _SMALLEST)
    return accuracy, found


def bone_rotations(
    markers: MarkerSet, columns: Mapping[str, int], rotation: np.ndarray, turn: np.ndarray
) -> dict[str, np.ndarray]:
    """Return rotations (T, 4) of the joints of bones, from those (T, M, 4) of a file; `turn`: our axes ← its own."""
    back = turn * np.array([1.0, -1.0, -1.0, -1.0])
    return {
        joint: quaternion_multiply(quaternion_multiply(turn, rotation[:, columns[bone]]), back)
        for bone, joint in markers.bones.items()
        if bone in columns
    }


def segment_rotations(
    markers: MarkerSet, axes: Mapping[str, np.ndarray], known: Collection[str]
) -> dict[str, np.ndarray]:
    """Return rotations (T, 4) of the joints of segments, by their axes, except for joints with a known rotation."""
    found: dict[str, np.ndarray] = {}
    for frame in markers.frames:
        if frame.joint is not None and frame.name in axes and frame.joint not in (*known, *found):
            found[frame.joint] = axes[frame.name]
    return dict(zip(found, turns_of(np.stack([*found.values()])), strict=True)) if found else {}


def observed_points(
    time: np.ndarray, places: Places, rotations: Mapping[str, np.ndarray], accuracy: Mapping[str, float]
) -> Observation:
    """Return the points of frames at `time` (T,) s, in the order of the skeleton."""
    points = tuple(name for name in default_skeleton().points if name in accuracy or name in rotations)
    frames = len(time)
    position, rotation = np.full((frames, len(points), 3), np.nan), np.full((frames, len(points), 4), np.nan)
    for k, name in enumerate(points):
        if name in accuracy:
            position[:, k] = places[name]
        if name in rotations:
            rotation[:, k] = rotations[name]
    seen, turned = (np.asarray(np.isfinite(values).all(axis=-1)) for values in (position, rotation))
    position[~seen], rotation[~turned] = np.nan, np.nan
    error = np.array([accuracy.get(name, 1.0) for name in points])
    return Observation(points, position, rotation, seen, turned, np.broadcast_to(error, seen.shape).copy(), time)
