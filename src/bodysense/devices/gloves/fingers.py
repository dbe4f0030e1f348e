"""Kinematics of left-model hands: fingers as chains of three joints, posed hands, and fingers aimed at markers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import Glove
from bodysense.body.hands.hand import FINGERS, FINGERTIPS, HAND_JOINTS
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.products import CONJUGATE, multiply, to_matrix
from bodysense.geometry.registration import to_world

_POINTS = (*HAND_JOINTS, *FINGERTIPS)
POINT_COUNT = len(_POINTS)  # points of a hand: the wrist, 15 joints, 5 tips
CHAINS = np.array([[_POINTS.index(f"{name}{end}") for end in ("1", "2", "3", "_tip")] for name in FINGERS])  # (5, 4)
_CARRIERS = np.array([0, 0, 1, 2, 2])  # joint that turns a finger's base, joints 2 and 3, tip and aiming point
_ONES = np.ones((4, 1))
_DOT_CROSS = np.zeros((9, 4))  # (u ⊗ v) @ _DOT_CROSS is u · v, then u × v
_DOT_CROSS[[0, 4, 8], 0] = _DOT_CROSS[[5, 6, 1], [1, 2, 3]] = 1.0
_DOT_CROSS[[7, 2, 3], [1, 2, 3]] = -1.0


class HandPoses(NamedTuple):
    """H posed left-model hands, each in its own mirrored world."""

    root: np.ndarray  # (H, 3) m, of the wrist
    rotation: np.ndarray  # (H, 16, 4) wxyz, parent ← joint, for the wrist world ← wrist; of either sign
    position: np.ndarray  # (H, 21, 3) m, of every point


@dataclass(frozen=True, eq=False)
class HandShape:
    """Constants of H hands in a batch: their bones, and the points that are aimed at the markers."""

    rest: np.ndarray = field(repr=False)  # (H, 21, 3) m, resting offsets
    aim: np.ndarray = field(repr=False)  # (H, 5, 3) m, from each fingertip to its marker, in the last segment's axes
    middle: np.ndarray = field(repr=False)  # (H, 3) m, from the thumb's joint 2 to its middle marker, in its axes
    markers: np.ndarray = field(repr=False)  # (6,) indices of the fingertips' markers and of the thumb's middle one

    @cached_property
    def base(self) -> np.ndarray:
        """(H, 5, 1, 3) m, bases of the fingers."""
        return self.rest[:, CHAINS[:, :1]]

    @cached_property
    def bones(self) -> np.ndarray:
        """(H, 5, 5, 3, 1) m, for each finger 0, its bones, and tip to aiming point, in the axes of the joints."""
        bones = np.concatenate([0 * self.base, self.rest[:, CHAINS[:, 1:]], self.aim[:, :, None]], axis=2)
        return bones[..., None]


def hand_shape(hands: Sequence[Skeleton], gloves: Sequence[Glove]) -> HandShape:
    """Return the shape of hands with gloves; a marker's position on the glove is aimed at the measured marker.

    Raises BodysenseError for gloves without a marker at every fingertip.
    """
    markers = np.array([gloves[0].markers.index(name) for name in (*FINGERTIPS, "thumb_middle")])
    offsets = []
    for hand, glove in zip(hands, gloves, strict=True):
        for finger, marker in zip(FINGERS, markers[:5], strict=True):
            tip, joint = f"{finger}_tip", f"{finger}3"
            if (glove.points[marker], glove.carried_by[marker]) != (tip, joint):
                raise BodysenseError(
                    f"gloves: the marker {glove.markers[marker]!r} is at {glove.points[marker]!r}, carried by "
                    f"{glove.carried_by[marker]!r}; it must be at {tip!r}, carried by {joint!r}"
                )
        offsets.append(glove.offset_on(hand)[markers])
    offset = np.stack(offsets)
    return HandShape(np.stack([hand.rest_offset for hand in hands]), offset[:, :5], offset[:, 5], markers)


def finger_chains(rest: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the fingers' joints and tips (..., 5, 4, 3) m, and the joints' axes (..., 5, 3, 3, 3), in the hand's axes.

    `rest` (..., 21, 3) m are the hands' resting offsets, `local` (..., 15, 4) their joints' rotations.
    """
    axes, bone = _joint_axes(local), rest[..., CHAINS, :]
    bones = (axes @ bone[..., 1:, :, None])[..., 0]
    base = np.broadcast_to(bone[..., :1, :], (*bones.shape[:-2], 1, 3))
    return np.concatenate([base, bones], axis=-2).cumsum(axis=-2), axes


