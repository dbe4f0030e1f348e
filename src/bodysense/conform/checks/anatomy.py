"""Anatomy: is what came a body: its bones, its proportions, its sides and its axes?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense.conform.check import Check, Unanswered, Value
from bodysense.conform.subject import Subject, is_finger, nan_min

_SIDES = ("left", "right")
_TURNED = np.radians(20.0)  # bones whose parent turns less say nothing of frames
_Chain = tuple[str, str]
_CORE: tuple[_Chain, ...] = (
    *((f"{side}_hip", f"{side}_knee") for side in _SIDES),
    *((f"{side}_knee", f"{side}_ankle") for side in _SIDES),
    *((f"{side}_shoulder", f"{side}_elbow") for side in _SIDES),
    *((f"{side}_elbow", f"{side}_wrist") for side in _SIDES),
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
            variation = 100 * float(np.nanstd(length)) / middle
            if variation > worst:
                worst, where = variation, f"{parent} – {child}"
    return Value(worst, where) if worst >= 0 else Unanswered("no bones")


def bone_symmetry(subject: Subject) -> Value | Unanswered:
    """Greatest difference between a bone and its partner, as a share of their mean."""
    worst, where = -1.0, ""
    for parent, child in _CORE:
        if child.startswith("right") or not subject.has(*_both(parent), *_both(child)):
            continue
        left, right = (_median(subject, f"{s}{parent[4:]}", f"{s}{child[4:]}") for s in _SIDES)
        off = 200 * abs(left - right) / max(left + right, 1e-9)
        if off > worst:
            worst, where = off, f"{parent[5:]} – {child[5:]}"
    return Value(worst, where) if worst >= 0 else Unanswered("no bone with a partner")


def height(subject: Subject) -> Value | Unanswered:
    """Ankle to head along the bones."""
    found = subject.height
    return Value(found) if np.isfinite(found) else Unanswered("no chain of bones from ankle to head")


def ratio(a: tuple[_Chain, ...], b: tuple[_Chain, ...], subject: Subject) -> Value | Unanswered:
    """Summed length of bones `a` over that of bones `b`, the mean of both sides."""
    if not subject.has(*{name for chain in (*a, *b) for name in chain}):
        return Unanswered("some of these joints do not come")
    over, under = (sum(_median(subject, *chain) for chain in chains) for chains in (a, b))
    return Value(over / max(under, 1e-9))


def ends_in_order(subject: Subject) -> Value | Unanswered:
    """Share of frames in which a limb's second bone points straight back along its first: joints out of order."""
    worst, where = -1.0, ""
    for side in _SIDES:
        for names in (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist")):
            chain = [f"{side}_{name}" for name in names]
            if not subject.has(*chain):
                continue
            first, second = (_unit(subject.at(b) - subject.at(a)) for a, b in pairwise(chain))
            share = 100 * float(((first * second).sum(axis=-1) < -0.97).mean())
            if share > worst:
                worst, where = share, chain[1]
    return Value(worst, where) if worst >= 0 else Unanswered("no limb is whole")


def up_axis(subject: Subject) -> Value | Unanswered:
    """How far the mean direction from pelvis to head is from +Y, if the body keeps to one direction at all."""
    if not subject.has("pelvis", "head"):
        return Unanswered("no pelvis or no head")
    trunk = _unit(subject.at("head") - subject.at("pelvis"))
    stands = subject.labelled("stand")
    if stands:
        trunk = np.concatenate([trunk[subject.during(step)] for step in stands])
    mean = np.nanmean(trunk, axis=0)
    length = float(np.linalg.norm(mean))
    if stands:
        return Value(float(np.degrees(np.arccos(np.clip(mean[1] / max(length, 1e-9), -1, 1)))))
    if length < 0.9:
        return Unanswered("the trunk keeps to no one direction")
    toes = [(f"{s}_ankle", f"{s}_foot") for s in _SIDES if subject.has(f"{s}_ankle", f"{s}_foot")]
    points = [float(np.nanmedian((_unit(subject.at(b) - subject.at(a)) * mean / length).sum(axis=-1))) for a, b in toes]
    if not points or min(points) < -0.75:
        return Unanswered("the toes point away from the head: nobody stands")
    legs = [_unit(subject.at(f"{s}_hip") - subject.at(f"{s}_ankle")) for s in _SIDES if subject.has(f"{s}_ankle")]
    straight = [float(np.nanmedian((leg * mean / length).sum(axis=-1))) for leg in legs]
    if not straight or min(straight) < 0.8:
        return Unanswered("the legs are not stretched under the trunk: nobody stands")
    return Value(float(np.degrees(np.arccos(np.clip(mean[1] / length, -1, 1)))))


def handedness(subject: Subject) -> Value | Unanswered:
    """Mean of (left × up) · forward, forward from ankles to toes: +1 in a right-handed world, −1 in a mirror."""
    values = []
    for side in _SIDES:
        toe = next((f"{side}_{part}" for part in ("toe", "foot") if subject.has(f"{side}_{part}")), None)
        if toe is None or not subject.has("left_hip", "right_hip", f"{side}_ankle", f"{side}_knee"):
            continue
        across = _unit(subject.at("left_hip") - subject.at("right_hip"))
        up = _unit(subject.at(f"{side}_knee") - subject.at(f"{side}_ankle"))
        forward = _unit(subject.at(toe) - subject.at(f"{side}_ankle"))
        values.append((np.cross(across, up) * forward).sum(axis=-1))
    if not values:
        return Unanswered("no feet")
    return Value(float(np.nanmedian(np.stack(values))))


def left_right(subject: Subject) -> Value | Unanswered:
    """Share of pairs whose left joint lies on the right, in the frame of the bone that carries both."""
    wrong = total = 0
    for frame, part in (("pelvis", "hip"), ("pelvis", "knee"), ("spine3", "collar"), ("spine3", "shoulder")):
        if not subject.has(frame, f"left_{part}", f"right_{part}") or not subject.rotated.any():
            continue
        apart = subject.at(f"left_{part}") - subject.at(f"right_{part}")
        local = quaternion_rotate(quaternion_conjugate(subject.turn(frame)), apart)
        if part in ("knee",):  # knees cross; hips and shoulders do not
            continue
        counted = np.abs(local[:, 0]) > 0.02
        wrong += int((local[counted, 0] < 0).sum())
        total += int(counted.sum())
    return Value(100 * wrong / total) if total else Unanswered("no rotations of the trunk")


def same_frame(subject: Subject) -> Value | Unanswered:
    """Median over bones of how much a child wanders in its parent's frame, as a share of the bone."""
    spread = _spreads(subject, lambda turn: turn)
    if len(spread) < 3:
        return Unanswered("fewer than three bones turn by 20°")
    return Value(100 * float(np.median(spread)))


def better_otherwise(change: Callable[[np.ndarray], np.ndarray], subject: Subject) -> Value | Unanswered:
    """How many times better the places fit if the rotations are read in another way."""
    as_is, otherwise = _spreads(subject, lambda turn: turn), _spreads(subject, change)
    if len(as_is) < 3 or len(otherwise) < 3:
        return Unanswered("fewer than three bones turn by 20°")
    return Value(float(np.median(as_is)) / max(float(np.median(otherwise)), 0.01))


def rest_axes(subject: Subject) -> Value | Unanswered:
    """Greatest angle between a limb's bone in its joint's frame and where the T-pose has it."""
    ours, worst, where = default_skeleton(), -1.0, ""
    for parent, child in _CORE:
        local = _local_bone(subject, parent, child, lambda turn: turn)
        if local is None:
            continue
        mean = np.nanmean(local, axis=0)
        rest = ours.rest_offset[ours.index(child)]
        angle = float(np.degrees(np.arccos(np.clip(_unit(mean) @ _unit(rest), -1, 1))))
        if angle > worst:
            worst, where = angle, parent
    return Value(worst, where) if worst >= 0 else Unanswered("no rotations of limbs")


def penetration(pairs: tuple[tuple[_Chain, _Chain], ...], radius: float, subject: Subject) -> Value | Unanswered:
    """Share of frames in which two limbs' bones are nearer than `radius` m to each other: one is inside the other."""
    worst, where = -1.0, ""
    for one, other in pairs:
        if not subject.has(*one, *other):
            continue
        apart = _between_segments(*(subject.at(name) for name in (*one, *other)))
        share = 100 * float((apart < radius * subject.height / 1.5).mean())
        if share > worst:
            worst, where = share, f"{one[0]}, {other[0]}"
    return Value(worst, where) if worst >= 0 else Unanswered("some of these joints do not come")


def _spreads(subject: Subject, change: Callable[[np.ndarray], np.ndarray]) -> list[float]:
    """Of each limb's and the trunk's bones that turn: how much the child wanders in the parent's frame, by length."""
    found = []
    for parent, child in subject.bones:
        if is_finger(child) or not _turns(subject, parent):
            continue
        local = _local_bone(subject, parent, child, change)
        if local is not None:
            length = max(float(np.nanmedian(subject.length(parent, child))), 1e-9)
            middle = np.nanmedian(local, axis=0)
            if length > 0.05:
                found.append(float(np.nanmedian(np.linalg.norm(local - middle, axis=-1))) / length)
    return found


def _turns(subject: Subject, joint: str) -> bool:
    turn = subject.turn(joint)
    good = turn[np.isfinite(turn).all(axis=-1)]
    if not len(good):
        return False
    return bool(2 * np.arccos(np.clip(np.abs(good @ good[0]), 0, 1)).max() > _TURNED)


def _local_bone(
    subject: Subject, parent: str, child: str, change: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray | None:
    """(T, 3) m of a bone in the frame of the joint that carries it; None where that has no rotation."""
    if not subject.has(parent, child) or not subject.rotated[subject.points.index(parent)]:
        return None
    turn = change(subject.turn(parent))
    return quaternion_rotate(quaternion_conjugate(turn), subject.at(child) - subject.at(parent))


def _between_segments(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """(T,) m between the middles' neighbourhoods of segments a–b and c–d: the least over a grid of points on each."""
    share = np.linspace(0.1, 0.9, 9)[:, None, None]
    one, other = a + share * (b - a), c + share * (d - c)
    apart = np.linalg.norm(one[:, None] - other[None], axis=-1).reshape(-1, len(a))
    return nan_min(apart, axis=0)


def _median(subject: Subject, parent: str, child: str) -> float:
    return float(np.nanmedian(subject.length(parent, child)))


def _both(name: str) -> tuple[str, str]:
    part = name.partition("_")[2]
    return f"left_{part}", f"right_{part}"


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-9)


def _sided(start: str, end: str) -> tuple[_Chain, ...]:
    return tuple((f"{side}_{start}", f"{side}_{end}") for side in _SIDES)


UPPER_ARM, FOREARM = _sided("shoulder", "elbow"), _sided("elbow", "wrist")
THIGH, SHIN = _sided("hip", "knee"), _sided("knee", "ankle")
_TRUNK: tuple[_Chain, ...] = (("pelvis", "neck"),)
_BODY = (*THIGH, *SHIN, *_TRUNK, *_TRUNK)  # of both sides, so twice the trunk
_FRAMES = ("anatomy.component_order", "anatomy.inverse_rotations", "anatomy.rotations_and_positions")
_SIZED = ("anatomy.height", "anatomy.joint_order")

CHECKS = (
    Check(
        "anatomy.height",
        height,
        "m",
        "Nobody is of another size; centimetres are not metres.",
        least=1.1,
        most=2.2,
        after=("data.finite",),
    ),
    Check("anatomy.bone_constancy", bone_constancy, "%", "Bones that stretch tear an avatar's skin.", most=3),
    Check(
        "anatomy.bone_symmetry", bone_symmetry, "%", "One long leg limps.", most=12, after=("anatomy.bone_constancy",)
    ),
    Check("anatomy.joint_order", ends_in_order, "%", "A knee beyond its ankle folds the leg.", most=20),
    Check(
        "anatomy.arm_proportion",
        partial(ratio, FOREARM, UPPER_ARM),
        "forearm / upper arm",
        "Hands miss what they reach for.",
        least=0.6,
        most=1.2,
        after=_SIZED,
    ),
    Check(
        "anatomy.leg_proportion",
        partial(ratio, SHIN, THIGH),
        "shin / thigh",
        "Knees bend at the wrong height.",
        least=0.7,
        most=1.35,
        after=_SIZED,
    ),
    Check(
        "anatomy.arms_to_legs",
        partial(ratio, (*UPPER_ARM, *FOREARM), (*THIGH, *SHIN)),
        "arms / legs",
        "Arms too long or short for the legs.",
        least=0.5,
        most=0.85,
        after=_SIZED,
    ),
    Check(
        "anatomy.trunk_share",
        partial(ratio, _TRUNK, (*THIGH, *SHIN)),
        "trunk / both legs",
        "A trunk too long or short for the legs.",
        least=0.2,
        most=0.48,
        after=_SIZED,
    ),
    Check(
        "anatomy.shoulder_width",
        partial(ratio, (("left_shoulder", "right_shoulder"),), _TRUNK),
        "shoulders / trunk",
        "Arms that hang on the neck, or beside the body.",
        least=0.4,
        most=1.0,
        after=_SIZED,
    ),
    Check(
        "anatomy.hip_width",
        partial(ratio, (("left_hip", "right_hip"),), _TRUNK),
        "hips / trunk",
        "Legs that share a hip, or straddle.",
        least=0.15,
        most=0.6,
        after=_SIZED,
    ),
    Check("anatomy.up_axis", up_axis, "°", "A body that lies on its side in an avatar program.", most=45),
    Check("anatomy.handedness", handedness, "", "In a mirrored world left and right are changed.", least=0.2),
    Check(
        "anatomy.left_right",
        left_right,
        "%",
        "Left limbs on the right.",
        most=5,
        after=("anatomy.handedness", *_FRAMES),
    ),
    Check(
        "anatomy.component_order",
        partial(better_otherwise, lambda turn: np.roll(turn, -1, axis=-1)),
        "times better as x y z w",
        "Quaternions read in another order.",
        most=2,
    ),
    Check(
        "anatomy.inverse_rotations",
        partial(better_otherwise, quaternion_conjugate),
        "times better inverted",
        "Rotations that go the other way.",
        most=2,
        after=("anatomy.component_order",),
    ),
    Check(
        "anatomy.rotations_and_positions",
        same_frame,
        "%",
        "Skin that follows rotations leaves the joints.",
        most=10,
        after=("anatomy.component_order", "anatomy.inverse_rotations", "anatomy.bone_constancy"),
    ),
    Check(
        "anatomy.rest_axes",
        rest_axes,
        "°",
        "A rest pose that is no T-pose bends every limb of an avatar.",
        most=35,
        after=(*_FRAMES, "anatomy.handedness", "anatomy.joint_order"),
    ),
    Check(
        "anatomy.legs_apart",
        partial(penetration, ((THIGH[0], THIGH[1]), (SHIN[0], SHIN[1])), 0.02),
        "%",
        "One leg goes through the other.",
        most=8,
        after=_SIZED,
    ),
    Check(
        "anatomy.arms_outside",
        partial(
            penetration,
            tuple((arm, chain) for arm in FOREARM for chain in (("pelvis", "neck"), ("neck", "head"))),
            0.02,
        ),
        "%",
        "Forearms go through trunk or neck.",
        most=5,
        after=_SIZED,
    ),
    Check(
        "anatomy.arms_apart",
        partial(penetration, ((FOREARM[0], FOREARM[1]),), 0.015),
        "%",
        "One forearm goes through the other.",
        most=8,
        after=_SIZED,
    ),
)
