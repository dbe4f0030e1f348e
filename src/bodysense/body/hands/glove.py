"""Gloves: markers on a hand. The standard glove has nine, three of them on its back (two-hands, 2.1 and 2.2)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from bodysense.body.hands.glove_set import GloveSet, standard_set
from bodysense.body.hands.hand import HAND_JOINTS, Side, glove_marker, hand_skeleton, joint_bases
from bodysense.body.pose import Pose, as_like, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import Array, quaternion_multiply, quaternion_rotate

# The standard set, in the order of the paper's release. The first three, the alignment markers, are on the back of the
# hand.
MARKERS = standard_set().names
ALIGNMENT = standard_set().on_hand
_SIZE = 0.1953  # m, size of the hand to which a marker set's offsets refer


@dataclass(frozen=True, eq=False)
class Glove:
    """Positions of M markers: each has an `offset` from a point of the hand, in the frame of its carrying joint.

    Offsets are for a hand of `size` m from wrist to tip of the middle finger; on other hands they scale.
    """

    markers: tuple[str, ...]
    points: tuple[str, ...]  # points of the hand's skeleton
    carried_by: tuple[str, ...]  # joints of the hand's skeleton
    offset: np.ndarray = field(repr=False)  # (M, 3) m
    size: float

    def __post_init__(self) -> None:
        count = len(self.markers)
        if not (len(self.points) == len(self.carried_by) == len(self.offset) == count):
            raise BodysenseError(
                f"glove: {count} markers need as many points, joints and offsets, "
                f"but got {len(self.points)}, {len(self.carried_by)} and {len(self.offset)}"
            )

    def offset_on(self, hand: Skeleton) -> np.ndarray:
        """Return the offsets (M, 3) m, scaled to the size of a hand."""
        return self.offset * (hand_size(hand) / self.size)


@lru_cache(maxsize=1)
def default_glove() -> Glove:
    """Return the standard set on the default hand.

    Markers on the back of the hand are placed as in the paper's release. Those of fingers are at fingertips and the
    thumb's middle joint; they differ from the release's by no more than the hands of two people do.
    """
    hand = hand_skeleton(default_skeleton(), "left")
    return glove_of(standard_set(), hand)


def glove_of(marker_set: GloveSet, hand: Skeleton, axes: np.ndarray | None = None) -> Glove:
    """Return the glove of a marker set on a hand.

    `axes` (15, 4) wxyz rotate the joints' axes at rest from the default hand's, which are used if omitted.
    """
    turn = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(HAND_JOINTS) - 1, 4)) if axes is None else axes
    size = hand_size(hand)
    own = np.array([marker.offset for marker in marker_set.markers]) * (size / _SIZE)
    points, carriers = zip(*((marker.near, marker.segment) for marker in marker_set.markers), strict=True)
    return Glove(marker_set.names, points, carriers, marker_offsets(marker_set, hand.rest_offset, turn, own), size)


def marker_offsets(marker_set: GloveSet, rest: np.ndarray, axes: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Return offsets (..., M, 3) m of a set's markers from their points, in the frames of their carrying joints.

    Args:
        marker_set: the set.
        rest: (..., 21, 3) m, resting offsets of the hands.
        axes: (..., 15, 4) wxyz, rotations of the joints' axes at rest from the default hand's.
        own: (..., M, 3) m, offsets of the markers in the axes of their segments.
    """
    hand = hand_skeleton(default_skeleton(), "left")
    carrier = hand.indices([marker.segment for marker in marker_set.markers])
    bone = np.array([hand.parents.index(joint) for joint in carrier])
    along = np.array([[marker.along] for marker in marker_set.markers])
    turns = np.asarray(quaternion_multiply(axes, np.asarray(joint_bases())))
    wrist = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*turns.shape[:-2], 1, 4))
    turn = np.concatenate([wrist, turns], axis=-2)[..., carrier, :]
    return along * rest[..., bone, :] + np.asarray(quaternion_rotate(turn, own))


def hand_size(hand: Skeleton) -> float:
    """Return the distance (m) from the wrist to the tip of the middle finger at rest."""
    position = hand.path @ hand.rest_offset
    return float(np.linalg.norm(position[hand.index("middle_tip")]))


def marker_positions(glove: Glove, pose: Pose, offset: Array | None = None) -> Array:
    """Return markers (..., M, 3) m of a posed hand; `offset` (..., M, 3) m, unscaled, replaces the glove's.

    Markers on the back of the hand refer to the bases of the fingers, which are fixed in the hand.
    """
    hand = pose.skeleton
    position, world = forward_kinematics(pose)
    points, carriers = hand.indices(glove.points), hand.indices(glove.carried_by)
    if offset is None:
        offset = as_like(glove.offset_on(hand), position)
    return position[..., points, :] + quaternion_rotate(world[..., carriers, :], offset)


def template(glove: Glove, hand: Skeleton) -> np.ndarray:
    """Return markers (M, 3) m on a flat hand with its wrist at the origin, the template of registration."""
    rest = np.zeros((len(hand.joints), 4))
    rest[:, 0] = 1.0
    return np.asarray(marker_positions(glove, Pose(hand, np.zeros(3), rest)))


@lru_cache(maxsize=64)
def glove_points(hand: str) -> tuple[str, ...]:
    """Return the standard markers of a hand as points of an observation: 'left_glove_pinky_base' … for 'left'."""
    side_of(hand)
    return tuple(f"{hand}_glove_{marker}" for marker in MARKERS)


@lru_cache(maxsize=4096)
def standard_marker(point: str) -> tuple[str, str] | None:
    """Return hand and marker as `glove_marker` does, or None if the marker is not of the standard set."""
    found = glove_marker(point)
    return found if found and found[1] in MARKERS else None


def side_of(hand: str) -> Side:
    """Return the side of a hand named 'left', 'right', 'left2' … Raises BodysenseError for other names."""
    for side in ("left", "right"):
        if hand.startswith(side):
            return side
    raise BodysenseError(f"glove: the hand {hand!r} is neither left nor right; begin its name with 'left' or 'right'")
