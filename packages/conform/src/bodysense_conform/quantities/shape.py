"""Shape: lengths of bones and proportions."""

from __future__ import annotations

import numpy as np

from bodysense.body.shape import Measured, shape_space
from bodysense.body.skeleton import default_skeleton
from bodysense_conform.series import NotEnough, Series, series, stacked
from bodysense_conform.subject import Subject, is_finger

SIDES = ("left", "right")
CORE = tuple(
    (f"{side}_{a}", f"{side}_{b}")
    for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
    for side in SIDES
)
_ACROSS = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), ("neck", "head"), ("pelvis", "neck"))
_TRUSTED = 0.02  # m; deviation of a measured length when the nearest body is searched
_USUAL = 1.406  # m; ankle to head along the bones of the default skeleton, the size at which bodies are compared


def height(subject: Subject) -> Series:
    """Length from ankle to head along the bones, m."""
    if not np.isfinite(subject.height):
        raise NotEnough("no chain of bones from ankle to head")
    return series(subject.height)


def bone_length(subject: Subject) -> Series:
    """Length of each bone, m; without fingers and the ends of feet and head."""
    return _bones(subject, fingers=False)


def bone_flicker(subject: Subject) -> Series:
    """Departure of each bone's length from the mean of the frames before and after, % of its median."""
    bones = _bones(subject, fingers=False)
    if len(subject) < 3:
        raise NotEnough("fewer than three frames")
    flicker = np.full_like(bones.values, np.nan)
    flicker[1:-1] = np.abs(bones.values[1:-1] - (bones.values[2:] + bones.values[:-2]) / 2)
    return Series(100 * flicker / np.nanmedian(bones.values, axis=0), bones.names)


def finger_length(subject: Subject) -> Series:
    """Length of each bone of the fingers, m."""
    return _bones(subject, fingers=True)


def _bones(subject: Subject, fingers: bool) -> Series:
    columns = {}
    for parent, child in subject.bones:
        length = subject.length(parent, child)
        end = child.endswith(("_toe", "_foot", "head_top"))
        if is_finger(child) == fingers and not end and np.nanmedian(length) > 0.02 / (1 + fingers):
            columns[f"{parent}, {child}"] = length
    return stacked(columns, "no finger" if fingers else "no bones")


def asymmetry(subject: Subject) -> Series:
    """Difference between the bones of both sides, % of their mean."""
    columns = {}
    for (a, b), (c, d) in zip(CORE[::2], CORE[1::2], strict=True):
        if subject.has(a, b, c, d):
            left, right = np.nanmedian(subject.length(a, b)), np.nanmedian(subject.length(c, d))
            columns[f"{a}, {b}"] = np.array([200 * abs(left - right) / max(left + right, 1e-9)])
    return stacked(columns, "no bone on both sides")


def distance(subject: Subject) -> Series:
    """Difference of each length from the likeliest human body's, cm at the default size."""
    size = _USUAL / subject.height
    lengths = {
        (a, b): size * float(np.nanmedian(subject.length(a, b))) for a, b in (*CORE, *_ACROSS) if subject.has(a, b)
    }
    if len(lengths) < 6 or not np.isfinite(list(lengths.values())).all():
        raise NotEnough("fewer than six bones")
    body = shape_space().likeliest({pair: Measured(max(v, 1e-3), _TRUSTED) for pair, v in lengths.items()}).skeleton
    rest = body.path @ body.rest_offset
    ours = default_skeleton()
    return stacked(
        {
            f"{a}, {b}": np.array([100 * abs(length - np.linalg.norm(rest[ours.index(a)] - rest[ours.index(b)]))])
            for (a, b), length in lengths.items()
        },
        "no bones",
    )


def unit(vector: np.ndarray) -> np.ndarray:
    """Return vectors (..., n) of length one; zero stays zero."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def angle(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return degrees (...) between vectors (..., 3)."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), (u * v).sum(axis=-1)))
