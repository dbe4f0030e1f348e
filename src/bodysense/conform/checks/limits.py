"""Joint limits: does any joint turn further than a person's can?"""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from bodysense.body.posture import posture
from bodysense.body.rotation import quaternion_log, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.conform.check import Check, Unanswered, Value
from bodysense.conform.subject import Subject

_BENT = np.radians(30.0)  # a hinge that bends less has no direction


def beyond(joints: tuple[str, ...], subject: Subject) -> Value | Unanswered:
    """How far (°) one of these joints is over its range for a tenth of the time."""
    ours = default_skeleton()
    ranges = posture(ours)
    worst, where, frame = -1.0, "", None
    for joint in joints:
        parent = ours.joints[ours.parents[ours.index(joint)]]
        if not subject.has(joint, parent) or not _rotated(subject, joint, parent):
            continue
        turn = quaternion_log(subject.local(parent, joint))
        k = ours.index(joint)
        over = np.degrees(np.maximum(np.maximum(turn - ranges.high[k], ranges.low[k] - turn), 0).max(axis=-1))
        here = float(np.nanpercentile(over, 90)) if np.isfinite(over).any() else 0.0
        if here > worst:
            worst, where, frame = here, joint, int(np.nanargmax(over)) if np.isfinite(over).any() else None
    return Value(worst, where, frame) if worst >= 0 else Unanswered("no rotations of these joints")


def bends_backward(parts: tuple[str, str, str], sense: float, subject: Subject) -> Value | Unanswered:
    """Share of the frames in which a hinge is bent, that it is bent the wrong way, by the places of its joints."""
    worst, where = -1.0, ""
    for side in ("left", "right"):
        chain = [f"{side}_{part}" for part in parts]
        if not subject.has(*chain) or not subject.rotated[subject.points.index(chain[0])]:
            continue
        first, second = (subject.at(b) - subject.at(a) for a, b in pairwise(chain))
        first, second = (v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9) for v in (first, second))
        hinge = quaternion_rotate(subject.turn(chain[0]), np.array([1.0, 0.0, 0.0]))
        bent = np.arccos(np.clip((first * second).sum(axis=-1), -1, 1)) > _BENT
        wrong = bent & (sense * (np.cross(first, second) * hinge).sum(axis=-1) < 0)
        if bent.sum() >= 5:
            share = 100 * float(wrong.sum() / max(bent.sum(), 1)) * min(1.0, 10 * float(bent.mean()))
            if share > worst:
                worst, where = share, chain[1]
    return Value(worst, where) if worst >= 0 else Unanswered("it is never bent by 30°")


def _rotated(subject: Subject, *joints: str) -> bool:
    return all(subject.rotated[subject.points.index(joint)] for joint in joints)


def _both(part: str) -> tuple[str, str]:
    return f"left_{part}", f"right_{part}"


_FRAMES = (
    "anatomy.component_order",
    "anatomy.inverse_rotations",
    "anatomy.rotations_and_positions",
    "anatomy.rest_axes",
    "anatomy.left_right",
)


def _limit(name: str, joints: tuple[str, ...], most: float, why: str) -> Check:
    return Check(f"anatomy.limits_{name}", partial(beyond, joints), "° over", why, most=most, after=_FRAMES)


CHECKS = (
    Check(
        "anatomy.knees_forward",
        partial(bends_backward, ("hip", "knee", "ankle"), 1.0),
        "%",
        "Knees that bend backward.",
        most=15,
        after=_FRAMES,
    ),
    _limit("knees", _both("knee"), 30, "Knees that twist, or bend sideways."),
    _limit("hips", _both("hip"), 30, "Legs in places that no leg reaches."),
    _limit("ankles", _both("ankle"), 30, "Feet that point backward."),
    _limit("spine", ("spine1", "spine2", "spine3"), 30, "A trunk that folds or wrings."),
    _limit("neck", ("neck", "head"), 30, "A head that looks backward."),
    _limit("shoulders", _both("shoulder"), 40, "Arms in places that no arm reaches."),
    _limit("elbows", _both("elbow"), 40, "Elbows that bend backward, forearms that wring."),
    _limit("wrists", _both("wrist"), 40, "Hands that bend off the arm."),
)
