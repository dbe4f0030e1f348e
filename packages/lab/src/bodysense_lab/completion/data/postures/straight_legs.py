"""Straightening of standing legs: recorded people stand with bent knees, people with a headset often do not."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from bodysense.body.pose import Pose
from bodysense.geometry.rotation import matrix_to_quaternion, quaternion_to_matrix
from bodysense_lab.completion.data.postures.limbs import bend_limb, hips_of, limb_of, with_changed_body

_SIDES = ("left", "right")
_STRETCH = 0.999  # longest leg, as a share of the lengths of its bones
_MOST, _NONE = 0.05, 0.12  # m; legs are lengthened by at most the first; legs shorter by more than the second stay bent
_HALF_WINDOW = 0.1  # s, half the window that smooths the rise of the pelvis


def straightened_pose(pose: Pose, share: float, rate: float) -> Pose:
    """Return a pose (T,) whose standing legs are straight or straighter; see `straightened`."""
    return with_changed_body(
        pose, lambda rotation, root: straightened(rotation, root, pose.skeleton.rest_offset, share, rate)
    )


def straightened(
    rotation: np.ndarray, root: np.ndarray, offset: np.ndarray, share: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Raise the pelvis until the standing leg is straight, or by a share of that rise, over unchanged feet.

    Legs that are far from straight, as in a squat, are unchanged.

    Args:
        rotation: (T, 22, 4) wxyz, world.
        root: (T, 3) m, path of the pelvis.
        offset: (65, 3) m, rest offsets.
        share: share of the rise, 0 to 1.
        rate: Hz.

    Returns:
        Rotations (T, 22, 4) and the pelvis's path (T, 3) m.
    """
    before = quaternion_to_matrix(rotation.astype(float))
    hips = root[:, None] + hips_of(before[:, 0], offset)
    limbs = [limb_of("leg", side, offset) for side in _SIDES]
    ankles = [
        hips[:, k] + before[:, limb.first] @ limb.upper + before[:, limb.second] @ limb.lower
        for k, limb in enumerate(limbs)
    ]
    rises = []
    for k, limb in enumerate(limbs):
        way = ankles[k] - hips[:, k]
        length = _STRETCH * (np.linalg.norm(limb.upper) + np.linalg.norm(limb.lower))
        down = np.sqrt(np.maximum(length**2 - way[:, 0] ** 2 - way[:, 2] ** 2, 0.0))
        rises.append(np.maximum(way[:, 1] + down, 0.0))
    rise = np.minimum(*rises)  # the straighter leg is the one that stands
    rise = np.minimum(rise, _MOST) * np.clip((_NONE - rise) / (_NONE - _MOST), 0.0, 1.0)
    window = 2 * round(_HALF_WINDOW * rate) + 1
    rise = share * uniform_filter1d(minimum_filter1d(rise, window), window)
    raised = np.array([0.0, 1.0, 0.0]) * rise[:, None]
    after = before.copy()
    for k, limb in enumerate(limbs):
        front = before[:, limb.first] @ limb.front
        after[:, limb.first], after[:, limb.second] = bend_limb(limb, hips[:, k] + raised, ankles[k], front)
    after[rise == 0] = before[rise == 0]
    return matrix_to_quaternion(after), root + raised