def _joint_axes(local: np.ndarray) -> np.ndarray:
    """Return the axes (..., 5, 3, 3, 3) of the fingers' joints in the hand's, from local rotations (..., 15, 4)."""
    axes = to_matrix(local).reshape(*local.shape[:-2], 5, 3, 3, 3)
    for joint in (1, 2):
        axes[..., joint, :, :] = axes[..., joint - 1, :, :] @ axes[..., joint, :, :]
    return axes


def place_hands(shape: HandShape, root: np.ndarray, rotation: np.ndarray) -> HandPoses:
    """Return hands with wrists at `root` (H, 3) m and rotations `rotation` (H, 16, 4)."""
    points, _ = finger_chains(shape.rest, rotation[:, 1:])
    return HandPoses(root, rotation, to_world(_in_order(points), to_matrix(rotation[:, 0]), root))


def aim_fingers(
    local: np.ndarray, markers: np.ndarray, shape: HandShape, restraint: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Turn every finger at its base by the shortest arc to point at its marker (two-hands, section 2.2; 4.3).

    The thumb turns at its base to point at its middle marker, then at its second joint to point at its tip marker.

    Args:
        local: (H, 15, 4) rotations of finger joints, changed in place.
        markers: (H, 9, 3) m in the hand's axes, from the wrist.
        shape: constants of the hands.
        restraint: reduction of large arcs (`shortest_arcs`).

    Returns:
        The rotations, and all points of the hands (H, 21, 3) m in the hand's axes, from the wrist.
    """
    axes, base = _joint_axes(local), shape.base
    paths = (axes.take(_CARRIERS, axis=2) @ shape.bones)[..., 0].cumsum(axis=2)  # (H, 5, 5, 3) from each finger's base
    toward = markers.take(shape.markers, axis=1)
    first, target = paths[:, :, 4].copy(), toward[:, :5] - base[:, :, 0]
    first[:, 0] = paths[:, 0, 1] + (axes[:, 0, 1] @ shape.middle[..., None])[..., 0]
    tip, target[:, 0] = target[:, :1].copy(), toward[:, 5] - base[:, 0, 0]
    arc = shortest_arcs(first, target, restraint)
    local[:, 0::3] = multiply(arc, local[:, 0::3])
    paths = paths @ to_matrix(arc).swapaxes(-1, -2)
    joint = paths[:, :1, 1]
    arc = shortest_arcs(paths[:, :1, 4] - joint, tip - joint, restraint)
    thumb = local[:, :1]
    local[:, 1:2] = multiply(multiply(thumb * CONJUGATE, arc), multiply(thumb, local[:, 1:2]))
    paths[:, 0, 2:] = to_world(paths[:, 0, 2:] - joint, to_matrix(arc[:, 0]), joint[:, 0])
    return local, _in_order(paths[:, :, :4] + base)


def _in_order(points: np.ndarray) -> np.ndarray:
    """Return all points of hands (H, 21, 3) m, in the order of the skeleton, from points of fingers (H, 5, 4, 3)."""
    wrist = np.zeros((len(points), 1, 3))
    return np.concatenate([wrist, points[:, :, :3].reshape(-1, 15, 3), points[:, :, 3]], axis=1)


def shortest_arcs(u: np.ndarray, v: np.ndarray, restraint: float = 0.0) -> np.ndarray:
    """Return the shortest arcs (H, N, 4) from vectors u to v (H, N, 3) m, as `rotation.shortest_arc` does.

    The arc of opposite vectors is the identity. A `restraint` reduces large arcs, so that they are continuous even for
    nearly opposite vectors: at 4 arcs of 20° by 1 %, of 60° by a third, and more toward 180°.
    """
    arc = (u[..., :, None] * v[..., None, :]).reshape(*u.shape[:-1], 9) @ _DOT_CROSS
    # |u|² |v|² = (u·v)² + |u×v|². The small number gives the identity if both are 0.
    length = np.sqrt((arc * arc) @ _ONES) + 1e-15
    if restraint:
        back = length - arc[..., :1]
        arc[..., :1] += restraint * back * back / length
    arc[..., :1] += length
    return arc / np.sqrt((arc * arc) @ _ONES)
