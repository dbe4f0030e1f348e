"""Axes: up, left, order of quaternions, and rotations that fit the places."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bodysense.body.rotation import quaternion_conjugate, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense_conform.quantities.shape import CORE, SIDES, angle, unit
from bodysense_conform.series import NotEnough, Series, series, stacked
from bodysense_conform.subject import Subject, is_finger

_TURNED = np.radians(20.0)  # bones whose parent turns less tell nothing about axes
_UP = np.array([0.0, 1.0, 0.0])
Reading = Callable[[np.ndarray], np.ndarray]


def up_axis(subject: Subject) -> Series:
    """Angle between the mean direction from pelvis to head and +Y, of a body that stands, degrees."""
    if not subject.has("pelvis", "head"):
        raise NotEnough("no pelvis or no head")
    trunk = unit(subject.at("head") - subject.at("pelvis"))
    stands = subject.labelled("stand")
    if stands:
        mean = np.nanmean(np.concatenate([trunk[subject.during(step)] for step in stands]), axis=0)
        return series(angle(mean, _UP)[None])
    mean = np.nanmean(trunk, axis=0)
    if np.linalg.norm(mean) < 0.9:
        raise NotEnough("the trunk keeps to no direction")
    mean = unit(mean)
    way = np.nan_to_num(np.diff(subject.at("pelvis"), axis=0))
    far = np.linalg.norm(way, axis=-1).sum()
    if far > 0.5 and np.abs(way @ mean).sum() > 0.6 * far:
        raise NotEnough("the body moves along its trunk: it lies or swims")
    # A body stands if its legs are stretched under the trunk, no toe points down and an arm hangs.
    standing = ((("hip", "ankle"), -0.8), (("shoulder", "elbow"), -0.8))
    for (a, b), most in standing:
        limbs = [(f"{side}_{a}", f"{side}_{b}") for side in SIDES if subject.has(f"{side}_{a}", f"{side}_{b}")]
        along = [float(np.nanmedian(unit(subject.at(d) - subject.at(c)) @ mean)) for c, d in limbs]
        worst = (max if a == "hip" else min)(along, default=1.0)
        if worst > most:
            raise NotEnough("no stretched legs and hanging arm: the body does not stand")
    toes = [(f"{s}_ankle", f"{s}_foot") for s in SIDES if subject.has(f"{s}_ankle", f"{s}_foot")]
    if any(np.nanmedian(unit(subject.at(b) - subject.at(a)) @ mean) < -0.75 for a, b in toes) or not toes:
        raise NotEnough("the toes point away from the head: the body does not stand")
    return series(angle(mean, _UP)[None])


def handedness(subject: Subject) -> Series:
    """(left × up) · forward, forward from ankles to toes: 1 in a right-handed world, −1 in a mirror."""
    columns = {}
    for side in SIDES:
        if subject.has("left_hip", "right_hip", f"{side}_ankle", f"{side}_knee", f"{side}_foot"):
            across = unit(subject.at("left_hip") - subject.at("right_hip"))
            up = unit(subject.at(f"{side}_knee") - subject.at(f"{side}_ankle"))
            forward = unit(subject.at(f"{side}_foot") - subject.at(f"{side}_ankle"))
            columns[side] = (np.cross(across, up) * forward).sum(axis=-1)
    if not columns:
        raise NotEnough("no feet")
    return series(np.nanmean(np.stack(list(columns.values())), axis=0))


def left_right(subject: Subject) -> Series:
    """Whether a left joint is on the right, in the frame of the bone that carries both."""
    columns = {}
    for frame, part in (("pelvis", "hip"), ("spine3", "collar"), ("spine3", "shoulder")):
        if subject.has(f"left_{part}", f"right_{part}") and subject.has_rotation(frame):
            apart = subject.at(f"left_{part}") - subject.at(f"right_{part}")
            local = quaternion_rotate(quaternion_conjugate(subject.turn(frame)), apart)[:, 0]
            columns[frame] = np.where(np.abs(local) > 0.02, local < 0, np.nan)
    return stacked(columns, "no rotations of the trunk")


def mismatch(subject: Subject) -> Series:
    """Median over the bones of how far a child wanders in its parent's frame, % of the bone."""
    return series(100 * np.median(_spreads(subject, lambda turn: turn)))


def misread(subject: Subject, reading: tuple[str, ...]) -> Series:
    """How many times better the places fit if quaternions are read as 'xyzw', or as 'inverse' rotations."""
    other = quaternion_conjugate if reading == ("inverse",) else lambda turn: np.roll(turn, 1, axis=-1)
    usual, better = (np.median(_spreads(subject, way)) for way in (lambda turn: turn, other))
    return series(usual / max(better, 0.02))


def rest_axes(subject: Subject) -> Series:
    """Angle between a limb's bone in its joint's frame and the T-pose, degrees."""
    ours, columns = default_skeleton(), {}
    for parent, child in CORE:
        if subject.has(child) and subject.has_rotation(parent):
            mean = np.nanmean(_local_bone(subject, parent, child, lambda turn: turn), axis=0)
            columns[parent] = angle(mean, ours.rest_offset[ours.index(child)])[None]
    return stacked(columns, "no rotations of limbs")


def _spreads(subject: Subject, reading: Reading) -> list[float]:
    """How far each child wanders in its parent's frame, as a share of the bone, of parents that turn."""
    found = []
    for parent, child in subject.bones:
        length = float(np.nanmedian(subject.length(parent, child)))
        if not is_finger(child) and length > 0.05 and subject.has_rotation(parent) and _turns(subject, parent):
            local = _local_bone(subject, parent, child, reading)
            wander = np.linalg.norm(local - np.nanmedian(local, axis=0), axis=-1)
            found.append(float(np.nanmean(wander)) / length)
    if len(found) < 3:
        raise NotEnough("fewer than three bones turn by 20°")
    return found


def _turns(subject: Subject, joint: str) -> bool:
    turn = subject.turn(joint)
    good = turn[np.isfinite(turn).all(axis=-1)]
    return bool(2 * np.arccos(np.clip(np.abs(good @ good[0]), 0, 1)).max() > _TURNED)


def _local_bone(subject: Subject, parent: str, child: str, reading: Reading) -> np.ndarray:
    """Return a bone (T, 3), metres, in the frame of the joint that carries it."""
    turn = reading(subject.turn(parent))
    return quaternion_rotate(quaternion_conjugate(turn), subject.at(child) - subject.at(parent))
