"""Anatomy: is what came a body: its bones, its proportions, its sides and its axes?"""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.subject import Subject, is_finger

SIDES = ("left", "right")
Chain = tuple[str, str]
CORE: tuple[Chain, ...] = (
    *((f"{side}_hip", f"{side}_knee") for side in SIDES),
    *((f"{side}_knee", f"{side}_ankle") for side in SIDES),
    *((f"{side}_shoulder", f"{side}_elbow") for side in SIDES),
    *((f"{side}_elbow", f"{side}_wrist") for side in SIDES),
)


def bone_constancy(subject: Subject) -> Value | Unanswered:
    """Greatest coefficient of variation of a bone's length; bones from foot to toe and of the fingers left out."""
    worst, where = -1.0, ""
    for parent, child in subject.bones:
        if is_finger(child) or child.endswith(("_toe", "_foot", "head_top")):
            continue
        length = subject.length(parent, child)
        middle = float(np.nanmedian(length))
        if middle > 0.02:
            low, high = np.nanpercentile(length, [2.5, 97.5])  # a leap of a frame is asked for elsewhere
            variation = 100 * float(np.nanstd(np.clip(length, low, high))) / middle
            if variation > worst:
                worst, where = variation, f"{parent} – {child}"
    return Value(worst, where) if worst >= 0 else Unanswered("no bones")


def bone_symmetry(subject: Subject) -> Value | Unanswered:
    """Greatest difference between a bone and its partner, as a share of their mean."""
    worst, where = -1.0, ""
    for parent, child in CORE:
        if child.startswith("right") or not subject.has(*_both(parent), *_both(child)):
            continue
        left, right = (_median(subject, f"{s}{parent[4:]}", f"{s}{child[4:]}") for s in SIDES)
        off = 200 * abs(left - right) / max(left + right, 1e-9)
        if off > worst:
            worst, where = off, f"{parent[5:]} – {child[5:]}"
    return Value(worst, where) if worst >= 0 else Unanswered("no bone with a partner")


def height(subject: Subject) -> Value | Unanswered:
    """Ankle to head along the bones."""
    found = subject.height
    return Value(found) if np.isfinite(found) else Unanswered("no chain of bones from ankle to head")


def ratio(a: tuple[Chain, ...], b: tuple[Chain, ...], subject: Subject) -> Value | Unanswered:
    """Summed length of bones `a` over that of bones `b`, the mean of both sides."""
    if not subject.has(*{name for chain in (*a, *b) for name in chain}):
        return Unanswered("some of these joints do not come")
    over, under = (sum(_median(subject, *chain) for chain in chains) for chains in (a, b))
    return Value(over / max(under, 1e-9))


def ends_in_order(subject: Subject) -> Value | Unanswered:
    """Share of frames in which a limb's second bone points straight back along its first: joints out of order."""
    worst, where = -1.0, ""
    for side in SIDES:
        for names in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")):
            chain = [f"{side}_{name}" for name in names]
            if not subject.has(*chain):
                continue
            first, second = (unit(subject.at(b) - subject.at(a)) for a, b in pairwise(chain))
            share = 100 * float(((first * second).sum(axis=-1) < -0.97).mean())
            if share > worst:
                worst, where = share, chain[1]
    return Value(worst, where) if worst >= 0 else Unanswered("no limb is whole")


def _median(subject: Subject, parent: str, child: str) -> float:
    return float(np.nanmedian(subject.length(parent, child)))


def _both(name: str) -> tuple[str, str]:
    part = name.partition("_")[2]
    return f"left_{part}", f"right_{part}"


def unit(vector: np.ndarray) -> np.ndarray:
    """Vectors (..., n) of length one; zero stays zero."""
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def _sided(start: str, end: str) -> tuple[Chain, ...]:
    return tuple((f"{side}_{start}", f"{side}_{end}") for side in SIDES)


UPPER_ARM, FOREARM = _sided("shoulder", "elbow"), _sided("elbow", "wrist")
THIGH, SHIN = _sided("hip", "knee"), _sided("knee", "ankle")
_TRUNK: tuple[Chain, ...] = (("pelvis", "neck"),)
SIZED = ("anatomy.height", "anatomy.joint_order")
_check = partial(check_of, "anatomy")
_sized = partial(check_of, "anatomy", before=SIZED)

CHECKS = (
    _check(
        "height",
        height,
        "m",
        "Nobody is of another size; centimetres are not metres.",
        least=1.1,
        most=2.2,
        after=("data.finite",),
    ),
    _check("bone_constancy", bone_constancy, "%", "Bones that stretch tear an avatar's skin.", most=3),
    _check("bone_symmetry", bone_symmetry, "%", "One long leg limps.", most=12, after=("bone_constancy",)),
    _check("joint_order", ends_in_order, "%", "A knee beyond its ankle folds the leg.", most=20),
    _sized(
        "arm_proportion",
        partial(ratio, FOREARM, UPPER_ARM),
        "forearm / upper arm",
        "Hands miss what they reach for.",
        least=0.6,
        most=1.2,
    ),
    _sized(
        "leg_proportion",
        partial(ratio, SHIN, THIGH),
        "shin / thigh",
        "Knees bend at the wrong height.",
        least=0.7,
        most=1.35,
    ),
    _sized(
        "arms_to_legs",
        partial(ratio, (*UPPER_ARM, *FOREARM), (*THIGH, *SHIN)),
        "arms / legs",
        "Arms too long or short for the legs.",
        least=0.5,
        most=0.85,
    ),
    _sized(
        "trunk_share",
        partial(ratio, _TRUNK, (*THIGH, *SHIN)),
        "trunk / both legs",
        "A trunk too long or short for the legs.",
        least=0.2,
        most=0.48,
    ),
    _sized(
        "shoulder_width",
        partial(ratio, (("left_shoulder", "right_shoulder"),), _TRUNK),
        "shoulders / trunk",
        "Arms that hang on the neck, or beside the body.",
        least=0.4,
        most=1.0,
    ),
    _sized(
        "hip_width",
        partial(ratio, (("left_hip", "right_hip"),), _TRUNK),
        "hips / trunk",
        "Legs that share a hip, or straddle.",
        least=0.15,
        most=0.6,
    ),
)
