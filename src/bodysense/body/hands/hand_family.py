"""Family of hands: differences between adults' hands and gloves, as standard normal parameters.

One vector of `COUNT` parameters defines a hand: size, positions of knuckles, lengths of bones, directions of fingers
at rest, tilt of hinges, build of the thumb, and positions of a glove's markers. Zeros give the mean hand. The family is
wide on purpose: rigs for animation, two recorded avatars and the template of the two-hands paper's glove differ more
from each other than adults do, and the family includes all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.glove import MARKERS, Glove, default_glove, hand_size
from bodysense.body.hands.hand import (
    FINGERS,
    FINGERTIPS,
    HAND_JOINTS,
    Side,
    hand_skeleton,
    mirrored_vectors,
)
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)

FARTHEST = 2.5  # standard deviations: the largest drawn parameter
_POINTS = (*HAND_JOINTS, *FINGERTIPS)
# The mean hand, 19.5 cm long: bases of fingers from the wrist and lengths of bones, cm. It is halfway between the
# default body's hand and that of Buchholz, Armstrong and Goldstein (Anthropometric data for describing the kinematics
# of the human hand, 1992).
_BASE = ((3.2, -0.9, 2.7), (9.8, -0.4, 2.45), (9.65, 0.0, 0.1), (9.05, 0.0, -2.0), (8.2, -0.5, -3.9))
_LENGTH = ((3.3, 3.6, 2.9), (3.7, 2.6, 2.3), (4.3, 3.0, 2.4), (3.85, 2.8, 2.4), (3.05, 1.95, 1.95))
_THUMB = ((0.64, -0.58, 0.50), (0.79, -0.49, 0.37), (0.86, -0.49, 0.14))  # directions of the thumb's bones at rest
# Mean positions of markers on the back of the hand, cm from their points, in the axes of the hand at rest.
_BACK_MARKERS = {"pinky_base": (-0.7, 1.2, 0.3), "wrist": (0.0, 2.8, 0.0), "index_base": (-1.2, 2.0, 0.5)}


class _Block(NamedTuple):
    """Parameters of one kind: number and standard deviation."""

    name: str
    length: int
    deviation: float


_BLOCKS = (
    _Block("size", 1, 0.08),  # log, of the whole hand
    _Block("knuckles", 1, 0.6),  # cm, toward the fingertips; the fingers' first bones are shorter by the same length
    _Block("breadth", 1, 0.07),  # log, of the palm
    _Block("base", 15, 0.3),  # cm, of every finger's base
    _Block("finger", 5, 0.05),  # log, of all bones of a finger
    _Block("length", 15, 0.09),  # log, of a bone
    _Block("tilt", 5, 7.0),  # degrees about the finger: its hinges
    _Block("spread", 5, 4.0),  # degrees to the side: direction of the finger at rest
    _Block("raise", 5, 4.0),  # degrees up
    _Block("thumb", 3, 10.0),  # degrees: rotation of the whole thumb
    _Block("thumb_bones", 6, 8.0),  # degrees: rotations of its second and last bone from their usual directions
    _Block("markers", 27, 0.35),  # cm, of every marker
    _Block("along", 6, 0.35),  # cm toward the base: position of a finger's marker on its segment
    _Block("back", 9, 0.4),  # cm, additional, of the markers on the back of the hand
)
COUNT = sum(block.length for block in _BLOCKS)
SHAPE = COUNT - 42  # number of the first parameters, which describe the hand without its glove


@dataclass(frozen=True, eq=False)
class GlovedHand:
    """A left hand with its wrist at the origin, the rotation of its joints' axes, and its glove."""

    skeleton: Skeleton
    axes: np.ndarray = field(repr=False)  # (15, 4) wxyz, from the axes of `hand.joint_bases` to this hand's, at rest
    glove: Glove


class HandShapes(NamedTuple):
    """Arrays that describe hands (...) of the family."""

    rest: np.ndarray  # (..., 21, 3) m, resting offsets
    axes: np.ndarray  # (..., 15, 4) wxyz
    markers: np.ndarray  # (..., 9, 3) m, offsets of markers


def draw_parameters(rng: np.random.Generator) -> np.ndarray:
    """Draw parameters (COUNT,) of a random hand."""
    return np.clip(rng.standard_normal(COUNT), -FARTHEST, FARTHEST)


