"""The flesh of a hand: capsules along fingers and palm, and the overlap of hands and fingers.

Radii are those of the body's primitives (capsules.py), which are fitted to the surface of the body model: a finger's
segment is a capsule from joint to joint; the palm is one along each metacarpal, as thick as the base of its finger. On
other hands they scale with the hand's length.

Flesh gives way: two capsules may overlap by a share of their radii (`GIVE`) before that is a penetration. Segments of
one finger, palm and the bases of fingers, and the bases of neighbouring fingers overlap by their anatomy and are left
out; joint limits keep the segments of a finger apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from bodysense.body.capsules import fit_primitives, nearest_shares
from bodysense.body.glove import hand_size
from bodysense.body.hand import FINGERS, HAND_JOINTS, hand_skeleton, point_beyond
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.skeleton import Skeleton, default_skeleton

PALM = tuple(f"palm_{finger}" for finger in FINGERS[1:])
SEGMENTS = HAND_JOINTS[1:]
NAMES = (*SEGMENTS, *PALM)  # 15 capsules of fingers, each named after the joint that carries it, then four of the palm
GIVE = 0.2  # of the sum of two radii: depth by which touching flesh gives way
_ROOT_OF_PALM = 0.25  # start of a metacarpal's capsule, as a share of the distance from the wrist to the knuckle


@dataclass(frozen=True, eq=False)
class HandCapsules:
    """C capsules of a hand, metres, each rigid in the frame of the joint that carries it (world axes at rest)."""

    names: tuple[str, ...]  # (C,) `NAMES`
    joint: np.ndarray = field(repr=False)  # (C,) index of the hand's joint that carries each
    start: np.ndarray = field(repr=False)  # (C, 3) of a capsule's axis
    end: np.ndarray = field(repr=False)  # (C, 3)
    radius: np.ndarray = field(repr=False)  # (C,)


@lru_cache(maxsize=64)
def hand_capsules(hand: Skeleton) -> HandCapsules:
    """Return the capsules of a hand's skeleton (`hand.hand_skeleton`)."""
    default = hand_skeleton(default_skeleton(), "left")
    scale = hand_size(hand) / hand_size(default)
    body = fit_primitives(default_skeleton())
    rest = hand.path @ hand.rest_offset
    radius = [scale * body.radius[body.names.index(f"left_{name}")] for name in SEGMENTS]
    start, end = [np.zeros(3)] * len(SEGMENTS), []
    for name, thickness in zip(SEGMENTS, radius, strict=True):
        bone = hand.rest_offset[hand.index(point_beyond(name))]
        end.append(_shortened(bone, thickness) if name.endswith("3") else bone)  # fingertips are on the skin
    for name in PALM:
        base = f"{name.removeprefix('palm_')}1"
        knuckle, thickness = rest[hand.index(base)], radius[SEGMENTS.index(base)]
        start.append(_ROOT_OF_PALM * knuckle)
        end.append(_shortened(knuckle, thickness))
        radius.append(thickness)
    joint = hand.indices([*SEGMENTS, *["wrist"] * len(PALM)])
    return HandCapsules(NAMES, joint, np.array(start), np.array(end), np.array(radius))


@lru_cache(maxsize=1)
def own_pairs() -> tuple[np.ndarray, np.ndarray]:
    """Return indices in `NAMES` (M,), (M,) of the pairs of one hand's capsules that can meet."""
    pairs = [(a, b) for a, b in zip(*np.triu_indices(len(NAMES), k=1), strict=True) if not _joined(NAMES[a], NAMES[b])]
    first, second = np.array(pairs).T
    return first, second


def own_depth(pose: Pose) -> np.ndarray:
    """Return the overlap of posed hands' (...) fingers with each other and the palm: (..., M) m for `own_pairs`.

    It is negative for capsules that do not touch: minus the gap.
    """
    capsules, (first, second) = hand_capsules(pose.skeleton), own_pairs()
    start, along = placed_axes(pose)
    reach = (1 - GIVE) * (capsules.radius[first] + capsules.radius[second])
    return reach - _distance(start[..., first, :], along[..., first, :], start[..., second, :], along[..., second, :])


def mutual_depth(left: Pose, right: Pose) -> np.ndarray:
    """Return the overlap of two posed hands (...), signed as in `own_depth`: (..., C, C) m, left by right.

    `right` is the right hand as a left one, mirrored with its world at x = 0 (hand.hand_pose).
    """
    start, along = (part[..., :, None, :] for part in placed_axes(left))
    other, other_along = (part[..., None, :, :] * [-1.0, 1.0, 1.0] for part in placed_axes(right))
    radius = hand_capsules(left.skeleton).radius[:, None] + hand_capsules(right.skeleton).radius
    return (1 - GIVE) * radius - _distance(start, along, other, other_along)


def placed_axes(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts of posed hands' capsules (..., C, 3) m, and the vectors to their ends (..., C, 3) m."""
    capsules = hand_capsules(pose.skeleton)
    position, world = (np.asarray(part) for part in forward_kinematics(pose))
    turn = quaternion_to_matrix(world[..., capsules.joint, :])
    start = position[..., capsules.joint, :] + np.einsum("...cij,cj->...ci", turn, capsules.start)
    return start, np.einsum("...cij,cj->...ci", turn, capsules.end - capsules.start)


def _shortened(bone: np.ndarray, length: float) -> np.ndarray:
    """Shorten a bone (3,) m by `length`, at most to zero."""
    return bone * max(0.0, 1 - length / np.linalg.norm(bone))


def _distance(start: np.ndarray, along: np.ndarray, other: np.ndarray, other_along: np.ndarray) -> np.ndarray:
    """Return the distance (...) of segments (..., 3) m."""

    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("...i,...i->...", a, b)

    between = start - other
    s, t = nearest_shares(
        *(dot(along, along), dot(other_along, other_along), dot(along, other_along)),
        *(dot(along, between), dot(other_along, between)),
    )
    return np.linalg.norm(between + s[..., None] * along - t[..., None] * other_along, axis=-1)


def _joined(one: str, other: str) -> bool:
    """Whether two capsules of a hand overlap by anatomy, or are kept apart by joint limits."""
    palms = [name.startswith("palm") for name in (one, other)]
    if any(palms):
        return all(palms) or one.endswith("1") or other.endswith("1")
    (finger, segment), (other_finger, other_segment) = (one[:-1], one[-1]), (other[:-1], other[-1])
    beside = abs(FINGERS.index(finger) - FINGERS.index(other_finger)) == 1 and "thumb" not in (finger, other_finger)
    return finger == other_finger or (beside and segment == other_segment == "1")
