"""Fingers of left-model hands: from angles to rotations, turned to point at their markers, and placed.

`body.hand.rotations_of` and `body.pose.forward_kinematics` are the slow twins of this loop of run time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from math import sqrt
from typing import Literal

import numpy as np

from bodysense.body.glove import Glove, hand_size
from bodysense.body.hand import FINGERS, FREEDOMS, HAND_JOINTS, joint_bases
from bodysense.body.products import CONJUGATE, LEFT
from bodysense.body.registration import FEW, matrix_of, to_matrix
from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError

Aim = Literal["marker", "last segment"]
POINT_COUNT = 21  # of a hand: the wrist, 15 joints, 5 tips


@dataclass(frozen=True, eq=False)
class HandShape:
    """Constants of H hands in a batch: finger bases, bones, and points that must aim at the markers.

    Bones are columns, as turned one joint after the other. From joint 3: the tip and the aiming point. From joint 2:
    these, joint 3 and the carrier of a middle marker. From the base: these, the base (0) and joint 2.
    """

    base: np.ndarray = field(repr=False)  # (H, 5, 3, 1) m, of each finger, from the wrist
    last: np.ndarray = field(repr=False)  # (H, 5, 3, 2) m, from joint 3
    middle: np.ndarray = field(repr=False)  # (H, 5, 3, 4) m, from joint 2: thrice joint 3, and the middle marker
    first: np.ndarray = field(repr=False)  # (H, 5, 3, 1) m, from the base
    markers: np.ndarray = field(repr=False)  # (6,) the marker for each finger's tip, and the thumb's middle one


def hand_shape(hands: Sequence[Skeleton], gloves: Sequence[Glove], aim: Aim = "marker") -> HandShape:
    """Return the shape of hands with gloves.

    The point that aims at a fingertip's marker is the marker's place on the glove ('marker'), or the middle of the last
    segment ('last segment'; two-hands, section 2.2).
    """
    if aim not in ("marker", "last segment"):
        raise BodysenseError(f"gloves: aim {aim!r}; it is 'marker' or 'last segment'")
    markers = np.array([gloves[0].markers.index(name) for name in (*(f"{f}_tip" for f in FINGERS), "thumb_middle")])
    bones = np.zeros((len(hands), 5, 3, 6))
    for place, (hand, glove) in enumerate(zip(hands, gloves, strict=True)):
        scale = hand_size(hand) / glove.size
        bones[place, 0, :, 5] = glove.offset[markers[5]] * scale
        for row, finger in enumerate(FINGERS):
            names = [f"{finger}1", f"{finger}2", f"{finger}3", f"{finger}_tip"]
            bones[place, row, :, :4] = hand.rest_offset[hand.indices(names)].T
            tip, marker = bones[place, row, :, 3], markers[row]
            if (glove.points[marker], glove.carried_by[marker]) != (names[3], names[2]):
                raise BodysenseError(
                    f"gloves: the marker {glove.markers[marker]!r} is worn at {glove.points[marker]!r}, carried by "
                    f"{glove.carried_by[marker]!r}; it must be at {names[3]!r}, carried by {names[2]!r}"
                )
            bones[place, row, :, 4] = tip + glove.offset[marker] * scale if aim == "marker" else tip / 2
    first, middle, last = bones[..., 1:2].copy(), bones[..., [2, 2, 2, 5]], bones[..., 3:5].copy()
    return HandShape(bones[..., :1].copy(), last, middle, first, markers)


_SIGNS = ((1, 1), (1, -1), (-1, 1), (-1, -1))
# The waves of a joint: cosines, then sines, of half of z + s · y + t · x, its turns about its axes; from its flexion,
# −z, abduction, y, and twist, x: (3, 8), and phases (8,), because a sine is a cosine a quarter later.
WAVES = np.array([[-1, s, t] for s, t in 2 * _SIGNS]).T / 2
QUARTER = np.repeat([0.0, -np.pi / 2], 4)
# (8, 4) from waves to the quaternion of Rz · Ry · Rx, whose products of three are sums of such.
_EULER = np.array([[1, s, -t, s * t] for s, t in _SIGNS] + [[-s * t, t, s, 1] for s, t in _SIGNS]) / 4


@lru_cache(maxsize=1)
def _waves_of_freedoms() -> tuple[np.ndarray, np.ndarray]:
    """Return waves of all joints (26, 120) from the 26 angles, and phases (120,)."""
    waves, column = np.zeros((len(FREEDOMS), 15, 8)), {"flexion": 0, "abduction": 1, "twist": 2}
    for row, freedom in enumerate(FREEDOMS):
        waves[row, HAND_JOINTS.index(freedom.joint) - 1] = WAVES[column[freedom.angle]]
    return waves.reshape(len(FREEDOMS), -1), np.tile(QUARTER, 15)


def turning(calibration: np.ndarray | None = None, axes: np.ndarray | None = None) -> np.ndarray:
    """Return (15, 8, 4), or (H, 15, 8, 4) with a calibration or axes (H, 15, 4): from waves to local rotations.

    A joint's rotation is about · Rz · Ry · Rx · about⁻¹ (`body.hand`), then · calibration: linear in the waves. `axes`
    turn the joints' own axes at rest.
    """
    about = np.array(joint_bases())[:, None]
    if axes is not None:
        about = np.asarray(quaternion_multiply(axes[..., None, :], about))
    turned = quaternion_multiply(quaternion_multiply(about, _EULER), quaternion_conjugate(about))
    return turned if calibration is None else quaternion_multiply(turned, calibration[..., None, :])


def local_rotations(angles: np.ndarray, turning: np.ndarray) -> np.ndarray:
    """Return local rotations (H, 15, 4) of finger joints, of either sign, from angles (H, 26) rad."""
    waves, quarter = _waves_of_freedoms()
    waves = np.cos(angles @ waves + quarter)
    return (waves.reshape(-1, 15, 1, 8) @ turning)[:, :, 0]


def reached(local: np.ndarray, shape: HandShape) -> np.ndarray:
    """Return base (0), joints 2 and 3, tip, aiming point, and middle marker, (H, 5, 3, 6) m from each finger's base."""
    turn = to_matrix(local).reshape(-1, 5, 3, 3, 3)
    ways = np.zeros((len(local), 5, 3, 6))
    ways[..., 3:5] = turn[:, :, 2] @ shape.last
    ways[..., 2:] += shape.middle
    ways[..., 2:] = turn[:, :, 1] @ ways[..., 2:]
    ways[..., 1:] += shape.first
    return turn[:, :, 0] @ ways