def draw_hand(rng: np.random.Generator) -> GlovedHand:
    """Draw a random hand."""
    return hand_of(draw_parameters(rng))


def plain_hand(skeleton: Skeleton) -> GlovedHand:
    """Return a hand with the default hand's axes and the default glove."""
    axes = np.zeros((len(HAND_JOINTS) - 1, 4))
    axes[:, 0] = 1.0
    return GlovedHand(skeleton, axes, default_glove())


def body_with_hand(skeleton: Skeleton, side: Side, hand: GlovedHand) -> Skeleton:
    """Return a body with another hand on one side; the wrist is unchanged."""
    offset = np.array(skeleton.rest_offset)
    points = skeleton.indices([f"{side}_{name}" for name in _POINTS[1:]])
    offset[points] = mirrored_vectors(hand.skeleton.rest_offset[1:], side)
    return skeleton.with_offsets(offset)


def hand_from_arrays(
    rest: np.ndarray, axes: np.ndarray, markers: np.ndarray, attachments: Sequence[Sequence[str]] = ()
) -> GlovedHand:
    """Return a hand from its resting offsets, the rotations of its axes and the offsets of its markers.

    Args:
        rest: (21, 3) m.
        axes: (15, 4) wxyz, from the default hand's axes.
        markers: (M, 3) m, offsets from the points in `attachments`.
        attachments: for each marker its name, its point and the joint that carries it; empty for the standard set.

    Raises BodysenseError for numbers that do not describe a hand.
    """
    standard = default_glove()
    rows = [list(row) for row in attachments] or _attachments(standard)
    sizes = (("points", rest, (21, 3)), ("axes", axes, (15, 4)), ("markers", markers, (len(rows), 3)))
    for name, values, shape in sizes:
        if values.shape != shape or not np.isfinite(values).all():
            raise BodysenseError(f"a hand's {name} are {values.shape} numbers; they must be {shape}, all finite")
    if not 0.04 < np.linalg.norm(rest[1:], axis=-1).max() < 0.25:
        raise BodysenseError("a hand's points: its longest bone is not that of a hand; give metres")
    for row in rows:
        if len(row) != 3 or row[1] not in _POINTS or row[2] not in HAND_JOINTS:
            raise BodysenseError(
                f"a hand's marker {row}: give its name, a point of the hand and the joint it moves with"
            )
    hand = hand_skeleton(default_skeleton(), "left").with_offsets(rest)
    names, points, carriers = (tuple(column) for column in zip(*rows, strict=True))
    return GlovedHand(hand, axes, Glove(names, points, carriers, markers, hand_size(hand)))


def hand_arrays(hand: GlovedHand) -> dict[str, np.ndarray]:
    """Return the arrays from which `hand_from_arrays` builds the hand: points, axes and markers."""
    markers = hand.glove.offset_on(hand.skeleton)
    return {"points": hand.skeleton.rest_offset, "axes": hand.axes, "markers": markers}


def marker_attachments(hand: GlovedHand) -> list[list[str]]:
    """Return the `attachments` of a hand's markers for `hand_from_arrays`; empty for the standard set."""
    return [] if hand.glove.markers == default_glove().markers else _attachments(hand.glove)


def _attachments(glove: Glove) -> list[list[str]]:
    return [list(row) for row in zip(glove.markers, glove.points, glove.carried_by, strict=True)]


def hand_of(parameters: np.ndarray) -> GlovedHand:
    """Return the hand with parameters (COUNT,)."""
    shapes = shapes_of(parameters)
    return hand_from_arrays(shapes.rest, shapes.axes, shapes.markers)


def shapes_of(parameters: np.ndarray) -> HandShapes:
    """Return the shapes of hands with parameters (..., COUNT)."""
    part = _parts(parameters)
    rest, axes = bare_shapes_of(parameters)
    return HandShapes(rest, axes, 0.01 * np.exp(part["size"])[..., None] * _marker_offsets(part, axes[..., ::3, :]))


