"""Axes of drivers (OpenVR, OpenXR): right-handed, +Y up, −Z forward, metres, quaternions x, y, z, w.

The world's axes are ours. Only a device's own forward axis differs, and the order of quaternions.
"""

from __future__ import annotations

import numpy as np

ABOUT_Y = np.array([0.0, 0.0, 1.0, 0.0])  # (4,) wxyz, half a turn: swaps forward +Z and −Z
_OF_ABOUT_Y, _SIGNS = [2, 3, 0, 1], np.array([-1.0, -1.0, 1.0, 1.0])


def turned_about(rotation: np.ndarray) -> np.ndarray:
    """Return rotations (..., 4) wxyz with forward reversed: rotation · `ABOUT_Y`."""
    return rotation[..., _OF_ABOUT_Y] * _SIGNS


def driver_rotation(rotation: np.ndarray) -> np.ndarray:
    """Convert our rotations (..., 4) wxyz, +Z forward, to xyzw, −Z forward."""
    return np.roll(turned_about(rotation), -1, axis=-1)


def from_driver_rotation(rotation: np.ndarray) -> np.ndarray:
    """Convert rotations (..., 4) xyzw, −Z forward, to ours, wxyz, +Z forward."""
    return turned_about(np.roll(rotation, 1, axis=-1))
