"""Axes of drivers (OpenVR, OpenXR): right-handed, +Y up, −Z forward, metres, quaternions x, y, z, w.

The world is ours; only what 'forward' means of a thing differs, and the order of a quaternion.
"""

from __future__ import annotations

import numpy as np

ABOUT_Y = np.array([0.0, 0.0, 1.0, 0.0])  # half a turn: from axes whose +Z is forward to those whose −Z is, and back
_OF_ABOUT_Y, _SIGNS = [2, 3, 0, 1], np.array([-1.0, -1.0, 1.0, 1.0])


def turned_about(rotation: np.ndarray) -> np.ndarray:
    """Rotations (..., 4) wxyz of things whose other end is forward: times `ABOUT_Y`."""
    return rotation[..., _OF_ABOUT_Y] * _SIGNS


def driver_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotations (..., 4) wxyz of ours as x y z w of things whose −Z is forward."""
    return np.roll(turned_about(rotation), -1, axis=-1)


def from_driver_rotation(rotation: np.ndarray) -> np.ndarray:
    """Rotations x y z w (..., 4) of things whose −Z is forward as ours."""
    return turned_about(np.roll(rotation, 1, axis=-1))
