"""Fingers of left-model hands: from angles to rotations, turned to point at their markers, and placed.

`body.hand.rotations_of` and `body.pose.forward_kinematics` are the slow twins of this loop of run time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import numpy as np

from bodysense.body.glove import MARKERS, Glove, hand_size
from bodysense.body.hand import FINGERS, FREEDOMS, HAND_JOINTS, joint_bases
from bodysense.body.products import LEFT
from bodysense.body.registration import to_matrix
from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError

Aim = Literal["marker", "last segment"]
POINT_COUNT = 21  # of a hand: the wrist, 15 joints, 5 tips


@dataclass(frozen=True, eq=False)
class HandShape:
    """What is constant of H hands in a batch: where bases are, how long bones, what must point at the markers.

    Bones are columns, as turned one joint after the other: the tip and what points, from joint 3; these and joint 3,
    from joint 2; these, the base (0) and joint 2, from the base.
    """

    base: np.ndarray = field(repr=False)  # (H, 5, 3, 1) m, of each finger, from the wrist
    last: np.ndarray = field(repr=False)  # (H, 5, 3, 2) m
    middle: np.ndarray = field(repr=False)  # (H, 5, 3, 1) m
    first: np.ndarray = field(repr=False)  # (H, 5, 3, 1) m
    thumb: np.ndarray = field(repr=False)  # (H, 3, 1) m, the thumb's middle marker, from joint 2
    markers: np.ndarray = field(repr=False)  # (5,) the marker that each finger points at


def hand_shape(hands: Sequence[Skeleton], gloves: Sequence[Glove], aim: Aim = "marker") -> HandShape:
    """The shape of hands, each of which wears a glove.

    What points at a fingertip's marker is where the glove wears it ('marker'), or the middle of the last segment
    ('last segment'; two-hands, section 2.2).
    """
    if aim not in ("marker", "last segment"):
        raise BodysenseError(f"gloves: aim {aim!r}; it is 'marker' or 'last segment'")
    markers = np.array([gloves[0].markers.index(f"{finger}_tip") for finger in FINGERS])
    bones, thumb = np.zeros((len(hands), 5, 3, 5)), np.zeros((len(hands), 3, 1))
    for place, (hand, glove) in enumerate(zip(hands, gloves, strict=True)):
        scale = hand_size(hand) / glove.size
        thumb[place, :, 0] = glove.offset[glove.markers.index("thumb_middle")] * scale
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
    first, middle, last = bones[..., 1:2].copy(), bones[..., 2:3].copy(), bones[..., 3:].copy()
    return HandShape(bones[..., :1], last, middle, first, thumb, markers)


@lru_cache(maxsize=1)
def _half_turns() -> np.ndarray:
    """(26, 45): half of each joint's turns about its z, y and x from the 26 angles."""
    halves = np.zeros((len(FREEDOMS), 15, 3))
    column = {"flexion": (0, -0.5), "abduction": (1, 0.5), "twist": (2, 0.5)}
    for row, freedom in enumerate(FREEDOMS):
        axis, half = column[freedom.angle]
        halves[row, HAND_JOINTS.index(freedom.joint) - 1, axis] = half
    return halves.reshape(len(FREEDOMS), 45)


# fmt: off
_EULER = np.array([  # of cos or sin of z, y and x, multiplied: the quaternion of Rz · Ry · Rx
    [1, 0, 0, 0], [0, 1, 0, 0],  # czcycx, czcysx
    [0, 0, 1, 0], [0, 0, 0, -1],  # czsycx, czsysx
    [0, 0, 0, 1], [0, 0, 1, 0],  # szcycx, szcysx
    [0, -1, 0, 0], [1, 0, 0, 0],  # szsycx, szsysx
], dtype=float)
# fmt: on


def turning(calibration: np.ndarray | None = None, axes: np.ndarray | None = None) -> np.ndarray:
    """(15, 8, 4), or (H, 15, 8, 4) with a calibration or axes (H, 15, 4): from products of sines to local rotations.

    A joint's rotation is about · Rz · Ry · Rx · about⁻¹ (`body.hand`), then · calibration: linear in the products.
    `axes` turn the joints' own axes at rest.
    """
    about = np.array(joint_bases())[:, None]
    if axes is not None:
        about = np.asarray(quaternion_multiply(axes[..., None, :], about))
    turned = quaternion_multiply(quaternion_multiply(about, _EULER), quaternion_conjugate(about))
    return turned if calibration is None else quaternion_multiply(turned, calibration[..., None, :])


def local_rotations(angles: np.ndarray, turning: np.ndarray) -> np.ndarray:
    """Local rotations (H, 15, 4) of finger joints, of either sign, from angles (H, 26) rad; `turning` as above."""
    half = (angles @ _half_turns()).reshape(-1, 15, 3)
    wave = np.empty((*half.shape, 2))
    np.cos(half, out=wave[..., 0])
    np.sin(half, out=wave[..., 1])
    product = wave[:, :, 0, :, None] * wave[:, :, 1, None, :]
    product = product[..., None] * wave[:, :, 2, None, None, :]
    return (product.reshape(-1, 15, 1, 8) @ turning)[:, :, 0]


