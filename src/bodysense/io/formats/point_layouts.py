"""Layouts of arrays of points: which point of a body each row is, by the names that marker readers know."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from bodysense.body.skeleton import default_skeleton

Layout = Literal["mediapipe", "coco", "h36m", "halpe", "ntu", "smpl", "humanml3d"]
_SIDES = ("left", "right")


def _both(*parts: str) -> tuple[str, ...]:
    return tuple(f"{side}_{part}" for part in parts for side in _SIDES)


_LIMBS = ("shoulder", "elbow", "wrist")
_LEGS = ("hip", "knee", "ankle")
_COCO = ("nose", *_both("eye", "ear", *_LIMBS, *_LEGS))
LAYOUTS: dict[str, tuple[str, ...]] = {
    "mediapipe": (
        "nose",
        *(f"{side}_eye{part}" for side in _SIDES for part in ("_inner", "", "_outer")),
        *_both("ear"),
        "mouth_left",
        "mouth_right",
        *_both(*_LIMBS, "pinky", "index", "thumb", *_LEGS, "heel", "foot_index"),
    ),
    "coco": _COCO,
    # Human3.6M's 17: the pelvis is the middle of the hips, and the 10th point is the nose.
    "h36m": (
        "mid_hip",
        *(f"{side}_{part}" for side in ("right", "left") for part in _LEGS),
        "spine",
        "neck",
        "nose",
        "head_top",
        *(f"{side}_{part}" for side in _SIDES for part in _LIMBS),
    ),
    "halpe": (*_COCO, "head_top", "neck", "mid_hip", *_both("big_toe", "small_toe", "heel")),
    # Kinect's 25, as NTU RGB+D has them.
    "ntu": (
        "spine base",
        "spine mid",
        "neck",
        "head",
        *(f"{side}_{part}" for side in _SIDES for part in (*_LIMBS, "hand")),
        *(f"{side}_{part}" for side in _SIDES for part in (*_LEGS, "foot")),
        "spine shoulder",
        *(f"{side} {part}" for side in _SIDES for part in ("hand tip", "hand thumb")),
    ),
    "smpl": default_skeleton().joints[:22],
}
Y_DOWN = ("mediapipe",)  # layouts of a camera, whose y points down
DOWN = np.diag([1.0, -1.0, -1.0])  # our axes in those


@dataclass(frozen=True, eq=False)
class JointPlaces:
    """Places of a body's points over time."""

    place: np.ndarray  # (T, P, 3), NaN where missing
    names: tuple[str, ...]  # of the points
    rate: float  # Hz
    remarks: tuple[str, ...] = ()
    axes: np.ndarray | None = field(default=None, repr=False)  # our axes (3, 3), rows, in the array's; None: +Y up


def layouts_of(values: np.ndarray) -> list[Layout]:
    """Return the layouts that an array may have by its shape, SMPL's excepted, which bone lengths tell."""
    if values.ndim != 3 or values.shape[2] != 3:
        return []
    return [name for name in get_args(Layout) if name in LAYOUTS and len(LAYOUTS[name]) == values.shape[1] != 22]
