"""Fingers of left-model hands: placed, and turned to point at their markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from bodysense.body.glove import Glove, hand_size
from bodysense.body.hand import FINGERS
from bodysense.body.products import CONJUGATE, cross, multiply, to_matrix
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError

POINT_COUNT = 21  # of a hand: the wrist, 15 joints, 5 tips
_ONES = np.ones((4, 1))


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


def hand_shape(hands: Sequence[Skeleton], gloves: Sequence[Glove]) -> HandShape:
    """Return the shape of hands with gloves; the point that aims at a marker is the marker's place on the glove."""
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
            bones[place, row, :, 4] = tip + glove.offset[marker] * scale
    first, middle, last = bones[..., 1:2].copy(), bones[..., [2, 2, 2, 5]], bones[..., 3:5].copy()
    return HandShape(bones[..., :1].copy(), last, middle, first, markers)


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
    points, tip = ways[..., 4].copy(), toward[:, :1].copy()
    points[:, 0] = ways[:, 0, :, 5]
    toward[:, 0] = toward[:, 5]
    arc = shortest_arcs(points, toward[:, :5], restraint)
    local[:, 0::3] = multiply(arc, local[:, 0::3])
    ways = to_matrix(arc) @ ways
    joint = ways[:, :1, :, 1]
    arc = shortest_arcs(ways[:, :1, :, 4] - joint, tip - joint, restraint)
    base = local[:, :1]
    local[:, 1:2] = multiply(multiply(base * CONJUGATE, arc), multiply(base, local[:, 1:2]))
    ways[:, :1, :, 2:] = to_matrix(arc) @ (ways[:, :1, :, 2:] - joint[..., None]) + joint[..., None]
    return local, in_order(ways, shape)


def in_order(ways: np.ndarray, shape: HandShape) -> np.ndarray:
    """Return all points (H, 21, 3) m of hands in their axes, from the wrist, given those `reached` from the bases."""
    places = (ways[..., :4] + shape.base).swapaxes(2, 3)  # (H, 5, 4, 3)
    wrist, joints = np.zeros((len(ways), 1, 3)), places[:, :, :3].reshape(-1, 15, 3)
    return np.concatenate([wrist, joints, places[:, :, 3]], axis=1)


def shortest_arcs(u: np.ndarray, v: np.ndarray, restraint: float = 0.0) -> np.ndarray:
    """Return `rotation.shortest_arc` of vectors (H, N, 3), m: (H, N, 4). Opposite vectors are not turned.

    A `restraint` reduces large arcs: at 4 those of 20° by 1 %, of 60° by a third, and more toward 180°, so that the
    arc is continuous in the vectors, even for nearly opposite ones.
    """
    arc = np.concatenate([(u * v) @ _ONES[:3], cross(u, v)], axis=-1)
    # |u|² |v|² = (u·v)² + |u×v|²; the small addition prevents a turn if both vanish.
    length = np.sqrt((arc * arc) @ _ONES) + 1e-15
    if restraint:
        back = length - arc[..., :1]
        arc[..., :1] += restraint * back * back / length
    arc[..., :1] += length
    return arc / np.sqrt((arc * arc) @ _ONES)