def reached(local: np.ndarray, shape: HandShape) -> np.ndarray:
    """Base (0), joints 2 and 3, tip and what points, (H, 5, 3, 5) m from each finger's base in the hand's axes."""
    turn = to_matrix(local).reshape(-1, 5, 3, 3, 3)
    ways = np.zeros((len(local), 5, 3, 5))
    ways[..., 3:] = turn[:, :, 2] @ shape.last
    ways[..., 2:] += shape.middle
    ways[..., 2:] = turn[:, :, 1] @ ways[..., 2:]
    ways[..., 1:] += shape.first
    return turn[:, :, 0] @ ways


def pointed(
    local: np.ndarray, markers: np.ndarray, shape: HandShape, restraint: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Every finger turned at its base by the shortest arc to point at its marker (two-hands, section 2.2; 4.3).

    The thumb turns at its base to point at its middle marker, then at its second joint to point at that of its tip.

    Args:
        local: (H, 15, 4) rotations of finger joints, changed in place.
        markers: (H, 9, 3) m in the hand's axes, from the wrist.
        shape: of the hands.
        restraint: of large arcs (`shortest_arcs`).

    Returns the rotations, and of every finger base, joints 2 and 3 and tip, as columns: (H, 5, 3, 4) m in the hand's
    axes, from the wrist.
    """
    ways = reached(local, shape)
    turn = to_matrix(local[:, :2])
    points, toward = ways[..., 4].copy(), markers.take(shape.markers, axis=1) - shape.base[..., 0]
    tip = toward[:, :1].copy()
    points[:, 0] = ways[:, 0, :, 1] + (turn[:, 0] @ turn[:, 1] @ shape.thumb)[..., 0]
    toward[:, 0] = markers[:, _THUMB_MIDDLE] - shape.base[:, 0, :, 0]
    arc = shortest_arcs(points, toward, restraint)
    local[:, 0::3] = product(arc, local[:, 0::3])
    ways = to_matrix(arc) @ ways
    joint = ways[:, :1, :, 1]
    arc = shortest_arcs(ways[:, :1, :, 4] - joint, tip - joint, restraint)
    base = local[:, :1]
    local[:, 1:2] = product(product(base * _BACK, arc), product(base, local[:, 1:2]))
    ways[:, :1, :, 2:] = to_matrix(arc) @ (ways[:, :1, :, 2:] - joint[..., None]) + joint[..., None]
    return local, ways[..., :4] + shape.base


def in_order(ways: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """All points (H, 21, 3) m of hands in the world, from those of `pointed` and the wrists' places."""
    world = rotation[:, None] @ ways
    points = np.zeros((len(ways), POINT_COUNT * 3))
    points[:, 3:] = world.reshape(-1, 60).take(_ORDER, axis=1)
    points = points.reshape(-1, POINT_COUNT, 3)
    points += translation[:, None]
    return points


def _order() -> np.ndarray:
    """(60,) where each coordinate of joints, then tips, lies among (finger, coordinate, column)."""
    place = np.arange(60).reshape(5, 3, 4).transpose(0, 2, 1)  # finger, column, coordinate
    return np.concatenate([place[:, :3].reshape(-1), place[:, 3].reshape(-1)])


_ORDER = _order()
_THUMB_MIDDLE = MARKERS.index("thumb_middle")
_BACK = np.array([1.0, -1.0, -1.0, -1.0])  # of a rotation
_HAMILTON = LEFT.reshape(4, 4, 4).swapaxes(1, 2).reshape(16, 4)  # (16, 4): a · b from a ⊗ b, row by row


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Hamilton products (H, N, 4)."""
    return (a[..., :, None] * b[..., None, :]).reshape(*a.shape[:-1], 16) @ _HAMILTON


def _dot_and_cross() -> np.ndarray:
    """(9, 4): scalar and vector product from u ⊗ v, row by row."""
    table = np.zeros((3, 3, 4))
    table[range(3), range(3), 0] = 1.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        table[i, j, 1 + k], table[j, i, 1 + k] = 1.0, -1.0
    return table.reshape(9, 4)


_DOT_AND_CROSS = _dot_and_cross()
_ONES = np.ones((4, 1))


def shortest_arcs(u: np.ndarray, v: np.ndarray, restraint: float = 0.0) -> np.ndarray:
    """`rotation.shortest_arc` of vectors (H, N, 3), m: (H, N, 4). Opposite ones are not turned.

    A `restraint` holds large arcs back: at 4 those of 20° by 1 %, of 60° by a third, and toward 180° more and more, so
    that the arc changes little where the vectors change little, also where they are nearly opposite.
    """
    arc = (u[..., :, None] * v[..., None, :]).reshape(*u.shape[:-1], 9) @ _DOT_AND_CROSS
    # |u|² |v|² = (u·v)² + |u×v|²; a little more, so that where both vanish nothing turns.
    length = np.sqrt((arc * arc) @ _ONES) + 1e-15
    if restraint:
        back = length - arc[..., :1]
        arc[..., :1] += restraint * back * back / length
    arc[..., :1] += length
    return arc / np.sqrt((arc * arc) @ _ONES)
