"""Forward kinematics and empty masks, for tests of joined bodies."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics


def places_of(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (T, P, 3) m and world rotations (T, J, 4) as arrays."""
    position, rotation = forward_kinematics(pose)
    return np.asarray(position), np.asarray(rotation)


def no_points(pose: Pose) -> np.ndarray:
    """Return a mask (T, P) of points that are tracked: no point is."""
    return np.zeros((len(pose.root_position), len(pose.skeleton.points)), dtype=bool)
