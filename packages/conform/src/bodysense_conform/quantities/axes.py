"""Axes: up, left, order of quaternions, and rotations that fit the places."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import normalize, quaternion_conjugate, quaternion_rotate
from bodysense_conform.quantities.shape import LIMBS
from bodysense_conform.series import Series, angle, dot, need, norm
from bodysense_conform.subject import SIDES, UP, Subject, is_finger

_TURNED = np.radians(20.0)  # bones whose parent turns less give no evidence of axes
Reading = Callable[[np.ndarray], np.ndarray]


def up_axis(subject: Subject) -> Series:
    """Angle between the mean direction from pelvis to head and +Y, of a body that stands, degrees."""
    trunk = normalize(subject.line("pelvis", "head"))
    if subject.labelled("stand"):
        return float(angle(np.nanmean(trunk[subject.within("stand")], axis=0), UP))
    mean = np.nanmean(trunk, axis=0)
    need(not np.linalg.norm(mean) < 0.9, "the trunk keeps to no direction")
    mean = normalize(mean)
    _check_stands(subject, mean)
    return float(angle(mean, UP))


def _check_stands(subject: Subject, up: np.ndarray) -> None:
    """Raise NotEnough unless the legs are stretched under the trunk, no toe points down and an arm hangs."""
    way = np.nan_to_num(np.diff(subject.at("pelvis"), axis=0))
    far = norm(way).sum()
    swims = far > 0.5 and np.abs(way @ up).sum() > 0.6 * far
    need(not swims, "the body moves along its trunk: it lies or swims")

    def along(start: str, end: str) -> list[float]:
        """Return how far the limbs of both sides point up, from -1 to 1."""
        limbs = [(f"{side}_{start}", f"{side}_{end}") for side in SIDES]
        return [float(np.nanmedian(normalize(subject.line(*limb)) @ up)) for limb in limbs if subject.has(*limb)]

    legs, arm = max(along("hip", "ankle"), default=1.0), min(along("shoulder", "elbow"), default=1.0)
    need(not (legs > -0.8 or arm > -0.8), "no stretched legs and hanging arm: the body does not stand")
    down = min(along("ankle", "foot"), default=-1.0) < -0.75
    need(not down, "the toes point away from the head: the body does not stand")


def handedness(subject: Subject) -> Series:
    """(left × up) · forward, forward from ankles to toes: 1 in a right-handed world, −1 in a mirror."""
    found = []
    for side in SIDES:
        if subject.has("left_hip", "right_hip", f"{side}_ankle", f"{side}_knee", f"{side}_foot"):
            lines = (("right_hip", "left_hip"), (f"{side}_ankle", f"{side}_knee"), (f"{side}_ankle", f"{side}_foot"))
            across, up, forward = (normalize(subject.line(*line)) for line in lines)
            found.append(dot(np.cross(across, up), forward))
    return np.nanmean(need(found, "no feet"), axis=0)


def left_right(subject: Subject) -> Series:
    """Whether a left joint is on the right, in the frame of the bone that carries both."""
    columns = {}
    for frame, part in (("pelvis", "hip"), ("spine3", "collar"), ("spine3", "shoulder")):
        if subject.has(f"left_{part}", f"right_{part}") and subject.has_rotation(frame):
            local = subject.carried(frame, subject.line(f"right_{part}", f"left_{part}"))[:, 0]
            columns[frame] = np.where(np.abs(local) > 0.02, local < 0, np.nan)
    return need(columns, "no rotations of the trunk")


def misread(subject: Subject, reading: str) -> Series:
    """How many times better the places fit if quaternions are read as 'xyzw', or as 'inverse' rotations."""
    other = quaternion_conjugate if reading == "inverse" else lambda turn: np.roll(turn, 1, axis=-1)
    return float(np.median(spreads(subject)) / max(np.median(spreads(subject, other)), 0.02))


def rest_angle(subject: Subject, joint: str) -> Series:
    """Angle between a limb's bone in its joint's frame and the T-pose, degrees."""
    ours, end = default_skeleton(), LIMBS[joint]
    mean = np.nanmean(subject.carried(joint, subject.line(joint, end)), axis=0)
    return float(angle(mean, ours.rest_offset[ours.index(end)]))


def spreads(subject: Subject, reading: Reading = np.asarray) -> list[float]:
    """Return the spread of each child in the frame of its turning parent, as a share of the bone."""
    found = []
    for parent, child in subject.bones:
        bone = subject.line(parent, child)
        length = float(np.nanmedian(norm(bone)))
        if is_finger(child) or length <= 0.05 or not subject.has_rotation(parent):
            continue
        turn = subject.turn(parent)
        good = turn[np.isfinite(turn).all(axis=-1)]
        if 2 * np.arccos(np.clip(np.abs(good @ good[0]), 0, 1)).max() > _TURNED:
            local = quaternion_rotate(quaternion_conjugate(reading(turn)), bone)
            found.append(float(np.nanmean(norm(local - np.nanmedian(local, axis=0)))) / length)
    need(len(found) >= 3, "fewer than three bones turn by 20°")
    return found
