"""Where points of a body are measured from, and where a resting body has them.

Points of a finger are measured from their wrist, in the wrist's axes (of the T-pose: +Y the back of the hand, +Z the
thumb's side); every other point from the head, in the axes of the head's heading (+Y up, +Z ahead).
"""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import (
    heading,
    quaternion_conjugate,
    quaternion_rotate,
)
from bodysense.body.skeleton import Skeleton


def local_offset(skeleton: Skeleton, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Offsets (..., P, 3) m of world positions (..., P, 3), by the world rotations (..., J, 4) of the joints."""
    origin, turn = _frames(skeleton, rotation)
    return quaternion_rotate(quaternion_conjugate(turn), position - position[..., origin, :])


def resting_offset(skeleton: Skeleton) -> np.ndarray:
    """(P, 3) m: the offsets of `standing_pose`, the arms hanging and the fingers a little curled."""
    return local_offset(skeleton, *forward_kinematics(standing_pose(skeleton)))


def hand_length(skeleton: Skeleton) -> float:
    """From wrist to the knuckle of the middle finger, mean of both hands, metres: the size of a hand."""
    return float(skeleton.bone_length[skeleton.indices(["left_middle1", "right_middle1"])].mean())


def _frames(skeleton: Skeleton, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Index (P,) of the point that each one is measured from, and the rotation (..., P, 4) of its axes."""
    head = skeleton.index("head")
    at_wrist = skeleton.wrist_of >= 0
    origin = np.where(at_wrist, skeleton.wrist_of, head)
    turn = np.where(at_wrist[:, None], rotation[..., origin, :], heading(rotation[..., head, :])[..., None, :])
    return origin, turn
