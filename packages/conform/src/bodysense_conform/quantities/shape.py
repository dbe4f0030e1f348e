"""Shape: lengths of bones and proportions."""

from __future__ import annotations

import numpy as np

from bodysense.body.shape import Measured, shape_space
from bodysense_conform.series import Series, later, need
from bodysense_conform.subject import SIDES, USUAL_HEIGHT, Subject, is_finger

_BELOW = (("hip", "knee"), ("knee", "ankle"), ("shoulder", "elbow"), ("elbow", "wrist"))
LIMBS = {f"{side}_{start}": f"{side}_{end}" for start, end in _BELOW for side in SIDES}
_ACROSS = (("left_hip", "right_hip"), ("left_shoulder", "right_shoulder"), ("neck", "head"), ("pelvis", "neck"))
_TRUSTED = 0.02  # m; deviation of a measured length when the nearest body is searched


def bones_of(subject: Subject, part: str) -> list[tuple[str, str]]:
    """Return the bones of the 'body' or the 'fingers', without the ends of feet and head."""
    shortest = 0.01 if part == "fingers" else 0.02  # m
    return [
        (parent, child)
        for parent, child in subject.bones
        if is_finger(child) == (part == "fingers")
        and not child.endswith(("_toe", "_foot", "head_top"))
        and subject.along([parent, child]) > shortest
    ]


def flicker(length: np.ndarray) -> np.ndarray:
    """Return the departure of a length (T,) from the mean of the frames before and after, % of its median."""
    need(len(length) >= 3, "fewer than three frames")
    return 100 * np.abs(length - (later(length, 1) + later(length, -1)) / 2) / np.nanmedian(length)


def asymmetry(subject: Subject, *bone: str) -> Series:
    """Difference between a bone of the left and that of the right, % of their mean."""
    left, right = subject.along(bone), subject.along([point.replace("left", "right") for point in bone])
    return 200 * abs(left - right) / max(left + right, 1e-9)


def unlikeness(subject: Subject) -> Series:
    """Difference of each length from the likeliest human body's, cm at the default size."""
    size = USUAL_HEIGHT / subject.height
    known = [bone for bone in (*LIMBS.items(), *_ACROSS) if subject.has(*bone)]
    lengths = {bone: size * subject.along(bone) for bone in known}
    enough = len(lengths) >= 6 and np.isfinite([*lengths.values()]).all()
    need(enough, "fewer than six bones")
    body = shape_space().likeliest({pair: Measured(max(v, 1e-3), _TRUSTED) for pair, v in lengths.items()}).skeleton
    rest = dict(zip(body.points, body.path @ body.rest_offset, strict=True))
    human = {(a, b): float(np.linalg.norm(rest[a] - rest[b])) for a, b in lengths}
    return {f"{a}, {b}": 100 * abs(length - human[a, b]) for (a, b), length in lengths.items()}
