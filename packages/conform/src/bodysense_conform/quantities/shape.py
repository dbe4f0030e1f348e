"""Shape: lengths of bones and proportions."""

from __future__ import annotations

import numpy as np

from bodysense.body.shape import Measured, shape_space
from bodysense_conform.series import Series, later, need
from bodysense_conform.subject import SIDES, USUAL_HEIGHT, Subject, is_finger

CORE = tuple(
    (f"{side}_{a}", f"{side}_{b}")
    for a, b in (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
    for side in SIDES
)
_ACROSS = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), ("neck", "head"), ("pelvis", "neck"))
_TRUSTED = 0.02  # m; deviation of a measured length when the nearest body is searched


def height(subject: Subject) -> Series:
    """Length from ankle to head along the bones, m."""
    need(np.isfinite(subject.height), "no chain of bones from ankle to head")
    return subject.height


def bone_length(subject: Subject) -> dict[str, np.ndarray]:
    """Length of each bone, m; without fingers and the ends of feet and head."""
    return need(_bones(subject, fingers=False), "no bones")


def bone_flicker(subject: Subject) -> Series:
    """Departure of each bone's length from the mean of the frames before and after, % of its median."""
    bones = bone_length(subject)
    need(len(subject) >= 3, "fewer than three frames")
    middle = {bone: (later(length, 1) + later(length, -1)) / 2 for bone, length in bones.items()}
    return {bone: 100 * np.abs(length - middle[bone]) / np.nanmedian(length) for bone, length in bones.items()}


def finger_length(subject: Subject) -> Series:
    """Length of each bone of the fingers, m."""
    return need(_bones(subject, fingers=True), "no finger")


def _bones(subject: Subject, fingers: bool) -> dict[str, np.ndarray]:
    columns = {}
    for parent, child in subject.bones:
        length = subject.length(parent, child)
        end = child.endswith(("_toe", "_foot", "head_top"))
        if is_finger(child) == fingers and not end and np.nanmedian(length) > 0.02 / (1 + fingers):
            columns[f"{parent}, {child}"] = length
    return columns


def asymmetry(subject: Subject) -> Series:
    """Difference between the bones of both sides, % of their mean."""
    columns = {}
    for (a, b), (c, d) in zip(CORE[::2], CORE[1::2], strict=True):
        if subject.has(a, b, c, d):
            left, right = np.nanmedian(subject.length(a, b)), np.nanmedian(subject.length(c, d))
            columns[f"{a}, {b}"] = 200 * abs(left - right) / max(left + right, 1e-9)
    return need(columns, "no bone on both sides")


def distance(subject: Subject) -> Series:
    """Difference of each length from the likeliest human body's, cm at the default size."""
    size = USUAL_HEIGHT / subject.height
    known = [(a, b) for a, b in (*CORE, *_ACROSS) if subject.has(a, b)]
    lengths = {(a, b): size * float(np.nanmedian(subject.length(a, b))) for a, b in known}
    enough = len(lengths) >= 6 and np.isfinite([*lengths.values()]).all()
    need(enough, "fewer than six bones")
    body = shape_space().likeliest({pair: Measured(max(v, 1e-3), _TRUSTED) for pair, v in lengths.items()}).skeleton
    rest = dict(zip(body.points, body.path @ body.rest_offset, strict=True))
    human = {(a, b): float(np.linalg.norm(rest[a] - rest[b])) for a, b in lengths}
    return {f"{a}, {b}": 100 * abs(length - human[a, b]) for (a, b), length in lengths.items()}


def angle(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return degrees (...) between vectors (..., 3)."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(u, v), axis=-1), (u * v).sum(axis=-1)))
