"""One hand: its skeleton, taken from a body's, and its 26 degrees of freedom (two-hands, Figure 9).

The left hand is the model. A right hand is mirrored at the plane x = 0 and handled as a left hand. In the rest pose a
left hand is flat, fingers toward +x, back of the hand up (+y), thumb forward (+z); the wrist is the root.

Every joint of a finger turns by R = Rz(−flexion) · Ry(abduction) · Rx(twist) in its own axes: x along the bone, and a
finger flexes about −z. Base joints have all three angles, the thumb's middle joint has flexion and abduction, all other
joints have flexion only: 5 · 3 + 1 + 2 + 8 = 26.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np

from bodysense.body.pose import Pose, as_like, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    Array,
    array_namespace,
    matrix_to_quaternion,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
)

Side = Literal["left", "right"]
FINGERS = ("thumb", "index", "middle", "ring", "pinky")  # in the order of the hand
HAND_JOINTS = ("wrist", *(f"{finger}{k}" for finger in FINGERS for k in (1, 2, 3)))
FINGERTIPS = tuple(f"{finger}_tip" for finger in FINGERS)
Angle = Literal["flexion", "abduction", "twist"]


@dataclass(frozen=True)
class Freedom:
    """One degree of freedom: an angle of a joint and its range, degrees."""

    joint: str
    angle: Angle
    low: float
    high: float


# Adults' ranges: fingers flex by 90°, 100° and 90° and extend by 45°, the thumb by 50° and 80° (American Academy of
# Orthopaedic Surgeons, Joint Motion, 1965); fingers spread by 15° to either side (Lin, Wu and Huang, Modeling the
# constraints of human hand motion, 2000). Ranges are wider if recorded hands exceed them: a fitted skeleton's axes are
# not the hand's own, and base joints of ring and little finger roll as the palm folds.
def _freedoms() -> tuple[Freedom, ...]:
    rows = [
        *(Freedom("thumb1", "flexion", -35, 50), Freedom("thumb1", "abduction", -50, 50)),
        *(Freedom("thumb1", "twist", -50, 70), Freedom("thumb2", "flexion", -25, 60)),
        *(Freedom("thumb2", "abduction", -15, 15), Freedom("thumb3", "flexion", -30, 85)),
    ]
    for finger, spread, roll in (("index", 25, 25), ("middle", 20, 15), ("ring", 25, 25), ("pinky", 30, 40)):
        rows += [Freedom(f"{finger}1", "flexion", -45, 100), Freedom(f"{finger}1", "abduction", -spread, spread)]
        rows += [Freedom(f"{finger}1", "twist", -roll, roll), Freedom(f"{finger}2", "flexion", -15, 120)]
        rows += [Freedom(f"{finger}3", "flexion", -15, 130)]
    return tuple(rows)


FREEDOMS = _freedoms()
# Degrees by which the hinges of the middle and last joint are tilted about the finger, because flexed fingers point to
# one spot at the base of the thumb. From recorded hands (Microsoft Rocketbox); both avatars agree within 4°.
_TILT = {"index": (12.0, 12.0), "middle": (-4.0, -4.0), "ring": (-6.0, -6.0), "pinky": (-18.0, -22.0)}
# Matrix from the eight products of cosines and sines of half angles to the quaternion of Rz(−flexion) · Ry(abduction) ·
# Rx(twist).
_TURNS = np.zeros((8, 4))
_TURNS[[0b000, 0b001, 0b110, 0b010], [0, 1, 1, 2]] = 1.0
_TURNS[[0b111, 0b101, 0b100, 0b011], [0, 2, 3, 3]] = -1.0
_THUMB_FLEXION = (0.43, 0.84, 0.33)  # axis of the thumb's flexion at rest, also from recorded hands
_THUMB_BONE = (0.70, -0.49, 0.52)  # approximate direction of the thumb at rest
_CLOSED = ((0.0, 0.0), (0.25, 0.2), (0.5, 0.4), (0.8, 0.6))  # flexion of fingers and thumb, as a share of their range
_COLUMN = {"flexion": 0, "abduction": 1, "twist": 2}


def hand_skeleton(skeleton: Skeleton, side: Side) -> Skeleton:
    """Return the hand of a body as a left hand: `HAND_JOINTS` and `FINGERTIPS`, the wrist at the origin.

    Raises BodysenseError if the skeleton lacks a joint of the hand, or has another parent for it.
    """
    points = _points_of(skeleton, side)
    names = [*HAND_JOINTS, *FINGERTIPS]
    parents = tuple(-1 if name == "wrist" else names.index(_parent(name)) for name in names)
    for name, point in zip(names[1:], points[1:], strict=True):
        above = skeleton.points[skeleton.parents[point]]
        if above != f"{side}_{_parent(name)}":
            raise BodysenseError(f"hand: the parent of {side}_{name} is {above!r}; it must be {side}_{_parent(name)}")
    offset = skeleton.rest_offset[points] * _flip(side)
    offset[0] = 0.0
    return Skeleton(HAND_JOINTS, FINGERTIPS, parents, offset)


def hand_pose(pose: Pose, side: Side) -> Pose:
    """Return the hand of a posed body as a left hand: its root is the wrist in the world, mirrored if right."""
    points = _points_of(pose.skeleton, side)[: len(HAND_JOINTS)]
    position, world = forward_kinematics(pose)
    rotation = np.array(pose.rotation[..., points, :], dtype=float)
    rotation[..., 0, :] = world[..., points[0], :]
    root = np.asarray(position[..., points[0], :])
    return Pose(hand_skeleton(pose.skeleton, side), mirrored_vectors(root, side), mirrored_rotations(rotation, side))


def mirrored_vectors(vectors: np.ndarray, side: Side) -> np.ndarray:
    """Convert world vectors (..., 3) of a `side` hand to a left hand's, and back."""
    return vectors * _flip(side)