def bare_shapes_of(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return resting offsets (..., 21, 3) m and axes (..., 15, 4) of hands with parameters (..., SHAPE or more)."""
    part, batch = _parts(parameters), parameters.shape[:-1]
    size = np.exp(part["size"])[..., None]
    base = np.array(_BASE) + part["base"].reshape(*batch, 5, 3)
    base[..., 1:, 0] += part["knuckles"]
    base[..., 2] *= np.exp(part["breadth"])
    length = np.array(_LENGTH) * np.exp(part["length"].reshape(*batch, 5, 3) + part["finger"][..., None])
    length[..., 1:, 0] = np.maximum(length[..., 1:, 0] - part["knuckles"], 0.4 * length[..., 1:, 0])
    turn = _turns(part)
    bones = length[..., None] * quaternion_rotate(turn[..., None, :], _directions(part))
    rest = np.zeros((*batch, len(_POINTS), 3))
    first, rows = _rows()
    rest[..., first, :], rest[..., rows, :] = base, bones
    return 0.01 * size * rest, np.repeat(turn, 3, axis=-2)


def transfer_pose(pose: Pose, hand: GlovedHand) -> Pose:
    """Transfer a pose from a hand with default axes to `hand`: joints turn by the same angles about their own axes."""
    rotation = np.array(pose.rotation, dtype=float)
    turned = quaternion_multiply(quaternion_multiply(hand.axes, rotation[..., 1:, :]), quaternion_conjugate(hand.axes))
    rotation[..., 1:, :] = quaternion_canonical(turned)
    return Pose(hand.skeleton, pose.root_position, rotation)


def _parts(parameters: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values (..., n) of every block, angles in radians."""
    parts, start = {}, 0
    for block in _BLOCKS:
        parts[block.name] = block.deviation * parameters[..., start : start + block.length]
        start += block.length
    for name in ("tilt", "spread", "raise", "thumb", "thumb_bones"):
        parts[name] = np.radians(parts[name])
    return parts


def _turns(part: dict[str, np.ndarray]) -> np.ndarray:
    """Return (..., 5, 4) rotations of whole fingers at rest."""
    vector = np.stack([part["tilt"], part["spread"], part["raise"]], axis=-1)
    vector[..., 0, 1:] = 0.0  # the thumb has its own parameters
    about = np.asarray(quaternion_exp(vector * [1.0, 0.0, 0.0]))
    turn = np.asarray(quaternion_multiply(quaternion_exp(vector * [0.0, 1.0, 1.0]), about))
    tilted = quaternion_exp(part["tilt"][..., :1] * normalize(np.array(_THUMB[0])))
    turn[..., 0, :] = quaternion_multiply(quaternion_exp(part["thumb"]), tilted)
    return turn


def _directions(part: dict[str, np.ndarray]) -> np.ndarray:
    """Return (..., 5, 3, 3) directions of bones, before the rotation of the whole finger."""
    batch = part["size"].shape[:-1]
    directions = np.broadcast_to([1.0, 0.0, 0.0], (*batch, 5, 3, 3)).copy()
    bent = np.asarray(quaternion_exp(part["thumb_bones"].reshape(*batch, 2, 3)))
    thumb = normalize(np.array(_THUMB))
    directions[..., 0, 0, :] = thumb[0]
    directions[..., 0, 1:, :] = quaternion_rotate(bent, thumb[1:])
    return directions


def _marker_offsets(part: dict[str, np.ndarray], turn: np.ndarray) -> np.ndarray:
    """Return (..., 9, 3) cm, offsets of markers in the axes of the hand at rest."""
    batch = part["size"].shape[:-1]
    offsets = part["markers"].reshape(*batch, len(MARKERS), 3).copy()
    for row, name in enumerate(MARKERS[:3]):
        offsets[..., row, :] += np.array(_BACK_MARKERS[name]) + part["back"].reshape(*batch, 3, 3)[..., row, :]
    for row, name in enumerate(MARKERS[3:]):
        finger = FINGERS.index(name.partition("_")[0])
        along = (
            normalize(np.array(_THUMB[1 if name == "thumb_middle" else 2])) if finger == 0 else np.array([1.0, 0, 0])
        )
        offsets[..., 3 + row, :] -= part["along"][..., row, None] * quaternion_rotate(turn[..., finger, :], along)
    return offsets


@lru_cache(maxsize=1)
def _rows() -> tuple[list[int], list[list[int]]]:
    """Return indices of the bases (5,) of fingers, and of the ends of their bones (5, 3)."""
    bases = [_POINTS.index(f"{finger}1") for finger in FINGERS]
    ends = [[_POINTS.index(f"{finger}{k}") for k in ("2", "3", "_tip")] for finger in FINGERS]
    return bases, ends
