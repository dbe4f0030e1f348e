"""Joints: angles beyond a person's range, by places where places tell them."""

from __future__ import annotations

import numpy as np

from bodysense.body.posture import posture
from bodysense.body.rotation import normalize, quaternion_log, quaternion_rotate
from bodysense.body.skeleton import default_skeleton
from bodysense_conform.quantities.shape import angle
from bodysense_conform.series import Series, need
from bodysense_conform.subject import SIDES, Subject


def beyond(subject: Subject, *joints: str) -> Series:
    """Rotation of joints beyond their range (`bodysense.body.posture`), degrees."""
    ours, columns = default_skeleton(), {}
    ranges = posture(ours)
    for joint, local in _turns(subject, joints).items():
        k, turn = ours.index(joint), quaternion_log(local)
        # A rotation of more than half a turn equals a shorter one the other way: the nearer to the range counts.
        length = np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-9)
        both = (turn, turn * (1 - 2 * np.pi / length))
        over = [np.maximum(one - ranges.high[k], ranges.low[k] - one).max(axis=-1) for one in both]
        columns[joint] = np.degrees(np.maximum(np.minimum(*over), 0))
    return columns


def twist(subject: Subject, axis: str, *joints: str) -> Series:
    """Rotation of joints in their parents about the axis 'x', 'y' or 'z', degrees either way."""
    along = 1 + "xyz".index(axis)
    turns = {joint: np.abs(local) for joint, local in _turns(subject, joints).items()}
    return {joint: np.degrees(2 * np.arctan2(turn[:, along], turn[:, 0])) for joint, turn in turns.items()}


def _turns(subject: Subject, joints: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Return rotations (T, 4) of joints in their parents, of those that have one."""
    ours = default_skeleton()
    pairs = {joint: ours.joints[ours.parents[ours.index(joint)]] for joint in joints}
    known = {joint: parent for joint, parent in pairs.items() if subject.has_rotation(joint, parent)}
    return need(
        {joint: subject.local(parent, joint) for joint, parent in known.items()}, "no rotations of these joints"
    )


def knee(subject: Subject) -> Series:
    """Bend of each knee by the places of hip, knee and ankle, degrees: positive if the knee is in front of the leg."""
    columns = {}
    for side in SIDES:
        hip, middle, ankle = (f"{side}_{part}" for part in ("hip", "knee", "ankle"))
        if subject.has("left_hip", "right_hip", hip, middle, ankle):
            thigh, leg = subject.line(hip, middle), normalize(subject.line(hip, ankle))
            ahead = np.cross(subject.line("left_hip", "right_hip"), leg)
            sign = np.where((thigh * ahead).sum(axis=-1) < 0, -1, 1)
            columns[middle] = sign * angle(thigh, subject.line(middle, ankle))
    return need(columns, "no whole leg")


def head_turn(subject: Subject) -> Series:
    """Angle between the head's forward axis and the front of the shoulders, degrees."""
    known = subject.has("pelvis", "neck", "left_shoulder", "right_shoulder") and subject.has_rotation("head")
    need(known, "no rotation of the head, or no shoulders")
    ahead = np.cross(subject.line("right_shoulder", "left_shoulder"), subject.line("pelvis", "neck"))
    return {"head": angle(quaternion_rotate(subject.turn("head"), np.array([0.0, 0.0, 1.0])), ahead)}


def trunk_twist(subject: Subject) -> Series:
    """Angle between the line of the hips and that of the shoulders, degrees."""
    need(subject.has("left_hip", "right_hip", "left_shoulder", "right_shoulder"), "no hips or no shoulders")
    hips, shoulders = (subject.line(f"right_{part}", f"left_{part}") for part in ("hip", "shoulder"))
    return {"pelvis": angle(hips, shoulders)}


def hips_turn(subject: Subject) -> Series:
    """Angle between the pelvis's left axis and the line of the hips, degrees."""
    known = subject.has("left_hip", "right_hip") and subject.has_rotation("pelvis")
    need(known, "no rotation of the pelvis, or no hips")
    left = quaternion_rotate(subject.turn("pelvis"), np.array([1.0, 0.0, 0.0]))
    return {"pelvis": angle(left, subject.line("right_hip", "left_hip"))}
