"""Registration of a hand: the rigid motion from known points to markers (two-hands, 2.2, equations 1 and 2)."""

from __future__ import annotations

import numpy as np

from bodysense.geometry.products import MATRIX, to_matrix

# m², weight of the last rotation. It decides degrees of freedom that the markers do not determine, such as the rotation
# about the line through two of them. Three markers 3 cm apart have the weight 1e-3 m².
_PULL = 1e-9
_IDENTITY = np.eye(3)


def register(
    template: np.ndarray,
    markers: np.ndarray,
    known: np.ndarray,
    last: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (H, 3, 3) and translations (H, 3) m with markers ≈ rotation · template + translation.

    Least squares over the known markers, always a proper rotation: Kabsch's problem, solved with quaternions. If the
    markers do not determine the rotation, because there are only one or two or all are on a line, the result is the
    solution closest to `last`. Without known markers the result is `last`.

    Args:
        template: (M, 3) or (H, M, 3) m, points on the hand.
        markers: (H, M, 3) m; arbitrary if unknown.
        known: (H, M) bool.
        last: rotations and translations of the frame before; by default the identity at the origin.
    """
    return fit(template, markers, known, last)[1:]


def fit(
    template: np.ndarray,
    markers: np.ndarray,
    known: np.ndarray,
    last: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the rotations as quaternions (H, 4) wxyz, then the results of `register`."""
    hands, count = len(markers), known.sum(axis=1)
    weight = (known / np.maximum(count, 1)[:, None])[:, None]  # (H, 1, M)
    seen = np.where(known[..., None], markers, 0.0)
    base, middle = weight @ template, weight @ seen
    spread = (seen.swapaxes(1, 2) * weight) @ (template - base)  # Σ (template − base) is 0: the markers' mean cancels
    fewest = count.min(initial=4)
    if fewest < 4:
        spread += _PULL * (_IDENTITY if last is None else last[0])
    # The rotation maximises Σ rotation · spread = qᵀ N q (Horn, Closed-form solution of absolute orientation, 1987).
    form = (spread.reshape(hands, 9) @ MATRIX.T).reshape(hands, 4, 4)
    quaternion = np.linalg.eigh(form)[1][:, :, 3]
    rotation = to_matrix(quaternion)
    translation = (middle - base @ rotation.swapaxes(1, 2))[:, 0]
    if fewest == 0:
        translation = np.where(count[:, None] > 0, translation, 0.0 if last is None else last[1])
    return quaternion, rotation, translation


def to_world(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) from the hand's frame to the world."""
    return points @ rotation.swapaxes(1, 2) + translation[:, None]


def to_hand(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) from the world to the hand's frame: the inverse of `to_world`."""
    return (points - translation[:, None]) @ rotation
