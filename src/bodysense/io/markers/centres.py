"""Joint centres from markers on the skin: regressions of the literature, offsets in a segment's frame, hinges.

Sources: hips by Harrington et al. 2007 (Journal of Biomechanics 40, 595-602), from the width and the depth of the
pelvis; shoulders by Rab et al. 2002 (Gait & Posture 15, 113-119), below the acromion by 17 % of the way between both.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from bodysense.geometry.products import cross
from bodysense.geometry.rotation import matrix_to_quaternion, quaternion_exp, quaternion_to_matrix
from bodysense.io.markers.marker_sets import Recipe, SegmentFrame

AXES = ("left", "up", "forward")  # of a body that faces +Z: X, Y, Z
SHOULDER_DROP = 0.17  # of the distance between both acromia
STRAIGHT, BENT = np.deg2rad(20.0), np.deg2rad(50.0)  # of a hinge: below STRAIGHT, the marker's direction gives its axis

Places = dict[str, np.ndarray]  # (T, 3) m of every marker and point, NaN where hidden
Axes = Sequence[np.ndarray]  # (T, 3, 3) of the segments that a recipe names, columns left, up, forward
Directions = tuple[tuple[str, tuple[str, ...], tuple[str, ...]], ...]  # `SegmentFrame.axes`
Lengths = tuple[float, ...]  # m, constant lengths of a person that a recipe needs (`lengths_of`)


def axes_of(frame: SegmentFrame, places: Mapping[str, np.ndarray], mirrored: bool = False) -> np.ndarray:
    """Return axes (T, 3, 3) of a segment, columns left, up, forward of a standing body; NaN if hidden.

    `mirrored`: its markers are on the other side of the body (`is_on_other_side`).
    """
    is_right = frame.name.startswith("right_")
    if frame.standing:
        standing = _standing_axes(frame.axes, is_right, tuple(frame.standing.items()), mirrored)
    else:
        standing = _tilt(frame.pitch, -frame.lift if is_right else frame.lift)
    return _axes(frame.axes, is_right, places) @ standing


@lru_cache(maxsize=256)
def _tilt(pitch: float, lift: float) -> np.ndarray:
    """Return (3, 3): the axes of a standing body ← those of a segment, which differ by degrees."""
    return quaternion_to_matrix(quaternion_exp(np.deg2rad([pitch, 0.0, lift]))).T


@lru_cache(maxsize=256)
def _standing_axes(
    axes: Directions, is_right: bool, standing: tuple[tuple[str, tuple[float, float, float]], ...], mirrored: bool
) -> np.ndarray:
    """Return the same (3, 3) by the usual positions of a segment's markers on a standing body."""
    side = np.array([-1.0 if mirrored else 1.0, 1.0, 1.0])
    return _axes(axes, is_right, {name: side * np.array(place) for name, place in standing}).T


def is_on_other_side(frame: SegmentFrame, places: Mapping[str, np.ndarray], frames: Mapping[str, np.ndarray]) -> bool:
    """Return whether the markers of a segment that may be on either side are on the right, in most frames."""
    if not frame.standing or frame.either_side_of is None or frame.either_side_of not in frames:
        return False
    # How far (T,) m a marker of either side is left of the others, by the axes of another segment.
    _, start, end = next(row for row in frame.axes if row[0] == "left")
    left = ((_mean(places, end) - _mean(places, start)) * frames[frame.either_side_of][..., 0]).sum(axis=-1)
    return bool(np.nanmedian(np.r_[left, 0.0]) < 0)


