"""Registration of a hand: the rigid motion from known points to markers (two-hands, 2.2, equations 1 and 2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bodysense.body.products import to_matrix

# Freedoms that the markers do not determine, such as the turn about a line of two, keep the rotation given before: this
# weight, m², pulls toward it. Three markers 3 cm apart pull with 1e-3 m².
_PULL = 1e-9
_PULLED = _PULL * np.eye(3)


def _quadratic() -> np.ndarray:
    """Return (9, 16): from S = Σ template·markerᵀ, row by row, the matrix N whose form qᵀNq the rotation maximises.

    Horn, Closed-form solution of absolute orientation using unit quaternions, 1987.
    """
    form = np.zeros((3, 3, 4, 4))
    for i in range(3):
        form[i, i, 0, 0] = 1.0
        for j in range(3):
            form[i, j, 1 + i, 1 + j] += 1.0
            form[i, j, 1 + j, 1 + i] += 1.0
        form[i, i, 1:, 1:] -= np.eye(3)
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        for sign, (a, b) in ((1.0, (i, j)), (-1.0, (j, i))):
            form[a, b, 0, 1 + k] += sign
            form[a, b, 1 + k, 0] += sign
    return form.reshape(9, 16)


_QUADRATIC = _quadratic()


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
    seen = np.where(known[..., None], markers, 0.0)
    return fit(levers(template, known), seen, last)[1:]


# Indices in a matrix, row by row: its cofactors are one · other − third · fourth.
_ONE, _OTHER = [4, 5, 3, 7, 8, 6, 1, 2, 0], [8, 6, 7, 2, 0, 1, 5, 3, 4]
_THIRD, _FOURTH = [5, 3, 4, 8, 6, 7, 2, 0, 1], [7, 8, 6, 1, 2, 0, 4, 5, 3]


def _cofactors(matrix: np.ndarray) -> np.ndarray:
    """Return cofactors of matrices, row by row: (H, 9, N) → (H, 9, N)."""
    one, other, third, fourth = (matrix.take(places, axis=1) for places in (_ONE, _OTHER, _THIRD, _FOURTH))
    return one * other - third * fourth


def registered_threes(template: np.ndarray, markers: np.ndarray, members: np.ndarray) -> np.ndarray:
    """Move templates (H, M, 3) m onto markers (M, 3) m by three of them at a time, N times: (H, M, 3, N) m.

    `members` (M, N) are 1 for the three, which are not on a line, and else 0. In closed form, in a fifth of the time
    that `register` takes: S has rank 2, so that its singular values s and t have the product |cofactors of S| and the
    sum √(|S|² + 2 s t).
    """
    base, middle = template.swapaxes(1, 2) @ members / 3, markers.T @ members / 3
    joined = (markers[:, :, None] * template[:, :, None]).reshape(len(template), -1, 9).swapaxes(1, 2) @ members
    spread = joined - 3 * (middle[:, None] * base[:, None]).reshape(joined.shape)
    across = _cofactors(spread)
    product = np.sqrt((across * across).sum(axis=1, keepdims=True)) + 1e-30
    normal = across / product  # of rank 1: from one plane's normal to the other's
    total = np.sqrt((spread * spread).sum(axis=1, keepdims=True) + 2 * product)
    turn = (spread + _cofactors(spread + normal) - across) / total + normal
    rotation = turn.reshape(len(turn), 3, 3, -1)
    columns = rotation.swapaxes(1, 2)
    translation = middle - (columns * base[:, :, None]).sum(axis=1)
    moved = template @ columns.reshape(len(turn), 3, -1)
    return moved.reshape(*template.shape, -1) + translation[:, None]


class Levers(NamedTuple):
    """Precomputed registration data of a template and a set of known markers."""

    lever: np.ndarray  # (H, 4, M) weighted, of each marker: from the template's mean, m; and 1
    base: np.ndarray  # (H, 1, 3) m, the template's mean
    loose: bool  # whether a hand has so few markers that a turn may be undetermined
    empty: np.ndarray | None  # (H,) bool, hands without known markers; or None if all have some


def levers(template: np.ndarray, known: np.ndarray) -> Levers:
    """Return the levers of a template (M, 3) or (H, M, 3) m and known (H, M)."""
    count = known.sum(axis=1)
    weight = (known / np.maximum(count, 1)[:, None])[:, None]
    base = weight @ template
    lever = np.concatenate([(template - base).swapaxes(1, 2) * weight, weight], axis=1)
    return Levers(lever, base, bool((count < 4).any()), None if count.all() else count == 0)


def fit(
    levers: Levers, seen: np.ndarray, last: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run `register`, and return quaternions (H, 4) wxyz first; markers `seen` (H, M, 3) have no NaN."""
    drawn = levers.lever @ seen  # Σ lever is 0, so the markers' mean need not be subtracted
    hands, spread = len(drawn), drawn[:, :3]
    if levers.loose:
        spread += _PULLED if last is None else _PULL * last[0].swapaxes(1, 2)
    quaternion = np.linalg.eigh((spread.reshape(hands, 9) @ _QUADRATIC).reshape(hands, 4, 4))[1][:, :, 3]
    rotation = to_matrix(quaternion)
    translation = (drawn[:, 3:] - levers.base @ rotation.swapaxes(1, 2))[:, 0]
    if levers.empty is not None:
        origin = np.zeros(3) if last is None else last[1]
        translation = np.where(levers.empty[:, None], origin, translation)
    return quaternion, rotation, translation


def moved(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) of the hand into the world."""
    return points @ rotation.swapaxes(1, 2) + translation[:, None]


def brought_back(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) of the world into the hand: the inverse of `moved`."""
    return (points - translation[:, None]) @ rotation
