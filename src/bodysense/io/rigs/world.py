"""Units, upward axis and floor of a body's world, from what gravity and a person's size leave in its motion."""

from __future__ import annotations

import numpy as np

from bodysense.body.rotation import quaternion_rotate
from bodysense.io.rigs.limbs import Tree
from bodysense.io.rigs.options import UpAxis

PERSON = (1.3, 2.3)  # m: how tall a person is
CHILD = 0.9  # m: in metres, centimetres or millimetres a smaller person is believed, too
USUAL_HEIGHT = 1.70  # m: of a body whose unit is none of the known ones
FLOOR_TOLERANCE = 0.10  # m: soles so near to zero are on the floor
KNOWN_UNITS = {
    "metres": 1.0,
    "centimetres": 0.01,
    "millimetres": 0.001,
    "inches": 0.0254,
    "units of 0.056444 m": 0.056444,
}
CMU_TENTH = ("units of 0.0056444 m", 0.0056444)

_LEG_AND_TRUNK = 0.763  # of a standing adult's height: hip to ankle and hips to shoulders (the default body's)
_SOLE = {"ankle": 0.08, "foot": 0.02, "toe": 0.0}  # of a leg's length: how far the sole lies below each
_EXTENDED = 0.8  # of legs and trunk stretched out: a body so long stands or lies
_UPRIGHT, _CLEAR = 0.5, 0.7  # mean cosine between a body and an axis: enough to keep y, enough to take another

_HALF = float(np.sqrt(0.5))
TURNS: dict[str, np.ndarray] = {  # world ← file
    "y": np.array([1.0, 0.0, 0.0, 0.0]),
    "z": np.array([_HALF, -_HALF, 0.0, 0.0]),  # -90° about X
    "-z": np.array([_HALF, _HALF, 0.0, 0.0]),
    "-y": np.array([0.0, 1.0, 0.0, 0.0]),  # 180° about X
    "x": np.array([_HALF, 0.0, 0.0, _HALF]),
    "-x": np.array([_HALF, 0.0, 0.0, -_HALF]),
}
_AXES: dict[UpAxis, np.ndarray] = {
    "y": np.array([0.0, 1, 0]), "z": np.array([0.0, 0, 1]), "x": np.array([1.0, 0, 0]),
    "-y": np.array([0.0, -1, 0]), "-z": np.array([0.0, 0, -1]), "-x": np.array([-1.0, 0, 0]),
}  # fmt: skip


def stature(tree: Tree, points: dict[str, int]) -> float:
    """Height of a body, sole to crown, in file units, from the lengths of its legs and trunk."""
    legs = [
        tree.distance(points[f"{side}_{a}"], points[f"{side}_{b}"])
        for side in ("left", "right")
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    ]
    trunk = np.median(np.linalg.norm(middle(tree, points, "shoulder") - middle(tree, points, "hip"), axis=-1))
    return float((sum(legs) / 2 + trunk) / _LEG_AND_TRUNK)


def middle(tree: Tree, points: dict[str, int], part: str) -> np.ndarray:
    """(S, 3) between left and right."""
    return (tree.place[:, points[f"left_{part}"]] + tree.place[:, points[f"right_{part}"]]) / 2


def find_unit(height: float, is_cmu: bool) -> tuple[str, float]:
    """Name and metres of the unit in which a body measures `height`."""
    low, high = PERSON
    for name, metres in [*KNOWN_UNITS.items(), *([CMU_TENTH] if is_cmu else [])]:
        if low <= height * metres <= high:
            return name, metres
    for name in ("metres", "centimetres", "millimetres"):
        if CHILD <= height * KNOWN_UNITS[name] < low:
            return name, KNOWN_UNITS[name]
    return "", USUAL_HEIGHT / height


def find_up(tree: Tree, points: dict[str, int]) -> tuple[UpAxis, float]:
    """The axis along which the body stands, and the mean cosine between both; y where it stands along none."""
    shoulders, hips, ankles = (middle(tree, points, part) for part in ("shoulder", "hip", "ankle"))
    trunk, whole = shoulders - hips, shoulders - ankles
    full = np.median(np.linalg.norm(trunk, axis=-1)) + 0.85 * stature(tree, points) * _LEG_AND_TRUNK * 0.65
    extended = np.linalg.norm(whole, axis=-1) > _EXTENDED * full
    ways = whole[extended] if extended.any() else trunk + whole
    ways = ways / np.maximum(np.linalg.norm(ways, axis=-1, keepdims=True), 1e-9)
    score: dict[UpAxis, float] = {axis: float((ways @ way).mean()) for axis, way in _AXES.items()}
    best = max(score, key=lambda axis: score[axis])
    if score["y"] >= _UPRIGHT or score[best] < _CLEAR:
        return "y", score["y"]
    return best, score[best]


def find_floor(tree: Tree, points: dict[str, int], up: UpAxis, leg: float) -> float:
    """Height of the soles along the upward axis when they are lowest, file units."""
    below = [
        (points[f"{side}_{part}"], share)
        for side in ("left", "right")
        for part, share in _SOLE.items()
        if f"{side}_{part}" in points
    ]
    heights = [quaternion_rotate(TURNS[up], tree.place[:, k])[:, 1] - share * leg for k, share in below]
    return float(np.percentile(np.min(heights, axis=0), 5))
