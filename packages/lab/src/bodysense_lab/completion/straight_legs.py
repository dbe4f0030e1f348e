"""Legs that stand straight: recorded people stand and walk with bent knees, people with a headset often do not."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import minimum_filter1d, uniform_filter1d

from bodysense.body.pose import Pose
from bodysense.body.rotation import matrix_to_quaternion, quaternion_to_matrix
from bodysense_lab.completion.limbs import bend_limb, hips_of, limb_of, with_changed_body

_SIDES = ("left", "right")
_STRETCH = 0.999  # of both bones: how far a leg is stretched at most
_MOST, _NONE = 0.05, 0.12  # m: legs are lengthened by at most this; legs that are shorter by more stay bent
_HALF_WINDOW = 0.1  # s over which the rise of the pelvis is smoothed


def straightened_pose(pose: Pose, share: float, rate: float) -> Pose:
    """Return a pose (T,) whose legs are straight, or straighter, where they stand (`straightened`)."""
    return with_changed_body(
        pose, lambda rotation, root: straightened(rotation, root, pose.skeleton.rest_offset, share, rate)
    )


def straightened(
    rotation: np.ndarray, root: np.ndarray, offset: np.ndarray, share: float, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Raise a pelvis until the legs that stand are straight, or by a `share` of it, with the feet unchanged.

    World rotations (T, 22, 4) wxyz and the pelvis's path (T, 3) m of a body with rest offsets (65, 3) m, `rate` in Hz.
    Legs that are far from straight, as in a squat, are unchanged.
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
    rise = np.minimum(*rises)  # the straighter leg stands
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
