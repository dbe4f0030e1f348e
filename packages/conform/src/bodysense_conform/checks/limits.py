"""Joint limits: does any joint turn further than a person's can, or any limb go through another?"""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np

from bodysense.body.capsules import nearest_shares
from bodysense.body.posture import posture
from bodysense.body.rotation import quaternion_log, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense_conform.check import Check, Unanswered, Value, check_of
from bodysense_conform.checks.anatomy import FOREARM, SHIN, SIZED, THIGH, Chain
from bodysense_conform.checks.frames import FRAMES
from bodysense_conform.subject import Subject

_BENT = np.radians(30.0)  # a hinge that bends less has no direction


def beyond(joints: tuple[str, ...], subject: Subject) -> Value | Unanswered:
    """How far (°) one of these joints is over its range for a quarter of the time."""
    ours = default_skeleton()
    ranges = posture(ours)
    worst, where, frame = -1.0, "", None
    for joint in joints:
        parent = ours.joints[ours.parents[ours.index(joint)]]
        if not subject.has(joint, parent) or not _rotated(subject, joint, parent):
            continue
        turn = quaternion_log(subject.local(parent, joint))
        # Beyond half a turn a logarithm goes the other way about: the same rotation is as far as the nearer of the two.
        length = np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-9)
        low, high = ranges.low[ours.index(joint)], ranges.high[ours.index(joint)]
        ways = [np.maximum(way - high, low - way).max(axis=-1) for way in (turn, turn * (1 - 2 * np.pi / length))]
        over = np.degrees(np.maximum(np.minimum(*ways), 0))
        here = float(np.nanpercentile(over, 75)) if np.isfinite(over).any() else 0.0
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


def penetration(pairs: tuple[tuple[Chain, Chain], ...], radius: float, subject: Subject) -> Value | Unanswered:
    """Share of frames in which two limbs' bones are nearer than `radius` m to each other: one is inside the other.

    A limb is followed along its joints: the straight line from the pelvis to the neck of who bends leaves the trunk.
    """
    worst, where = -1.0, ""
    for one, other in pairs:
        chain = [name for name in _along(*other) if subject.has(name)]
        if not subject.has(*one) or len(chain) < 2:
            continue
        bones = [_between_segments(*(subject.at(name) for name in (*one, a, b))) for a, b in pairwise(chain)]
        share = 100 * float((np.minimum.reduce(bones) < radius * subject.height / 1.5).mean())
        if share > worst:
            worst, where = share, f"{one[0]}, {other[0]}"
    return Value(worst, where) if worst >= 0 else Unanswered("some of these joints do not come")


def _between_segments(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(T,) m between segments a–b and c–d, (T, 3) each, the ends' tenth left out."""
    a, b = a + 0.1 * (b - a), b + 0.1 * (a - b)
    c, d = c + 0.1 * (d - c), d + 0.1 * (c - d)
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = ((p * q).sum(axis=-1) for p, q in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    s, t = nearest_shares(uu, vv, uv, uw, vw)
    return np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=-1)


def _along(start: str, end: str) -> list[str]:
    """The joints from one to another that hangs on it, both included."""
    ours, names = default_skeleton(), [end]
    while names[-1] != start:
        names.append(ours.joints[ours.parents[ours.index(names[-1])]])
    return names[::-1]


def _rotated(subject: Subject, *joints: str) -> bool:
    return all(subject.rotated[subject.points.index(joint)] for joint in joints)


def _both(part: str) -> tuple[str, str]:
    return f"left_{part}", f"right_{part}"


_FRAMES = (*FRAMES, "anatomy.rest_axes", "anatomy.left_right")


def _limit(name: str, joints: tuple[str, ...], most: float, why: str) -> Check:
    return Check(f"anatomy.limits_{name}", partial(beyond, joints), "° over", why, most=most, after=_FRAMES)


_sized = partial(check_of, "anatomy", before=SIZED)
_framed = partial(check_of, "anatomy", before=_FRAMES)

CHECKS = (
    _framed(
        "knees_forward",
        partial(bends_backward, ("hip", "knee", "ankle"), 1.0),
        "%",
        "Knees that bend backward.",
        most=15,
    ),
    _limit("knees", _both("knee"), 75, "Knees that twist, or bend sideways."),
    _limit("hips", _both("hip"), 100, "Legs in places that no leg reaches."),
    _limit("ankles", _both("ankle"), 90, "Feet that point backward."),
    _limit("spine", ("spine1", "spine2", "spine3"), 75, "A trunk that folds or wrings."),
    _limit("neck", ("neck", "head"), 80, "A head that looks backward."),
    _limit("shoulders", _both("shoulder"), 55, "Arms in places that no arm reaches."),
    _limit("elbows", _both("elbow"), 60, "Elbows that bend backward, forearms that wring."),
    _limit("wrists", _both("wrist"), 80, "Hands that bend off the arm."),
    _sized(
        "legs_apart",
        partial(penetration, ((THIGH[0], THIGH[1]), (SHIN[0], SHIN[1])), 0.01),
        "%",
        "One leg goes through the other.",
        most=70,
    ),
    _sized(
        "arms_outside",
        partial(
            penetration,
            tuple((arm, chain) for arm in FOREARM for chain in (("pelvis", "neck"), ("neck", "head"))),
            0.03,
        ),
        "%",
        "Forearms go through trunk or neck.",
        most=75,
    ),
    _sized(
        "arms_apart",
        partial(penetration, ((FOREARM[0], FOREARM[1]),), 0.01),
        "%",
        "One forearm goes through the other.",
        most=75,
    ),
)