def mirrored_rotations(rotations: np.ndarray, side: Side) -> np.ndarray:
    """Convert rotations (..., 4) of a `side` hand to a left hand's, and back: mirror the axis, negate the angle."""
    return rotations * (np.array([1.0, 1, -1, -1]) if side == "right" else np.ones(4))


def rotations_of(angles: Array) -> Array:
    """Return local rotations (..., 15, 4) of finger joints from angles (..., 26), radians, ordered as `FREEDOMS`."""
    return quaternion_canonical(joint_rotations(per_joint(angles), as_like(default_axes(), angles)))


def angles_of(rotations: Array) -> Array:
    """Return angles (..., 26), radians, of local rotations (..., 15, 4); angles that a joint lacks are dropped."""
    joint, column = _joint_columns()
    return joint_angles(rotations, as_like(default_axes(), rotations))[..., joint, column]


def per_joint(angles: Array) -> Array:
    """Return flexion, abduction and twist (..., 15, 3) of every joint from angles (..., 26); 0 if a joint lacks one."""
    place, has = angle_indices()
    return angles[..., place] * (has if isinstance(angles, np.ndarray) else as_like(has, angles))


def joint_rotations(angles: Array, axes: Array) -> Array:
    """Return local rotations (..., 15, 4), of either sign, from flexion, abduction and twist (..., 15, 3), radians.

    `axes` (..., 15, 4, 4) are the joints' own axes (`own_axes`).
    """
    xp = array_namespace(angles)
    half = angles / 2
    both = xp.stack([xp.cos(half), xp.sin(half)], axis=-1)
    each = both[..., 0, :, None, None] * both[..., 1, None, :, None] * both[..., 2, None, None, :]
    own = xp.reshape(each, (*angles.shape[:-1], 1, 8)) @ (
        _TURNS if isinstance(angles, np.ndarray) else as_like(_TURNS, angles)
    )
    return (own @ axes)[..., 0, :]


def joint_angles(rotations: Array, axes: Array) -> Array:
    """Return flexion, abduction and twist (..., 15, 3), radians, of local rotations (..., 15, 4).

    `axes` (..., 15, 4, 4) are the joints' own axes (`own_axes`).
    """
    xp = array_namespace(rotations)
    own = (rotations[..., None, :] @ xp.matrix_transpose(axes))[..., 0, :]
    w, x, y, z = (own[..., k] for k in range(4))
    along, across, up = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)  # where the x axis points
    abduction = xp.atan2(-up, xp.sqrt(along * along + across * across))
    twist = xp.atan2(2 * (y * z + w * x), 1 - 2 * (x * x + y * y))
    return xp.stack([xp.atan2(-across, along), abduction, twist], axis=-1)


def own_axes(turn: np.ndarray) -> np.ndarray:
    """Return matrices (..., 15, 4, 4) that convert quaternions from a joint's own axes to the axes of the rest pose.

    A row vector q becomes q @ matrix. `turn` (..., 15, 4) rotates the joints' axes from the default hand's.
    """
    about = np.asarray(quaternion_multiply(turn, np.array(joint_bases())))[..., None, :]
    return np.asarray(quaternion_multiply(quaternion_multiply(about, np.eye(4)), quaternion_conjugate(about)))


