"""Fast products of quaternions (wxyz) by constant matrices: one NumPy call for a whole body.

For loops at run time over single frames. `rotation.py` has the same functions for any array library and batch.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

# fmt: off
LEFT = np.array([  # q @ LEFT is the 4×4 matrix, row by row, that multiplies by q from the left
    [1, 0, 0, 0,  0, 1, 0, 0,  0, 0, 1, 0,  0, 0, 0, 1],
    [0, -1, 0, 0,  1, 0, 0, 0,  0, 0, 0, -1,  0, 0, 1, 0],
    [0, 0, -1, 0,  0, 0, 0, 1,  1, 0, 0, 0,  0, -1, 0, 0],
    [0, 0, 0, -1,  0, 0, -1, 0,  0, 1, 0, 0,  1, 0, 0, 0],
], dtype=float)
MATRIX = np.array([  # (q qᵀ) @ MATRIX is the 3×3 rotation matrix, row by row
    [1, 0, 0, 0, 1, 0, 0, 0, 1],  # ww
    [0, 0, 0, 0, 0, -1, 0, 1, 0],  # wx
    [0, 0, 1, 0, 0, 0, -1, 0, 0],  # wy
    [0, -1, 0, 1, 0, 0, 0, 0, 0],  # wz
    [0, 0, 0, 0, 0, -1, 0, 1, 0],  # xw …
    [1, 0, 0, 0, -1, 0, 0, 0, -1],
    [0, 1, 0, 1, 0, 0, 0, 0, 0],
    [0, 0, 1, 0, 0, 0, 1, 0, 0],
    [0, 0, 1, 0, 0, 0, -1, 0, 0],
    [0, 1, 0, 1, 0, 0, 0, 0, 0],
    [-1, 0, 0, 0, 1, 0, 0, 0, -1],
    [0, 0, 0, 0, 0, 1, 0, 1, 0],
    [0, -1, 0, 1, 0, 0, 0, 0, 0],
    [0, 0, 1, 0, 0, 0, 1, 0, 0],
    [0, 0, 0, 0, 0, 1, 0, 1, 0],
    [-1, 0, 0, 0, -1, 0, 0, 0, 1],
], dtype=float)
# fmt: on
CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return Hamilton products: (..., 4), (..., 4) → (..., 4)."""
    return ((a @ LEFT).reshape(*a.shape, 4) @ b[..., None])[..., 0]


def to_matrix(q: np.ndarray) -> np.ndarray:
    """Convert unit quaternions to matrices: (..., 4) → (..., 3, 3)."""
    square = q[..., :, None] * q[..., None, :]
    return (square.reshape(*q.shape[:-1], 16) @ MATRIX).reshape(*q.shape[:-1], 3, 3)


def rotate(q: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Rotate vectors by unit quaternions: (..., 4), (..., 3) → (..., 3)."""
    return (to_matrix(q) @ vector[..., None])[..., 0]


_YZX, _ZXY = [1, 2, 0], [2, 0, 1]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return vector products (..., 3), without the overhead of NumPy's function."""
    one, other = a.take(_YZX, axis=-1) * b.take(_ZXY, axis=-1), a.take(_ZXY, axis=-1) * b.take(_YZX, axis=-1)
    return one - other


def world_rotation(
    parents: Sequence[int], levels: Sequence[tuple[np.ndarray, np.ndarray]], local: np.ndarray
) -> np.ndarray:
    """Return world rotations of a tree's joints from local ones, (J, 4) → (J, 4); its levels are a skeleton's."""
    world = local.copy()
    for joints, _ in levels[1:]:
        above = [parents[joint] for joint in joints]
        world[joints] = multiply(world[above], local[joints])
    return world


def log(q: np.ndarray) -> np.ndarray:
    """Convert unit quaternions to rotation vectors of at most π radians: (..., 4) → (..., 3)."""
    vector = q[..., 1:] * np.copysign(1.0, q[..., :1])
    sine = np.maximum(np.sqrt(np.einsum("...j,...j->...", vector, vector)), 1e-12)
    return vector * (2 * np.arctan2(sine, np.abs(q[..., 0])) / sine)[..., None]


def exp(rotation_vector: np.ndarray) -> np.ndarray:
    """Convert rotation vectors (radians) to quaternions: (..., 3) → (..., 4)."""
    angle = np.sqrt(np.einsum("...j,...j->...", rotation_vector, rotation_vector))
    q = np.empty((*angle.shape, 4))
    q[..., 0] = np.cos(angle / 2)
    q[..., 1:] = rotation_vector * (np.sin(angle / 2) / np.maximum(angle, 1e-12))[..., None]
    return q
