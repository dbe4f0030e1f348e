"""Unity's axes: left-handed, +Y up, a body faces +Z with its left hand toward −X; metres, quaternions x, y, z, w.

Our bodies face +Z too, with the left hand toward +X: the two worlds are mirror images in the plane x = 0. With this
mirror (and not with z ↦ −z, which is for worlds where bodies face −Z, as OpenXR's) the rest pose is the identity on
both sides, so that rotations of bones mean the same.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_to_euler

_POSITION = np.array([-1.0, 1.0, 1.0])
_ROTATION = np.array([1.0, 1.0, -1.0, -1.0])  # w x y z: in a mirror, turns about the axis across it keep their sense


def unity_position(position: np.ndarray) -> np.ndarray:
    """Convert positions (..., 3) to Unity's axes or back: the mirror is its own inverse."""
    return position * _POSITION


def unity_rotation(rotation: np.ndarray) -> np.ndarray:
    """Convert our quaternions w x y z (..., 4) to Unity's x y z w."""
    return np.roll(rotation * _ROTATION, -1, axis=-1)


def from_unity_rotation(rotation: np.ndarray) -> np.ndarray:
    """Convert Unity's quaternions x y z w (..., 4) to ours w x y z."""
    return np.roll(rotation, 1, axis=-1) * _ROTATION


def unity_euler(rotation: np.ndarray) -> np.ndarray:
    """Convert quaternions (..., 4) to Unity's Euler angles x, y, z (..., 3), degrees, applied about Z, X, then Y."""
    angles = quaternion_to_euler(rotation * _ROTATION, "YXZ")
    return np.rad2deg(angles[..., [1, 0, 2]])


def one_finite_pose(pose: Pose) -> None:
    """Raise BodysenseError unless the pose is one frame of finite numbers, the only valid input of an avatar."""
    shape = np.shape(pose.rotation)
    if len(shape) != 2 or not (np.isfinite(pose.rotation).all() and np.isfinite(pose.root_position).all()):
        raise BodysenseError(f"an avatar takes one finite pose at a time, rotations (J, 4); got {shape}")
