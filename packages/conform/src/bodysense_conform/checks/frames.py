"""Frames: are its axes, sides and rotations those that it says they are?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense_conform.check import Unanswered, Value, check_of
from bodysense_conform.checks.anatomy import CORE, SIDES, unit
from bodysense_conform.subject import Subject, is_finger

_TURNED = np.radians(20.0)  # bones whose parent turns less say nothing of frames


def up_axis(subject: Subject) -> Value | Unanswered:
    """How far the mean direction from pelvis to head is from +Y, if the body keeps to one direction at all."""
    if not subject.has("pelvis", "head"):
        return Unanswered("no pelvis or no head")
    trunk = unit(subject.at("head") - subject.at("pelvis"))
    stands = subject.labelled("stand")
    if stands:
        trunk = np.concatenate([trunk[subject.during(step)] for step in stands])
    mean = np.nanmean(trunk, axis=0)
    length = float(np.linalg.norm(mean))
    if stands:
        return Value(float(np.degrees(np.arccos(np.clip(mean[1] / max(length, 1e-9), -1, 1)))))
    if length < 0.9:
        return Unanswered("the trunk keeps to no one direction")
    if _swims(subject, mean / length):
        return Unanswered("it goes where the head points: it lies or swims")
    toes = [(f"{s}_ankle", f"{s}_foot") for s in SIDES if subject.has(f"{s}_ankle", f"{s}_foot")]
    points = [float(np.nanmedian((unit(subject.at(b) - subject.at(a)) * mean / length).sum(axis=-1))) for a, b in toes]
    if not points or min(points) < -0.75:
        return Unanswered("the toes point away from the head: nobody stands")
    legs = [unit(subject.at(f"{s}_hip") - subject.at(f"{s}_ankle")) for s in SIDES if subject.has(f"{s}_ankle")]
    straight = [float(np.nanmedian((leg * mean / length).sum(axis=-1))) for leg in legs]
    if not straight or min(straight) < 0.8:
        return Unanswered("the legs are not stretched under the trunk: nobody stands")
    arms = [unit(subject.at(f"{s}_elbow") - subject.at(f"{s}_shoulder")) for s in SIDES if subject.has(f"{s}_elbow")]
    hanging = [float(np.nanmedian((arm * mean / length).sum(axis=-1))) for arm in arms]
    if not hanging or min(hanging) > -0.8:
        return Unanswered("no arm hangs: nobody stands")
    return Value(float(np.degrees(np.arccos(np.clip(mean[1] / length, -1, 1)))))


def _swims(subject: Subject, up: np.ndarray) -> bool:
    """Whether the body travels, and mostly along its trunk."""
    way = np.diff(subject.at("pelvis"), axis=0)
    way = way[np.isfinite(way).all(axis=-1)]
    total = np.linalg.norm(way, axis=-1).sum()
    return bool(total > 0.5 and np.abs(way @ up).sum() > 0.6 * total)


def handedness(subject: Subject) -> Value | Unanswered:
    """Mean of (left × up) · forward, forward from ankles to toes: +1 in a right-handed world, −1 in a mirror."""
    values = []
    for side in SIDES:
        toe = next((f"{side}_{part}" for part in ("toe", "foot") if subject.has(f"{side}_{part}")), None)
        if toe is None or not subject.has("left_hip", "right_hip", f"{side}_ankle", f"{side}_knee"):
            continue
        across = unit(subject.at("left_hip") - subject.at("right_hip"))
        up = unit(subject.at(f"{side}_knee") - subject.at(f"{side}_ankle"))
        forward = unit(subject.at(toe) - subject.at(f"{side}_ankle"))
        values.append((np.cross(across, up) * forward).sum(axis=-1))
    if not values:
        return Unanswered("no feet")
    return Value(float(np.nanmedian(np.stack(values))))


def left_right(subject: Subject) -> Value | Unanswered:
    """Share of pairs whose left joint lies on the right, in the frame of the bone that carries both."""
    wrong = total = 0
    for frame, part in (("pelvis", "hip"), ("spine3", "collar"), ("spine3", "shoulder")):
        if not subject.has(frame, f"left_{part}", f"right_{part}") or not subject.rotated.any():
            continue
        apart = subject.at(f"left_{part}") - subject.at(f"right_{part}")
        local = quaternion_rotate(quaternion_conjugate(subject.turn(frame)), apart)
        counted = np.abs(local[:, 0]) > 0.02
        wrong += int((local[counted, 0] < 0).sum())
        total += int(counted.sum())
    return Value(100 * wrong / total) if total else Unanswered("no rotations of the trunk")


def same_frame(subject: Subject) -> Value | Unanswered:
    """Median over bones of how far a child wanders on average in its parent's frame, as a share of the bone."""
    spread = _spreads(subject, lambda turn: turn)
    if len(spread) < 3:
        return Unanswered("fewer than three bones turn by 20°")
    return Value(100 * float(np.median(spread)))


def better_otherwise(change: Callable[[np.ndarray], np.ndarray], subject: Subject) -> Value | Unanswered:
    """How many times better the places fit if the rotations are read in another way."""
    as_is, otherwise = _spreads(subject, lambda turn: turn), _spreads(subject, change)
    if len(as_is) < 3 or len(otherwise) < 3:
        return Unanswered("fewer than three bones turn by 20°")
    return Value(float(np.median(as_is)) / max(float(np.median(otherwise)), 0.02))


def rest_axes(subject: Subject) -> Value | Unanswered:
    """Greatest angle between a limb's bone in its joint's frame and where the T-pose has it."""
    ours, worst, where = default_skeleton(), -1.0, ""
    for parent, child in CORE:
        local = _local_bone(subject, parent, child, lambda turn: turn)
        if local is None:
            continue
        mean = np.nanmean(local, axis=0)
        rest = ours.rest_offset[ours.index(child)]
        angle = float(np.degrees(np.arccos(np.clip(unit(mean) @ unit(rest), -1, 1))))
        if angle > worst:
            worst, where = angle, parent
    return Value(worst, where) if worst >= 0 else Unanswered("no rotations of limbs")


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
                found.append(float(np.nanmean(np.linalg.norm(local - middle, axis=-1))) / length)
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


FRAMES = ("anatomy.component_order", "anatomy.inverse_rotations", "anatomy.rotations_and_positions")
_check = partial(check_of, "anatomy")
_framed = partial(check_of, "anatomy", before=FRAMES)

CHECKS = (
    _check("up_axis", up_axis, "°", "A body that lies on its side in an avatar program.", most=60),
    _check("handedness", handedness, "", "In a mirrored world left and right are changed.", least=0.2),
    _check(
        "component_order",
        partial(better_otherwise, lambda turn: np.roll(turn, -1, axis=-1)),
        "times better as x y z w",
        "Quaternions read in another order.",
        most=2,
    ),
    _check(
        "inverse_rotations",
        partial(better_otherwise, quaternion_conjugate),
        "times better inverted",
        "Rotations that go the other way.",
        most=2,
        after=("component_order",),
    ),
    _check(
        "rotations_and_positions",
        same_frame,
        "%",
        "Skin that follows rotations leaves the joints.",
        most=10,
        after=("component_order", "inverse_rotations", "bone_constancy"),
    ),
    _check("left_right", left_right, "%", "Left limbs on the right.", most=5, after=("handedness", *FRAMES)),
    _framed(
        "rest_axes",
        rest_axes,
        "°",
        "A rest pose that is no T-pose bends every limb of an avatar.",
        most=35,
        after=("handedness", "joint_order"),
    ),
)
