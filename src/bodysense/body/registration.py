"""Registration of a hand: the rigid motion from known points to markers (two-hands, 2.2, equations 1 and 2)."""

from __future__ import annotations

import numpy as np

from bodysense.body.products import MATRIX, to_matrix

# Freedoms that the markers do not determine, such as the turn about a line of two, keep the rotation given before: this
# weight, m², pulls toward it. Three markers 3 cm apart pull with 1e-3 m².
_PULL = 1e-9
_STILL = np.eye(3)


def register(
    template: np.ndarray,
    markers: np.ndarray,
    known: np.ndarray,
    last: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (H, 3, 3) and translations (H, 3) m with markers ≈ rotation · template + translation.

    The least squares over the known markers, always a proper rotation: Kabsch's problem, solved with quaternions.
    If two markers, one, or points of a line leave a turn undetermined, it is the one closest to `last`; without known
    markers, the result is `last`.

    Args:
        template: (M, 3) or (H, M, 3) m, points on the hand.
        markers: (H, M, 3) m; arbitrary where unknown.
        known: (H, M) bool.
        last: the rotations and translations before; by default the identity at the origin.
    """
    return fit(template, markers, known, last)[1:]


def fit(
    template: np.ndarray,
    markers: np.ndarray,
    known: np.ndarray,
    last: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run `register`, and return the rotations as quaternions (H, 4) wxyz as well, first."""
    hands, count = len(markers), known.sum(axis=1)
    weight = (known / np.maximum(count, 1)[:, None])[:, None]  # (H, 1, M)
    seen = np.where(known[..., None], markers, 0.0)
    base, middle = weight @ template, weight @ seen
    spread = (seen.swapaxes(1, 2) * weight) @ (template - base)  # Σ (template − base) is 0: no mean of markers
    fewest = count.min(initial=4)
    if fewest < 4:
        spread += _PULL * (_STILL if last is None else last[0])
    # The rotation maximises Σ rotation · spread = qᵀ N q (Horn, Closed-form solution of absolute orientation, 1987).
    form = (spread.reshape(hands, 9) @ MATRIX.T).reshape(hands, 4, 4)
    quaternion = np.linalg.eigh(form)[1][:, :, 3]
    rotation = to_matrix(quaternion)
    translation = (middle - base @ rotation.swapaxes(1, 2))[:, 0]
    if fewest == 0:
        translation = np.where(count[:, None] > 0, translation, 0.0 if last is None else last[1])
    return quaternion, rotation, translation


def to_world(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) of the hand into the world."""
    return points @ rotation.swapaxes(1, 2) + translation[:, None]


def to_hand(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) of the world into the hand: the inverse of `to_world`."""
    return (points - translation[:, None]) @ rotation