@lru_cache(maxsize=1)
def default_axes() -> np.ndarray:
    """Return `own_axes` (15, 4, 4) of the default hand."""
    return own_axes(np.array([1.0, 0.0, 0.0, 0.0]))


def limits() -> tuple[np.ndarray, np.ndarray]:
    """Return joint limits: the smallest and the largest angles (26,), radians."""
    return np.radians([row.low for row in FREEDOMS]), np.radians([row.high for row in FREEDOMS])


def closing_hand() -> np.ndarray:
    """Return angles (4, 26), radians, of a closing hand: flat, relaxed, half closed and nearly a fist."""
    flexion = np.array([row.angle == "flexion" for row in FREEDOMS])
    thumb = np.array([row.joint.startswith("thumb") for row in FREEDOMS])
    return np.stack([np.where(thumb, of_thumb, share) * flexion * limits()[1] for share, of_thumb in _CLOSED])


@lru_cache(maxsize=1)
def joint_bases() -> tuple[tuple[float, ...], ...]:
    """Return the rotations (15, 4) of finger joints from their own axes to the axes of the rest pose."""
    flexion = np.array(_THUMB_FLEXION) / np.linalg.norm(_THUMB_FLEXION)
    along = np.array(_THUMB_BONE) - np.dot(_THUMB_BONE, flexion) * flexion
    along /= np.linalg.norm(along)
    thumb = np.stack([along, np.cross(-flexion, along), -flexion], axis=1)
    bases = [matrix_to_quaternion(thumb)] * 3
    for finger in FINGERS[1:]:
        for tilt in (0.0, *_TILT[finger]):
            half = np.radians(tilt) / 2
            bases.append(np.array([np.cos(half), np.sin(half), 0.0, 0.0]))
    return tuple(tuple(float(part) for part in basis) for basis in bases)


@lru_cache(maxsize=1)
def _joint_columns() -> tuple[list[int], list[int]]:
    """Return the joint (among 15) and the column of each degree of freedom: flexion, abduction, twist."""
    return [HAND_JOINTS.index(row.joint) - 1 for row in FREEDOMS], [_COLUMN[row.angle] for row in FREEDOMS]


@lru_cache(maxsize=1)
def angle_indices() -> tuple[np.ndarray, np.ndarray]:
    """Return indices (15, 3) of each joint's flexion, abduction and twist among the 26 angles, and a mask (15, 3)."""
    place, has = np.zeros((15, 3), dtype=np.int64), np.zeros((15, 3), dtype=bool)
    for index, (joint, column) in enumerate(zip(*_joint_columns(), strict=True)):
        place[joint, column], has[joint, column] = index, True
    return place, has


def _points_of(skeleton: Skeleton, side: Side) -> np.ndarray:
    if side not in ("left", "right"):
        raise BodysenseError(f"hand: side {side!r}; it is 'left' or 'right'")
    return skeleton.indices([f"{side}_{name}" for name in (*HAND_JOINTS, *FINGERTIPS)])


def _parent(name: str) -> str:
    """Return the parent of a finger's point; names are without the side."""
    if name.endswith("_tip"):
        return f"{name.removesuffix('_tip')}3"
    return "wrist" if name.endswith("1") else f"{name[:-1]}{int(name[-1]) - 1}"


def _flip(side: Side) -> np.ndarray:
    return np.array([-1.0, 1, 1]) if side == "right" else np.ones(3)


@lru_cache(maxsize=4096)
def glove_marker(point: str) -> tuple[str, str] | None:
    """Return the hand and the marker, of any set, in a point's name; None if the point is not a marker of a glove."""
    hand, _, marker = point.partition("_glove_")
    return (hand, marker) if marker and hand.startswith(("left", "right")) else None


def point_beyond(joint: str) -> str:
    """Return the joint or fingertip at the other end of a finger's segment, 'index3' or 'left_index3'."""
    return f"{joint[:-1]}_tip" if joint.endswith("3") else f"{joint[:-1]}{int(joint[-1]) + 1}"


def glove_hands(points: Iterable[str]) -> tuple[str, ...]:
    """Return the names of hands with markers among the points, in order of appearance."""
    return tuple(dict.fromkeys(found[0] for found in map(glove_marker, points) if found))
