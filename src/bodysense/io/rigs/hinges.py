"""The twist of arms and legs from how they bend: an elbow or a knee turns about one axis, which its motion shows.

A rest pose whose bones all lie along one axis says where bones point, not how they are turned about themselves. In our
T-pose elbows bend about the vertical axis and knees about the transverse one; the turn about the bone that brings the
axis found there is the twist that the rest pose leaves open.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_conjugate, quaternion_exp, quaternion_multiply, quaternion_rotate

LEAST_BEND = np.deg2rad(15.0)  # a joint that never bends more shows no axis
_LEAST_AGREEMENT = 0.5  # mean resultant of the axes found: below it they do not agree

# Limb, its joints, and the axis about which the second bends in the T-pose.
_HINGES = [
    ((f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"), (0.0, -sign, 0.0))
    for side, sign in (("left", 1), ("right", -1))
] + [((f"{side}_hip", f"{side}_knee", f"{side}_ankle"), (1.0, 0.0, 0.0)) for side in ("left", "right")]


def twisted_by_hinges(
    align: dict[str, np.ndarray], pose: Pose, standing: Pose, match: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Alignments (4,) with upper arms and thighs, forearms and shins twisted so that they bend as ours do."""
    position, rotation = forward_kinematics(pose)
    rest = forward_kinematics(standing)[1]
    twisted = dict(align)
    for (first, second, third), hinge in (limb for limb in _HINGES if limb[0][0] in match):
        upper, lower = (position[:, match[b]] - position[:, match[a]] for a, b in ((first, second), (second, third)))
        normal = np.cross(upper, lower)
        lengths = np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1)
        bend = np.linalg.norm(normal, axis=-1) / np.maximum(lengths, 1e-12)  # sine
        clear = bend > np.sin(LEAST_BEND)
        if clear.sum() < 2:
            continue
        for joint, bone in ((first, upper), (second, lower)):
            ours = quaternion_multiply(
                rotation[clear, match[joint]],
                quaternion_conjugate(quaternion_multiply(align[joint], rest[match[joint]])),
            )
            back = quaternion_conjugate(ours)
            angle, agreement = _turn_about(
                quaternion_rotate(back, bone[clear]), np.array(hinge), quaternion_rotate(back, normal[clear])
            )
            if agreement > _LEAST_AGREEMENT:
                axis = quaternion_rotate(back, bone[clear]).mean(axis=0)
                axis /= max(float(np.linalg.norm(axis)), 1e-9)
                # The joint's frame turns with its twist, so that what is seen in it turns the other way.
                twist = quaternion_exp(-angle * axis)
                twisted[joint] = quaternion_multiply(twist, align[joint])
                hand = third.endswith("_wrist") and joint == second
                if hand and third.replace("wrist", "index1") not in match:  # its palm does not say how it is turned
                    twisted[third] = quaternion_multiply(twist, align[third])
    return twisted


def _turn_about(bone: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[float, float]:
    """Mean angle (radians) about bones (N, 3) from a direction (3,) to others (N, 3), weighted by their length."""
    along = bone / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), 1e-12)
    flat = start - (along @ start)[:, None] * along
    sine = (np.cross(flat, end) * along).sum(-1)
    cosine = (flat * end).sum(-1)
    length = np.hypot(sine, cosine)
    total = complex(cosine.sum(), sine.sum())
    return float(np.angle(total)), abs(total) / max(float(length.sum()), 1e-12)
