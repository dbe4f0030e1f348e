"""Rotations of joints for tests of rigs."""

from __future__ import annotations

import numpy as np

from bodysense.geometry.rotation import quaternion_exp


def about(axis: str, degrees: float) -> np.ndarray:
    """Return a rotation about X, Y or Z as a quaternion (4,), w first."""
    vector = np.zeros(3)
    vector["XYZ".index(axis)] = np.deg2rad(degrees)
    return quaternion_exp(vector)


def both(part: str, axis: str, degrees: float) -> dict[str, np.ndarray]:
    """Return a turn of the left joint and its mirror image for the right one."""
    return {f"left_{part}": about(axis, degrees), f"right_{part}": about(axis, degrees if axis == "X" else -degrees)}