def _axes(rows: Directions, is_right: bool, places: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return axes (..., 3, 3) from two directions between markers: the first is kept."""
    directions: list[tuple[int, np.ndarray]] = []
    for axis, start, end in rows:
        way = _mean(places, end) - _mean(places, start)
        if axis == "out" and is_right:
            way = -way
        directions.append((AXES.index("left" if axis == "out" else axis), way))
    (first, kept), (second, other) = directions
    third = 3 - first - second
    sign = 1.0 if (first + 1) % 3 == second else -1.0
    axes = np.empty((*kept.shape[:-1], 3, 3))
    axes[..., first] = _unit(kept)
    axes[..., third] = _unit(sign * cross(kept, other))
    axes[..., second] = sign * cross(axes[..., third], axes[..., first])
    return axes


def turns_of(axes: np.ndarray) -> np.ndarray:
    """Convert axes (..., 3, 3) to rotations (..., 4) wxyz; NaN where hidden."""
    known = np.isfinite(axes).all(axis=(-2, -1))
    rotation = np.full((*axes.shape[:-2], 4), np.nan)
    rotation[known] = matrix_to_quaternion(axes[known])
    return rotation


def centre_of(
    recipe: Recipe,
    places: Mapping[str, np.ndarray],
    frames: Mapping[str, np.ndarray],
    size: float,
    lengths: Lengths,
) -> np.ndarray:
    """Return positions (T, 3) m of a point.

    Args:
        recipe: how the point follows from markers.
        places: (T, 3) m of markers and earlier points.
        frames: axes of segments.
        size: factor of an adult's.
        lengths: of the recipe, m (`lengths_of`).
    """
    axes = [frames[name] for name in recipe.frames if name in frames]
    return CENTRES[recipe.how](recipe, [places[name] for name in recipe.markers], axes, size, lengths)


def lengths_of(recipe: Recipe, places: Mapping[str, np.ndarray]) -> Lengths:
    """Return the constant lengths (m) that a recipe needs: of a hip the pelvis's width and depth, of a shoulder the
    distance between both; medians of all frames.
    """
    at = [places[name] for name in recipe.markers]
    if recipe.how == "hip":
        front, behind = (at[0] + at[1]) / 2, np.mean(at[2:], axis=0)
        return _median_length(at[0] - at[1]), _median_length(front - behind)
    return (_median_length(at[0] - at[1]),) if recipe.how == "shoulder" else ()


def _mean_centre(recipe: Recipe, at: Sequence[np.ndarray], axes: Axes, size: float, lengths: Lengths) -> np.ndarray:
    """Return the mean of markers plus an offset."""
    centre = np.mean(at, axis=0)
    return centre if not axes else centre + _offset_in_world(axes[0], size * np.array(recipe.offset), recipe.side)


def _hip(recipe: Recipe, at: Sequence[np.ndarray], axes: Axes, size: float, lengths: Lengths) -> np.ndarray:
    """Return the hip centre by Harrington et al. 2007, from the front and back spines of the pelvis (or the sacrum)."""
    own, other, *behind = at
    front = (own + other) / 2
    width, depth = lengths
    offset = np.array([0.33 * width + 0.0073, -0.30 * width - 0.0109, -0.24 * depth - 0.0099])
    # The paper's axes are the pelvis's own: its forward axis runs from the spines behind to those in front.
    left = axes[0][..., 0]
    ahead = front - np.mean(behind, axis=0)
    ahead = _unit(ahead - left * (ahead * left).sum(axis=-1, keepdims=True))
    return front + _offset_in_world(np.stack([left, cross(ahead, left), ahead], axis=-1), offset, recipe.side)


def _shoulder(recipe: Recipe, at: Sequence[np.ndarray], axes: Axes, size: float, lengths: Lengths) -> np.ndarray:
    """Return the shoulder centre by Rab et al. 2002: below the acromion, along the trunk."""
    return at[0] - SHOULDER_DROP * lengths[0] * axes[0][..., 1]


def _hinge(recipe: Recipe, at: Sequence[np.ndarray], axes: Axes, size: float, lengths: Lengths) -> np.ndarray:
    """Return the centre of a knee or an elbow, from the marker on its outer side along the axis of bending.

    If the joint is bent, that axis is perpendicular to both bones. If it is straight, the axis is the outward one of
    the neighbouring segments, or without these the direction of the marker from the bones.
    """
    skin, above, below = at
    outward = recipe.side * (1.0 if recipe.bends == "forward" else -1.0)
    along = _unit(below - above)
    beside = recipe.side * sum(one[..., 0] for one in axes) if axes else skin - above
    straight = _unit(beside - along * np.vecdot(beside, along)[..., None])
    centre = skin
    for _ in range(3):
        square = outward * _unit(cross(above - centre, below - centre))
        bent = np.arccos(np.clip(np.vecdot(_unit(centre - above), _unit(below - centre)), -1, 1))
        share = np.clip((bent - STRAIGHT) / (BENT - STRAIGHT), 0, 1)[:, None]
        centre = skin - size * recipe.depth * _unit(share * square + (1 - share) * straight)
    return centre


CENTRES: dict[str, Callable[[Recipe, Sequence[np.ndarray], Axes, float, Lengths], np.ndarray]] = {
    "mean": _mean_centre,
    "hip": _hip,
    "shoulder": _shoulder,
    "hinge": _hinge,
}


def _offset_in_world(axes: np.ndarray, offset: np.ndarray, side: float) -> np.ndarray:
    """Return an offset (out, up, forward) of a side in world axes."""
    return axes @ (offset * np.array([side, 1.0, 1.0]))


def _median_length(apart: np.ndarray) -> float:
    """Return the median length of vectors (T, 3) between two points of one segment; NaN if never seen."""
    length = np.linalg.norm(apart, axis=-1)
    known = length[np.isfinite(length)]
    return float(np.median(known)) if known.size else float("nan")


def _mean(places: Mapping[str, np.ndarray], names: Sequence[str]) -> np.ndarray:
    if len(names) == 1:
        return places[names[0]]
    total = places[names[0]] + places[names[1]]
    for name in names[2:]:
        total = total + places[name]
    return total / len(names)


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.sqrt(np.vecdot(vector, vector))[..., None]
