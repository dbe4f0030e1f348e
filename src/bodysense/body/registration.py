"""Registration of a hand: the rigid motion from known points to markers (two-hands, 2.2, equations 1 and 2)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bodysense.body.products import MATRIX

# Freedoms that the markers do not determine, such as the turn about a line of two, keep the rotation given before: this
# weight, m², pulls toward it. Three markers 3 cm apart pull with 1e-3 m².
_PULL = 1e-9
_PULLED = _PULL * np.eye(3)
FEW = 4  # hands, up to which scalar code is faster than arrays


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
    bases: list[list[float]]  # as numbers
    loose: bool  # whether a hand has so few markers that a turn may be undetermined
    empty: np.ndarray | None  # (H,) bool, hands without known markers; or None if all have some


def levers(template: np.ndarray, known: np.ndarray) -> Levers:
    """Return the levers of a template (M, 3) or (H, M, 3) m and known (H, M)."""
    count = known.sum(axis=1)
    weight = (known / np.maximum(count, 1)[:, None])[:, None]
    base = weight @ template
    lever = np.concatenate([(template - base).swapaxes(1, 2) * weight, weight], axis=1)
    return Levers(lever, base, base[:, 0].tolist(), bool((count < 4).any()), None if count.all() else count == 0)


def fit(
    levers: Levers, seen: np.ndarray, last: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Run `register`, and return quaternions (H, 4) wxyz first; markers `seen` (H, M, 3) have no NaN."""
    drawn = levers.lever @ seen  # Σ lever is 0, so the markers' mean need not be subtracted
    hands, spread = len(drawn), drawn[:, :3]
    if levers.loose:
        spread += _PULLED if last is None else _PULL * last[0].swapaxes(1, 2)
    turns = _turns(drawn, levers.bases) if hands <= FEW else None
    if turns is None:
        quaternion = np.linalg.eigh((spread.reshape(hands, 9) @ _QUADRATIC).reshape(hands, 4, 4))[1][:, :, 3]
        rotation = to_matrix(quaternion)
        translation = (drawn[:, 3:] - levers.base @ rotation.swapaxes(1, 2))[:, 0]
    else:
        quaternion, rotation, translation = turns[:, :4], turns[:, 4:13].reshape(hands, 3, 3), turns[:, 13:]
    if levers.empty is not None:
        origin = np.zeros(3) if last is None else last[1]
        translation = np.where(levers.empty[:, None], origin, translation)
    return quaternion, rotation, translation


