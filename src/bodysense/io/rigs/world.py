"""Units, upward axis and floor of a body's world, inferred from gravity and a person's size."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from bodysense.body.rotation import quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.body.world_axes import TURNS, UpAxis
from bodysense.io.rigs.figure import Tree

Places = Mapping[str, np.ndarray]  # (S, 3) of points of ours, by name

PERSON = (1.3, 2.3)  # m: height of a person
CHILD = 0.9  # m: height of a smaller person, allowed in metres, centimetres or millimetres
USUAL_HEIGHT = 1.70  # m: height given to a body of unknown unit
FLOOR_TOLERANCE = 0.10  # m: soles this close to zero are on the floor
KNOWN_UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "units of 0.056444 m": 0.056444,
}
CMU_TENTH = ("units of 0.0056444 m", 0.0056444)

_LEG = 0.496  # of a standing adult's height: hip to ankle
_PELVIS = (0.15, 0.62)  # of a person's height: range of the pelvis's height while sitting or standing
_SOLE = {"ankle": 0.08, "foot": 0.02, "toe": 0.0}  # of a leg's length: height of each joint above the sole
_EXTENDED = 0.8  # of legs and trunk stretched out: a body this long stands or lies
_UPRIGHT, _CLEAR = 0.5, 0.7  # mean cosine between a body and an axis: enough to keep y, enough to take another

_AXES: dict[UpAxis, np.ndarray] = {
    "y": np.array([0.0, 1, 0]), "z": np.array([0.0, 0, 1]), "x": np.array([1.0, 0, 0]),
    "-y": np.array([0.0, -1, 0]), "-z": np.array([0.0, 0, -1]), "-x": np.array([-1.0, 0, 0]),
}  # fmt: skip


def stature(tree: Tree, points: dict[str, int]) -> float:
    """Return the height of a body, sole to crown, in file units, from its legs and trunk, or arms and trunk."""
    body = default_skeleton()
    rest = body.path @ body.rest_offset
    usual = {name: rest[None, body.index(name)] for name in points if name in body.points}
    found = {name: tree.place[:, point] for name, point in points.items()}
    return body.height * _extent(found) / _extent(usual)


def _extent(place: Places) -> float:
    """Return the length of a leg and the trunk, or without legs of an arm and the trunk."""
    limb = ("hip", "knee", "ankle") if "left_hip" in place else ("shoulder", "elbow", "wrist")
    bones = [
        float(np.median(np.linalg.norm(place[f"{side}_{a}"] - place[f"{side}_{b}"], axis=-1)))
        for side in ("left", "right")
        for a, b in pairwise(limb)
    ]
    return sum(bones) / 2 + float(np.median(np.linalg.norm(_upper(place) - _lower(place), axis=-1)))


def _upper(place: Places) -> np.ndarray:
    """Return the midpoint (S, 3) of the shoulders, or the pelvis of a body without shoulders."""
    return _between(place, "shoulder") if "left_shoulder" in place else place["pelvis"]


def _lower(place: Places) -> np.ndarray:
    """Return the midpoint (S, 3) of the hips, or the pelvis of a body without hips."""
    return _between(place, "hip") if "left_hip" in place else place["pelvis"]


def _between(place: Places, part: str) -> np.ndarray:
    """Return the midpoint (S, 3) of left and right."""
    return (place[f"left_{part}"] + place[f"right_{part}"]) / 2


def find_unit(height: float, is_cmu: bool) -> tuple[str, float]:
    """Return name and metres of the unit in which a body measures `height`."""
    low, high = PERSON
    for name, metres in [*KNOWN_UNITS.items(), *([CMU_TENTH] if is_cmu else [])]:
        if low <= height * metres <= high:
            return name, metres
    for name in ("metres", "centimetres", "millimetres"):
        if CHILD <= height * KNOWN_UNITS[name] < low:
            return name, KNOWN_UNITS[name]
    return "", USUAL_HEIGHT / height


def find_up(tree: Tree, points: dict[str, int]) -> tuple[UpAxis, float]:
    """Return the axis along which the body stands, and the mean cosine between both; y if it stands along no axis."""
    place = {name: tree.place[:, point] for name, point in points.items()}
    trunk = _upper(place) - _lower(place)
    ways = trunk
    if "left_hip" in place:
        whole = _upper(place) - _between(place, "ankle")
        full = np.median(np.linalg.norm(trunk, axis=-1)) + 0.85 * stature(tree, points) * _LEG
        extended = np.linalg.norm(whole, axis=-1) > _EXTENDED * full
        ways = whole[extended] if extended.any() else trunk + whole
    ways = ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)
    score: dict[UpAxis, float] = {axis: float((ways @ way).mean()) for axis, way in _AXES.items()}
    best = max(score, key=lambda axis: score[axis])
    if score["y"] >= _UPRIGHT or score[best] < _CLEAR:
        return "y", score["y"]
    return best, score[best]


def find_floor(tree: Tree, points: dict[str, int], up: UpAxis) -> float:
    """Return the lowest height of the soles along the upward axis, file units.

    Without legs it is 0 if the pelvis is at the height of a standing or sitting one, else inferred from the pelvis.
    """
    if "left_hip" not in points:
        pelvis = float(np.median(quaternion_rotate(TURNS[up], tree.place[:, points["pelvis"]])[:, 1]))
        body, size = default_skeleton(), stature(tree, points)
        low, high = _PELVIS
        return 0.0 if low * size < pelvis < high * size else pelvis - size * body.rest_offset[0, 1] / body.height
    leg = tree.distance(points["left_hip"], points["left_knee"]) + tree.distance(
        points["left_knee"], points["left_ankle"]
    )
    below = [
        (points[f"{side}_{part}"], share)
        for side in ("left", "right")
        for part, share in _SOLE.items()
        if f"{side}_{part}" in points
    ]
    heights = [quaternion_rotate(TURNS[up], tree.place[:, k])[:, 1] - share * leg for k, share in below]
    return float(np.percentile(np.min(heights, axis=0), 5))
