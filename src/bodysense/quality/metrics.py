"""Metrics of positions in metres. The unit of each result is in its docstring."""

from __future__ import annotations

import numpy as np

from bodysense.geometry.rotation import geodesic_angle


def vector_length(vector: np.ndarray) -> np.ndarray:
    """Return the length over the last axis. Equals `np.linalg.norm` to the bit, and is faster for few columns."""
    squared = vector[..., 0] ** 2
    for k in range(1, vector.shape[-1]):
        squared = squared + vector[..., k] ** 2
    return np.sqrt(squared)


def joint_error(predicted: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return the Euclidean error of every point, cm: (..., P, 3), (..., P, 3) → (..., P)."""
    return 100 * vector_length(predicted - truth)


def mpjpe(error: np.ndarray) -> float:
    """Return the mean per-joint position error over frames and joints, cm; NaN for an empty array."""
    return float(error.mean()) if error.size else float("nan")


def rotation_error(predicted: np.ndarray, truth: np.ndarray) -> float:
    """Return the mean geodesic angle, degrees: (..., J, 4), (..., J, 4) wxyz."""
    return float(np.degrees(geodesic_angle(predicted, truth)).mean())


def velocity_error(predicted: np.ndarray, truth: np.ndarray, frame_rate: float) -> float:
    """Return the mean error of velocities by backward differences, cm/s: (T, P, 3), (T, P, 3)."""
    return float(100 * vector_length(np.diff(predicted - truth, axis=0)).mean() * frame_rate)


def jitter(position: np.ndarray, frame_rate: float) -> float:
    """Return the mean jerk, 10² m/s³: (T, P, 3). It depends on the frame rate; compare it with that of the truth."""
    return float(vector_length(np.diff(position, 3, axis=0)).mean() * frame_rate**3 / 100)


def acceleration(position: np.ndarray, frame_rate: float) -> np.ndarray:
    """Return the magnitude of the second difference, m/s²: (T, P, 3) → (T - 2, P)."""
    return vector_length(np.diff(position, 2, axis=0)) * frame_rate**2


def foot_skate(predicted: np.ndarray, truth: np.ndarray, frame_rate: float) -> float:
    """Return the mean horizontal speed of foot points while their truth is in contact, cm/s: (T, P, 3), (T, P, 3).

    `on_floor` defines contact.
    """
    contact = on_floor(truth, frame_rate)
    slide = 100 * vector_length(np.diff(predicted, axis=0)[..., [0, 2]]) * frame_rate
    return float(slide[contact].mean()) if contact.any() else float("nan")


def on_floor(truth: np.ndarray, frame_rate: float) -> np.ndarray:
    """Return which points (T, P, 3) are lower than 5 cm and slower than 10 cm/s since the frame before: (T − 1, P)."""
    speed = vector_length(np.diff(truth, axis=0)) * frame_rate
    return (truth[1:, :, 1] < 0.05) & (speed < 0.10)


def floor_penetration(position: np.ndarray) -> float:
    """Return the mean depth of foot points under the floor, cm: (T, P, 3)."""
    return float(100 * np.maximum(-position[..., 1], 0).mean())
