"""Axes of drivers (OpenVR, OpenXR): right-handed, +Y up, −Z forward, metres, quaternions x, y, z, w.

The world is ours as it stands; only what 'forward' means of a thing differs, and the order of a quaternion.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.rotation import quaternion_multiply

ABOUT_Y = np.array([0.0, 0.0, 1.0, 0.0])  # half a turn: from axes whose +Z is forward to those whose −Z is, and back


def driver_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotations (..., 4) wxyz of ours as x y z w of things whose −Z is forward."""
    return np.roll(quaternion_multiply(rotation, ABOUT_Y), -1, axis=-1)


def from_driver_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotations x y z w (..., 4) of things whose −Z is forward as ours."""
    return quaternion_multiply(np.roll(rotation, 1, axis=-1), ABOUT_Y)