def _turns(drawn: np.ndarray, bases: list[list[float]]) -> np.ndarray | None:
    """Return (H, 16) quaternions, matrices and translations of a few hands, in scalar code.

    Returns None if one is not well determined.

    Theobald, Rapid calculation of RMSDs using a quaternion-based characteristic polynomial, 2005: for a hand or two a
    fraction of the time that eigenvectors take.
    """
    turns = []
    for (one, two, three, middle), base in zip(drawn.tolist(), bases, strict=True):
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = one, two, three
        # The quadratic form, symmetric: (a b c d), (b e f g), (c f h i), (d g i j).
        a, b, c, d = xx + yy + zz, yz - zy, zx - xz, xy - yx
        e, f, g, h, i, j = xx - yy - zz, xy + yx, zx + xz, yy - xx - zz, yz + zy, zz - xx - yy
        size = xx * xx + xy * xy + xz * xz + yx * yx + yy * yy + yz * yz + zx * zx + zy * zy + zz * zz
        linear = -8 * (xx * (yy * zz - yz * zy) - xy * (yx * zz - yz * zx) + xz * (yx * zy - yy * zx))
        s0, s1, s2, s3, s4, s5, c0, c1, c2, c3, c4, c5 = _minors(a, b, c, d, e, f, g, h, i, j)
        constant = s0 * c5 - s1 * c4 + s2 * c3 + s3 * c2 - s4 * c1 + s5 * c0
        # The largest eigenvalue of markers in a plane, of whose spread nothing is linear; of others not far off, and
        # where the polynomial is convex, so that Newton's method comes down to it.
        root = (size + max(size * size - constant, 0.0) ** 0.5) ** 0.5
        for _ in range(30):
            square = root * root
            slope = 4 * root * (square - size) + linear
            if slope <= 0:
                return None
            step = (square * (square - 2 * size) + linear * root + constant) / slope
            root -= step
            if abs(step) < 1e-13 * root:
                break
        a, e, h, j = a - root, e - root, h - root, j - root
        s0, s1, s2, s3, s4, s5, c0, c1, c2, c3, c4, c5 = _minors(a, b, c, d, e, f, g, h, i, j)
        # The adjugate is the eigenvector's outer product with itself: of its columns the longest.
        parts = (e * c5 - f * c4 + g * c3, a * c5 - c * c2 + d * c1, d * s4 - g * s2 + j * s0, c * s3 - f * s1 + h * s0)
        least = min(parts)  # the form is negative: so are the diagonal's parts
        if least == parts[0]:
            column = (least, c * c4 - b * c5 - d * c3, g * s5 - i * s4 + j * s3, h * s4 - f * s5 - i * s3)
        elif least == parts[1]:
            column = (c * c4 - b * c5 - d * c3, least, i * s2 - d * s5 - j * s1, c * s5 - h * s2 + i * s1)
        elif least == parts[2]:
            column = (b * c4 - e * c2 + g * c0, b * c2 - a * c4 - d * c0, least, f * s2 - c * s4 - i * s0)
        else:
            column = (e * c1 - b * c3 - f * c0, a * c3 - b * c1 + c * c0, g * s1 - d * s3 - i * s0, least)
        length = -((column[0] ** 2 + column[1] ** 2 + column[2] ** 2 + column[3] ** 2) ** 0.5)
        if not length < -1e-4 * size * root:
            return None
        w, x, y, z = column
        w, x, y, z = w / length, x / length, y / length, z / length
        a, b, c, d, e, f, g, h, i = matrix_of(w, x, y, z)
        x0, y0, z0 = base
        x1, y1, z1 = middle
        x1, y1, z1 = x1 - a * x0 - b * y0 - c * z0, y1 - d * x0 - e * y0 - f * z0, z1 - g * x0 - h * y0 - i * z0
        turns.append((w, x, y, z, a, b, c, d, e, f, g, h, i, x1, y1, z1))
    return np.array(turns)


def _minors(
    a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float, j: float
) -> tuple[float, ...]:
    """Return the 2 × 2 minors of the upper two rows (columns 01, 02, 03, 12, 13, 23), then of the lower two."""
    return (
        *(a * e - b * b, a * f - c * b, a * g - d * b, b * f - c * e, b * g - d * e, c * g - d * f),
        *(c * g - f * d, c * i - h * d, c * j - i * d, f * i - h * g, f * j - i * g, h * j - i * i),
    )


def matrix_of(w: float, x: float, y: float, z: float) -> tuple[float, ...]:
    """Return the matrix of a unit quaternion, row by row."""
    ww, xx, yy, zz, wx, wy, wz = w * w, x * x, y * y, z * z, 2 * w * x, 2 * w * y, 2 * w * z
    xy, yz, zx = 2 * x * y, 2 * y * z, 2 * z * x
    return ww + xx - yy - zz, xy - wz, zx + wy, xy + wz, ww - xx + yy - zz, yz - wx, zx - wy, yz + wx, ww - xx - yy + zz


def to_matrix(quaternion: np.ndarray) -> np.ndarray:
    """Convert unit quaternions (..., 4) to matrices (..., 3, 3), in few calls."""
    square = quaternion[..., :, None] * quaternion[..., None, :]
    return (square.reshape(*quaternion.shape[:-1], 16) @ MATRIX).reshape(*quaternion.shape[:-1], 3, 3)


def moved(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) of the hand into the world."""
    return points @ rotation.swapaxes(1, 2) + translation[:, None]


def brought_back(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """Transform points (H, M, 3) of the world into the hand: the inverse of `moved`."""
    return (points - translation[:, None]) @ rotation
