"""Two-bone limbs, bent by the law of cosines: arms that reach a hand, legs that stand on a foot."""

from __future__ import annotations

import numpy as np

from bodysense.body.products import multiply

_STRAIGHT = 0.9999  # of a limb's length: it is never quite straight
_HINGED = 1e-3  # share of its hinge in the axis that a limb bends about: what decides where it is straight


def reach(
    upper: np.ndarray, lower: np.ndarray, target: np.ndarray, rotation: np.ndarray, hinge: np.ndarray
) -> np.ndarray:
    """Turn N limbs so that their ends come to a target, or point at it where it is out of reach.

    A limb bends or straightens in its own plane and swings by the shortest arc toward the target.

    Args:
        upper, lower: (N, 3) m, the bones as they are, in the world.
        target: (N, 3) m, from the limb's start.
        rotation: (2, N, 4) wxyz, world rotations of the joints that carry upper and lower bone.
        hinge: (N, 3) the axis about which a limb bends that is straight, unit, in the world.

    Returns the new rotations (2, N, 4). A limb that is nearly straight may end a millimetre beside its target.
    """
    lines = np.empty((4, len(upper), 3))  # both bones, from end to end of the limb, and where that should lead
    lines[0], lines[1], lines[3] = upper, lower, target
    np.add(upper, lower, out=lines[2])
    length = np.maximum(np.sqrt(np.einsum("kij,kij->ki", lines, lines)), 1e-9)
    first, second, _, wanted = length
    along, toward = lines[2:] / length[2:, :, None]
    # The triangle of both bones and the line between the limb's ends, as it is and as it should be.
    line = length[2:].copy()
    line[1] = np.minimum(np.maximum(wanted, np.abs(first - second) + 1e-4), _STRAIGHT * (first + second))
    side, other = length[:2, None], length[1::-1, None]
    cosine = (side * side + line * line - other * other) / (2 * side * line)
    angle = np.arccos(np.minimum(np.maximum(cosine, -1.0), 1.0))
    half = (angle[:, 1] - angle[:, 0]) * _SENSE

    # A bone that bends about its hinge leads the middle joint to the other side of the line.
    normal = _cross(along, upper) - (_HINGED * first)[:, None] * hinge
    normal -= along * np.einsum("ij,ij->i", along, normal)[:, None]
    normal /= np.maximum(_length(normal), 1e-12)[:, None]
    bend = np.empty((2, len(first), 4))
    bend[..., 0] = np.cos(half)
    bend[..., 1:] = np.sin(half)[..., None] * normal
    swing = _arc(along, toward)
    turned = multiply(np.concatenate([swing, swing]), multiply(bend.reshape(-1, 4), rotation.reshape(-1, 4)))
    turned /= _length(turned)[:, None]
    return turned.reshape(rotation.shape)


def _arc(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The smallest rotation (N, 4) from unit vectors `u` to `v` (N, 3); opposite ones turn about any axis across."""
    q = np.empty((len(u), 4))
    q[:, 0] = 1 + np.einsum("ij,ij->i", u, v)
    q[:, 1:] = _cross(u, v)
    if q[:, 0].min() < 1e-7:
        opposite = q[:, 0] < 1e-7
        across = _cross(u, np.eye(3)[np.abs(u).argmin(axis=1)])
        q[opposite, 0], q[opposite, 1:] = 0.0, across[opposite]
    return q / _length(q)[:, None]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N, 3), (N, 3) → (N, 3); `np.cross` takes several times as long on a few vectors."""
    return a.take(_NEXT, axis=1) * b.take(_AFTER, axis=1) - a.take(_AFTER, axis=1) * b.take(_NEXT, axis=1)


def _length(vector: np.ndarray) -> np.ndarray:
    """(N, n) → (N,)."""
    return np.sqrt(np.einsum("ij,ij->i", vector, vector))


_SENSE = np.array([[0.5], [-0.5]])  # the lower bone turns back by its own corner
_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])
