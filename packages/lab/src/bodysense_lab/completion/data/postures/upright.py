"""Upright stance: recorded people of CMU stand with the weight on their toes, other people do not.

In still, relaxed standing CMU's people have hips 11 cm and heads 20 cm ahead of the ankles. Six other motion captures
have 5 and 7 cm. Walking is nearly right. The remedy moves the pelvis back over planted feet, and solves the legs anew.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from bodysense.geometry.rotation import matrix_to_quaternion, quaternion_to_matrix
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.postures.limbs import bend_limb, hips_of, limb_of

_SIDES = ("left", "right")
HIPS_AHEAD = 0.04  # m at a rest height of the pelvis of `_TALL`; hips of other people are 3 to 6 cm ahead of the ankles
_MOST = 0.09  # m, largest shift
_TALL = 0.95  # m
_RISE = 0.3  # rise of the pelvis, as a share of the shift; the legs become straighter
_LONGEST_LEG = 0.998  # longest leg, as a share of the lengths of its bones
_STILL, _WALKING = 0.15, 0.5  # m/s of the pelvis; the share of the shift falls from 1 to `_IN_WALKING` between them
_IN_WALKING = 0.25  # a shift by the full amount in walking takes away the extension of the hip
_LOW, _UPRIGHT = 0.80, 0.90  # share of the rest height of the pelvis; the shift grows from 0 to 1 between them
_WINDOW = 0.5  # s, smooths the share of the shift
_STILL_FRAMES = 24  # frames in which a person must stand still for a measurement of the stance
_STRAIGHTEST = 0.4  # quantile of the still frames, by the height of the pelvis, from which the stance is measured


def stance_shifts(corpus: Corpus) -> np.ndarray:
    """Return the shift (C,) m, 0 or negative, along the facing direction that makes each clip's person upright.

    It is measured once for each person, in the straightest of all frames in which they stand still.
    """
    people = np.array([str(name).partition("/")[0] for name in corpus.name])
    shifts = np.zeros(len(corpus))
    for person in np.unique(people):
        clips = np.flatnonzero(people == person)
        height, ahead = (
            np.concatenate(parts) for parts in zip(*(_stance(corpus, int(clip)) for clip in clips), strict=True)
        )
        if len(height) < _STILL_FRAMES:
            continue
        straight = height >= np.quantile(height, 1 - _STRAIGHTEST)
        shifts[clips] = np.clip(HIPS_AHEAD - np.median(ahead[straight]), -_MOST, 0.0)
    return shifts


def _stance(corpus: Corpus, clip: int) -> tuple[np.ndarray, np.ndarray]:
    """Return relative heights of the pelvis and positions of the hips ahead of the ankles, m, of still frames (N,)."""
    first, count, rate = int(corpus.start[clip]), int(corpus.length[clip]), float(corpus.rate[clip])
    root, offset = corpus.root[first : first + count].astype(float), corpus.rest_offset[clip].astype(float)
    if count < 3:
        return np.zeros(0), np.zeros(0)
    speed = np.linalg.norm(np.gradient(root[:, [0, 2]], axis=0), axis=-1) * rate
    still = np.flatnonzero((speed < 0.1) & (root[:, 1] > 0.9 * offset[0, 1]))
    matrix = quaternion_to_matrix(corpus.rotation[first + still].astype(float))
    hips, ankles = _legs(matrix, root[still], offset)
    apart = np.abs(((ankles[:, 0] - ankles[:, 1]) * _facing(matrix)).sum(axis=-1))
    level = (np.abs(ankles[..., 1] - ankles[..., 1].min(axis=1, keepdims=True)) < 0.03).all(axis=1) & (apart < 0.15)
    ahead = ((hips - ankles).mean(axis=1) * _facing(matrix)).sum(axis=-1) * _TALL / offset[0, 1]
    return root[still[level], 1] / offset[0, 1], ahead[level]


def set_upright(
    rotation: np.ndarray, root: np.ndarray, offset: np.ndarray, shift: float, planted: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Move the pelvis along the facing direction over unchanged feet, and raise it while the legs allow.

    The whole shift applies while both feet are planted and the body stands, a quarter of it in walking, none when the
    body is seated or low.

    Args:
        rotation: (T, 22, 4) wxyz, world.
        root: (T, 3) m, path of the pelvis.
        offset: (65, 3) m, rest offsets.
        shift: m, forward; negative values move the pelvis backward.
        planted: (T, 2) bool, whether each foot is on the floor and still.
        rate: Hz.

    Returns:
        Rotations (T, 22, 4) and the pelvis's path (T, 3) m.
    """
    if len(root) < 3:
        return rotation, root
    before = quaternion_to_matrix(rotation.astype(float))
    speed = np.linalg.norm(np.gradient(root[:, [0, 2]], axis=0), axis=-1) * rate
    walking = np.clip((speed - _STILL) / (_WALKING - _STILL), 0.0, 1.0)
    walking = np.maximum(walking, 1.0 - planted.all(axis=1))
    standing = np.clip((root[:, 1] / offset[0, 1] - _LOW) / (_UPRIGHT - _LOW), 0.0, 1.0)
    window = 2 * max(1, round(_WINDOW * rate / 2)) + 1
    share = uniform_filter1d((1 - (1 - _IN_WALKING) * walking) * standing, window, mode="nearest")
    share = uniform_filter1d(share, window, mode="nearest")[:, None]
    moved = share * shift * _facing(before)
    hips, ankles = _legs(before, root, offset)
    limbs = [limb_of("leg", side, offset) for side in _SIDES]
    rises = []
    for k, limb in enumerate(limbs):
        reach = ankles[:, k] - hips[:, k] - moved
        length = _LONGEST_LEG * (np.linalg.norm(limb.upper) + np.linalg.norm(limb.lower))
        down = np.sqrt(np.maximum(length**2 - reach[:, 0] ** 2 - reach[:, 2] ** 2, 0.0))
        rises.append(reach[:, 1] + down)  # negative: the leg is too short for the shifted hip
    rise = np.minimum(share[:, 0] * abs(shift) * _RISE, np.minimum(*rises))
    rise = np.maximum(uniform_filter1d(rise, window, mode="nearest"), -abs(shift))
    moved[:, 1] += np.minimum(rise, np.maximum(np.minimum(*rises), 0.0))
    after = before.copy()
    for k, limb in enumerate(limbs):
        front = before[:, limb.first] @ limb.front
        after[:, limb.first], after[:, limb.second] = bend_limb(limb, hips[:, k] + moved, ankles[:, k], front)
    return matrix_to_quaternion(after), root + moved


def _legs(matrix: np.ndarray, root: np.ndarray, offset: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return hips and ankles (T, 2, 3) m for world rotations (T, 22, 3, 3)."""
    hips = root[:, None] + hips_of(matrix[:, 0], offset)
    limbs = [limb_of("leg", side, offset) for side in _SIDES]
    ends = [matrix[:, limb.first] @ limb.upper + matrix[:, limb.second] @ limb.lower for limb in limbs]
    return hips, hips + np.stack(ends, axis=1)


def _facing(matrix: np.ndarray) -> np.ndarray:
    """Return the horizontal unit vector (T, 3) that the pelvis faces."""
    ahead = matrix[:, 0, :, 2] * [1.0, 0.0, 1.0]
    return ahead / np.maximum(np.linalg.norm(ahead, axis=-1, keepdims=True), 1e-6)
