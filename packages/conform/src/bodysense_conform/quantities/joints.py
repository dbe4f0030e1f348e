"""Joints: angles beyond a person's range, from positions if possible."""

from __future__ import annotations

import numpy as np

from bodysense.body.posture import posture
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import normalize, quaternion_log
from bodysense_conform.series import Series, angle, dot
from bodysense_conform.subject import Subject

FOLDED = 25.0  # degrees of a knee that is folded backward
_ALONG = 0.7  # cosine between the hips and the axis about which a knee folds: legs that are turned out stay below


def beyond(subject: Subject, joint: str) -> Series:
    """Rotation of a joint beyond its range (`bodysense.body.posture`), degrees."""
    k, turn = default_skeleton().index(joint), quaternion_log(in_parent(subject, joint))
    ranges = posture(default_skeleton())
    # A rotation of more than half a turn equals a shorter one the other way: the nearer to the range counts.
    length = np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-9)
    both = (turn, turn * (1 - 2 * np.pi / length))
    over = [np.maximum(one - ranges.high[k], ranges.low[k] - one).max(axis=-1) for one in both]
    return np.degrees(np.maximum(np.minimum(*over), 0))


def twist(subject: Subject, joint: str, axis: str) -> Series:
    """Rotation of a joint in its parent about the axis 'x', 'y' or 'z', degrees either way."""
    turn = np.abs(in_parent(subject, joint))
    return np.degrees(2 * np.arctan2(turn[:, 1 + "xyz".index(axis)], turn[:, 0]))


def in_parent(subject: Subject, joint: str) -> np.ndarray:
    """Return rotations (T, 4) of a joint in its parent. Raises Absent if one of both has none."""
    ours = default_skeleton()
    return subject.local(ours.joints[ours.parents[ours.index(joint)]], joint)


def knee_bend(subject: Subject, hip: str, knee: str, ankle: str) -> Series:
    """Bend of a knee from the positions of hip, knee and ankle, degrees: positive if the knee is ahead of the leg."""
    thigh, leg = subject.line(hip, knee), normalize(subject.line(hip, ankle))
    ahead = np.cross(subject.line("left_hip", "right_hip"), leg)
    return np.where(dot(thigh, ahead) < 0, -1, 1) * angle(thigh, subject.line(knee, ankle))


def knee_fold(subject: Subject, hip: str, knee: str, ankle: str) -> Series:
    """Angle by which a knee folds backward about an axis along the hips, degrees; 0 if it bends another way."""
    thigh, shin = subject.line(hip, knee), subject.line(knee, ankle)
    axis, hips = normalize(np.cross(thigh, shin)), normalize(subject.line("left_hip", "right_hip"))
    return np.where(dot(axis, hips) > _ALONG, angle(thigh, shin), np.where(np.isfinite(thigh[:, 0]), 0.0, np.nan))
