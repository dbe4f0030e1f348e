"""Local offsets of a body's points, and those of a resting body.

Points of fingers are relative to their wrist, in the wrist's axes (in the T-pose +Y is the back of the hand, +Z the
thumb's side). All other points are relative to the head, in the axes of its heading (+Y up, +Z ahead).
"""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import (
    heading,
    quaternion_conjugate,
    quaternion_rotate,
)


def local_offset(skeleton: Skeleton, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Return local offsets (..., P, 3) m from world positions (..., P, 3) and joint rotations (..., J, 4)."""
    origin, turn = _frames(skeleton, rotation)
    return quaternion_rotate(quaternion_conjugate(turn), position - position[..., origin, :])


def resting_offset(skeleton: Skeleton) -> np.ndarray:
    """Return the local offsets (P, 3) m of `standing_pose`: hanging arms and slightly curled fingers."""
    return local_offset(skeleton, *forward_kinematics(standing_pose(skeleton)))


def hand_length(skeleton: Skeleton) -> float:
    """Return the size of the hands: distance from wrist to knuckle of the middle finger, mean of both hands, metres."""
    return float(skeleton.bone_length[skeleton.indices(["left_middle1", "right_middle1"])].mean())


def _frames(skeleton: Skeleton, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the index (P,) of each point's origin, and the rotation (..., P, 4) of its axes."""
    head = skeleton.index("head")
    at_wrist = skeleton.wrist_of >= 0
    origin = np.where(at_wrist, skeleton.wrist_of, head)
    turn = np.where(at_wrist[:, None], rotation[..., origin, :], heading(rotation[..., head, :])[..., None, :])
    return origin, turn
