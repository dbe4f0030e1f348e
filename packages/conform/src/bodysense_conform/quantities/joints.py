"""Joints: angles beyond a person's range, by places where places tell them."""

from __future__ import annotations

import numpy as np

from bodysense.body.posture import posture
from bodysense.body.rotation import quaternion_log, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense_conform.quantities.shape import SIDES, angle, unit
from bodysense_conform.series import NotEnough, Series, stacked
from bodysense_conform.subject import Subject

_AXES = {"x": 1, "y": 2, "z": 3}


def beyond(subject: Subject, joints: tuple[str, ...]) -> Series:
    """Rotation of joints beyond their range (`bodysense.body.posture`), degrees."""
    ours, columns = default_skeleton(), {}
    ranges = posture(ours)
    for joint in joints:
        k = ours.index(joint)
        parent = ours.joints[ours.parents[k]]
        if subject.has_rotation(joint, parent):
            turn = quaternion_log(subject.local(parent, joint))
            # A rotation of more than half a turn equals a shorter one the other way: the nearer to the range counts.
            length = np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-9)
            both = (turn, turn * (1 - 2 * np.pi / length))
            over = [np.maximum(one - ranges.high[k], ranges.low[k] - one).max(axis=-1) for one in both]
            columns[joint] = np.degrees(np.maximum(np.minimum(*over), 0))
    return stacked(columns, "no rotations of these joints")


def twist(subject: Subject, joints: tuple[str, ...]) -> Series:
    """Rotation of joints in their parents about the axis that comes first in `joints`, degrees either way."""
    axis, *names = joints
    ours, columns = default_skeleton(), {}
    for joint in names:
        parent = ours.joints[ours.parents[ours.index(joint)]]
        if subject.has_rotation(joint, parent):
            local = subject.local(parent, joint)
            columns[joint] = np.degrees(2 * np.arctan2(np.abs(local[:, _AXES[axis]]), np.abs(local[:, 0])))
    return stacked(columns, "no rotations of these joints")


def knee(subject: Subject) -> Series:
    """Bend of each knee by the places of hip, knee and ankle, degrees: positive if the knee is in front of the leg."""
    columns = {}
    for side in SIDES:
        names = [f"{side}_{part}" for part in ("hip", "knee", "ankle")]
        if subject.has("left_hip", "right_hip", *names):
            hip, middle, ankle = (subject.at(name) for name in names)
            leg = unit(ankle - hip)
            ahead = np.cross(subject.at("right_hip") - subject.at("left_hip"), leg)
            sign = np.where(((middle - hip) * ahead).sum(axis=-1) < 0, -1, 1)
            columns[names[1]] = sign * angle(middle - hip, ankle - middle)
    return stacked(columns, "no whole leg")


def head_turn(subject: Subject) -> Series:
    """Angle between the head's forward axis and the front of the shoulders, degrees."""
    if not subject.has("pelvis", "neck", "left_shoulder", "right_shoulder") or not subject.has_rotation("head"):
        raise NotEnough("no rotation of the head, or no shoulders")
    across = subject.at("left_shoulder") - subject.at("right_shoulder")
    ahead = np.cross(across, subject.at("neck") - subject.at("pelvis"))
    return stacked({"head": angle(quaternion_rotate(subject.turn("head"), np.array([0.0, 0.0, 1.0])), ahead)}, "")


def trunk_twist(subject: Subject) -> Series:
    """Angle between the line of the hips and that of the shoulders, degrees."""
    if not subject.has("left_hip", "right_hip", "left_shoulder", "right_shoulder"):
        raise NotEnough("no hips or no shoulders")
    hips, shoulders = (subject.at(f"left_{part}") - subject.at(f"right_{part}") for part in ("hip", "shoulder"))
    return stacked({"pelvis": angle(hips, shoulders)}, "")


def hips_turn(subject: Subject) -> Series:
    """Angle between the pelvis's left axis and the line of the hips, degrees."""
    if not subject.has("left_hip", "right_hip") or not subject.has_rotation("pelvis"):
        raise NotEnough("no rotation of the pelvis, or no hips")
    left = quaternion_rotate(subject.turn("pelvis"), np.array([1.0, 0.0, 0.0]))
    return stacked({"pelvis": angle(left, subject.at("left_hip") - subject.at("right_hip"))}, "")