def pointed(
    local: np.ndarray, markers: np.ndarray, shape: HandShape, restraint: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Turn every finger at its base by the shortest arc to point at its marker (two-hands, section 2.2; 4.3).

    The thumb turns at its base to point at its middle marker, then at its second joint to point at its tip marker.

    Args:
        local: (H, 15, 4) rotations of finger joints, changed in place.
        markers: (H, 9, 3) m in the hand's axes, from the wrist.
        shape: of the hands.
        restraint: of large arcs (`shortest_arcs`).

    Returns the rotations, and all points of the hands, (H, 21, 3) m in their axes, from the wrist.
    """
    ways = reached(local, shape)
    toward = markers.take(shape.markers, axis=1)
    toward[:, :5] -= shape.base[..., 0]
    toward[:, 5] -= shape.base[:, 0, :, 0]
    if len(local) <= FEW:
        return _pointed_few(local, ways, toward, shape, restraint)
    points, tip = ways[..., 4].copy(), toward[:, :1].copy()
    points[:, 0] = ways[:, 0, :, 5]
    toward[:, 0] = toward[:, 5]
    arc = shortest_arcs(points, toward[:, :5], restraint)
    local[:, 0::3] = product(arc, local[:, 0::3])
    ways = to_matrix(arc) @ ways
    joint = ways[:, :1, :, 1]
    arc = shortest_arcs(ways[:, :1, :, 4] - joint, tip - joint, restraint)
    base = local[:, :1]
    local[:, 1:2] = product(product(base * CONJUGATE, arc), product(base, local[:, 1:2]))
    ways[:, :1, :, 2:] = to_matrix(arc) @ (ways[:, :1, :, 2:] - joint[..., None]) + joint[..., None]
    return local, in_order(ways, shape)


def _pointed_few(
    local: np.ndarray, ways: np.ndarray, toward: np.ndarray, shape: HandShape, restraint: float
) -> tuple[np.ndarray, np.ndarray]:
    """Run the rest of `pointed` on scalars, which is much faster for a hand or two."""
    points = []
    for hand, (fingers, aims, bases, turns) in enumerate(
        zip(ways.tolist(), toward.tolist(), shape.base[..., 0].tolist(), local.tolist(), strict=True)
    ):
        joints, tips = [0.0, 0.0, 0.0], []
        # For each finger: joint 2 (j), joint 3 (k), the tip (t), the aiming point (p), and the middle marker (m).
        for finger, ((_, xj, xk, xt, xp, xm), (_, yj, yk, yt, yp, ym), (_, zj, zk, zt, zp, zm)) in enumerate(fingers):
            x, y, z = bases[finger]
            arc = _arc((xp, yp, zp) if finger else (xm, ym, zm), aims[finger or 5], restraint)
            base = turns[3 * finger] = _times(arc, turns[3 * finger])
            xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix_of(*arc)
            jx, jy, jz = xx * xj + xy * yj + xz * zj, yx * xj + yy * yj + yz * zj, zx * xj + zy * yj + zz * zj
            kx, ky, kz = xx * xk + xy * yk + xz * zk, yx * xk + yy * yk + yz * zk, zx * xk + zy * yk + zz * zk
            tx, ty, tz = xx * xt + xy * yt + xz * zt, yx * xt + yy * yt + yz * zt, zx * xt + zy * yt + zz * zt
            if not finger:
                px, py, pz = xx * xp + xy * yp + xz * zp, yx * xp + yy * yp + yz * zp, zx * xp + zy * yp + zz * zp
                ax, ay, az = aims[0]
                arc = _arc((px - jx, py - jy, pz - jz), (ax - jx, ay - jy, az - jz), restraint)
                w, i, j, k = base
                turns[1] = _times(_times((w, -i, -j, -k), arc), _times(base, turns[1]))
                xx, xy, xz, yx, yy, yz, zx, zy, zz = matrix_of(*arc)
                i, j, k = kx - jx, ky - jy, kz - jz
                kx, ky, kz = jx + xx * i + xy * j + xz * k, jy + yx * i + yy * j + yz * k, jz + zx * i + zy * j + zz * k
                i, j, k = tx - jx, ty - jy, tz - jz
                tx, ty, tz = jx + xx * i + xy * j + xz * k, jy + yx * i + yy * j + yz * k, jz + zx * i + zy * j + zz * k
            joints += (x, y, z, x + jx, y + jy, z + jz, x + kx, y + ky, z + kz)
            tips += (x + tx, y + ty, z + tz)
        local[hand] = turns
        points += joints + tips
    return local, np.array(points).reshape(-1, POINT_COUNT, 3)


def in_order(ways: np.ndarray, shape: HandShape) -> np.ndarray:
    """Return all points (H, 21, 3) m of hands in their axes, from the wrist, given those `reached` from the bases."""
    points = np.zeros((len(ways), POINT_COUNT * 3))
    points[:, 3:] = (ways[..., :4] + shape.base).reshape(-1, 60).take(_ORDER, axis=1)
    return points.reshape(-1, POINT_COUNT, 3)


def _order() -> np.ndarray:
    """Return (60,) indices of joints' coordinates, then tips', among (finger, coordinate, column)."""
    place = np.arange(60).reshape(5, 3, 4).transpose(0, 2, 1)  # finger, column, coordinate
    return np.concatenate([place[:, :3].reshape(-1), place[:, 3].reshape(-1)])


_ORDER = _order()
_HAMILTON = LEFT.reshape(4, 4, 4).swapaxes(1, 2).reshape(16, 4)  # (16, 4): a · b from a ⊗ b, row by row


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return Hamilton products (H, N, 4)."""
    return (a[..., :, None] * b[..., None, :]).reshape(*a.shape[:-1], 16) @ _HAMILTON


def _dot_and_cross() -> np.ndarray:
    """Return (9, 4): scalar and vector product from u ⊗ v, row by row."""
    table = np.zeros((3, 3, 4))
    table[range(3), range(3), 0] = 1.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        table[i, j, 1 + k], table[j, i, 1 + k] = 1.0, -1.0
    return table.reshape(9, 4)


_DOT_AND_CROSS = _dot_and_cross()
_ONES = np.ones((4, 1))


def shortest_arcs(u: np.ndarray, v: np.ndarray, restraint: float = 0.0) -> np.ndarray:
    """Return `rotation.shortest_arc` of vectors (H, N, 3), m: (H, N, 4). Opposite vectors are not turned.

    A `restraint` reduces large arcs: at 4 those of 20° by 1 %, of 60° by a third, and more toward 180°, so that the
    arc is continuous in the vectors, even for nearly opposite ones.
    """
    arc = (u[..., :, None] * v[..., None, :]).reshape(*u.shape[:-1], 9) @ _DOT_AND_CROSS
    # |u|² |v|² = (u·v)² + |u×v|²; the small addition prevents a turn if both vanish.
    length = np.sqrt((arc * arc) @ _ONES) + 1e-15
    if restraint:
        back = length - arc[..., :1]
        arc[..., :1] += restraint * back * back / length
    arc[..., :1] += length
    return arc / np.sqrt((arc * arc) @ _ONES)


def _arc(u: Sequence[float], v: Sequence[float], restraint: float) -> tuple[float, float, float, float]:
    """Return `shortest_arcs` of two vectors."""
    (ux, uy, uz), (vx, vy, vz) = u, v
    w, x, y, z = ux * vx + uy * vy + uz * vz, uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = x * x + y * y + z * z
    length = sqrt(w * w + square) + 1e-15
    back = length - w
    w += restraint * back * back / length + length
    scale = 1 / sqrt(w * w + square)
    return w * scale, x * scale, y * scale, z * scale


def _times(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """Return a Hamilton product."""
    (w, x, y, z), (r, i, j, k) = a, b
    return (
        w * r - x * i - y * j - z * k,
        w * i + x * r + y * k - z * j,
        w * j - x * k + y * r + z * i,
        w * k + x * j - y * i + z * r,
    )
