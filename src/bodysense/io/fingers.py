"""Fingers that a recording lacks: detection of finger motion, and the relaxed pose of a hand."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import FINGERS
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp

STILL = np.deg2rad(0.5)  # finger joints that turn less than this over a whole recording were not recorded

# Flexion of a hand that hangs or rests, degrees at the first, second and third joint: curled a little, more toward
# the little finger. Fingers flex about Z of the T-pose (left: negative), the thumb closes about Y (left: positive).
_RELAXED = {
    "index": (15.0, 25.0, 15.0),
    "middle": (20.0, 25.0, 15.0),
    "ring": (23.0, 28.0, 18.0),
    "pinky": (25.0, 28.0, 18.0),
    "thumb": (0.0, 10.0, 15.0),
}


def is_finger(joint: str) -> bool:
    """Whether a joint of the default skeleton is one of the 30 finger joints."""
    return joint.rstrip("123").partition("_")[2] in FINGERS


def relaxed_rotation(joint: str) -> np.ndarray:
    """Return the rotation (4,) wxyz of a finger joint, 'left_index1' …, in a relaxed hand."""
    side, _, rest = joint.partition("_")
    angle = np.deg2rad(_RELAXED[rest[:-1]][int(rest[-1]) - 1])
    sign = 1.0 if side == "left" else -1.0
    return quaternion_exp(np.array([0.0, sign * angle, 0.0] if rest[:-1] == "thumb" else [0.0, 0.0, -sign * angle]))


def with_fingers(pose: Pose, missing: Collection[str] = ()) -> tuple[Pose, bool]:
    """Return the pose (T, …) with all fingers, and whether it has finger motion.

    Finger joints `missing` from the recording get the rotations of a relaxed hand. If the others all turn by less than
    0.5°, they were not recorded. They are relaxed, too, if they stay at the identity; another constant hand (a model's
    mean hand) is kept.
    """
    relaxed, moves = relaxed_fingers(pose, missing)
    if not relaxed:
        return pose, moves
    filled = pose.rotation.copy()
    for joint in relaxed:
        filled[..., pose.skeleton.index(joint), :] = relaxed_rotation(joint)
    return Pose(pose.skeleton, pose.root_position, filled), moves


def relaxed_fingers(pose: Pose, missing: Collection[str] = ()) -> tuple[tuple[str, ...], bool]:
    """Return the finger joints that `with_fingers` relaxes, and whether a pose (T, …) has finger motion."""
    joints = pose.skeleton.joints
    present = [index for index, joint in enumerate(joints) if is_finger(joint) and joint not in missing]
    rotation = pose.rotation[..., present, :]
    moves = bool(np.any(geodesic_angle(rotation[:1], rotation) > STILL))
    identity = not np.any(geodesic_angle(rotation, np.array([1.0, 0.0, 0.0, 0.0])) > STILL)
    return (*missing, *((joints[index] for index in present) if identity else ())), moves
