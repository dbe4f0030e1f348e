"""Capsules of a hand, along fingers and palm, and the overlap of hands and fingers.

Radii are those of the body's primitives (capsules.py), which are fitted to the surface of the body model. A finger's
segment is a capsule from joint to joint. The palm has a capsule along each metacarpal, as thick as the base of its
finger. On other hands radii scale with the hand's length.

Soft tissue yields: two capsules may overlap by a share of their radii (`GIVE`) before they count as penetrating. Some
pairs overlap by anatomy and are left out: palm and bases of fingers, and bases of neighbouring fingers. So are segments
of one finger, which joint limits keep apart.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from bodysense.body.capsules import fit_primitives
from bodysense.body.hands.glove import hand_size
from bodysense.body.hands.hand import FINGERS, FINGERTIPS, HAND_JOINTS, hand_skeleton, point_beyond
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.segments import nearest_shares

PALM = tuple(f"palm_{finger}" for finger in FINGERS[1:])
SEGMENTS = HAND_JOINTS[1:]
NAMES = (*SEGMENTS, *PALM)  # 15 capsules of fingers, each named after its carrying joint, then four of the palm
GIVE = 0.2  # depth by which touching capsules may overlap, as a share of the sum of their radii
_POINTS = (*HAND_JOINTS, *FINGERTIPS)
_BASES = tuple(f"{finger}1" for finger in FINGERS[1:])
# Indices of the carrying joint of each capsule, and of the point at the other end of its bone.
_JOINT = np.array([*range(1, len(HAND_JOINTS)), *[0] * len(PALM)])
_TOWARD = np.array([_POINTS.index(name) for name in (*map(point_beyond, SEGMENTS), *_BASES)])
_ROOT_OF_PALM = 0.25  # start of a metacarpal's capsule, as a share of the distance from the wrist to the knuckle


@dataclass(frozen=True, eq=False)
class HandCapsules:
    """C capsules of a hand, in metres, each rigid in the frame of its carrying joint (world axes at rest)."""

    names: tuple[str, ...]  # (C,) `NAMES`
    joint: np.ndarray = field(repr=False)  # (C,) index of the carrying joint of the hand
    share: np.ndarray = field(repr=False)  # (C, 2) start and end of the axis, as shares of the bone that begins there
    start: np.ndarray = field(repr=False)  # (C, 3) start of a capsule's axis
    end: np.ndarray = field(repr=False)  # (C, 3) end of a capsule's axis
    radius: np.ndarray = field(repr=False)  # (C,)


@lru_cache(maxsize=64)
def hand_capsules(hand: Skeleton) -> HandCapsules:
    """Return the capsules of a hand's skeleton (`hand.hand_skeleton`)."""
    scale = hand_size(hand) / hand_size(hand_skeleton(default_skeleton(), "left"))
    body = fit_primitives(default_skeleton())
    radius = scale * np.array([body.radius[body.names.index(f"left_{name}")] for name in (*SEGMENTS, *_BASES)])
    rest, palm = hand.path @ hand.rest_offset, _JOINT == 0
    bone = rest[_TOWARD] - rest[_JOINT]
    shortened = np.maximum(0.0, 1 - radius / np.linalg.norm(bone, axis=-1))
    last = np.array([name.endswith("3") for name in NAMES])  # fingertips are on the skin
    share = np.stack([np.where(palm, _ROOT_OF_PALM, 0.0), np.where(palm | last, shortened, 1.0)], axis=-1)
    return HandCapsules(NAMES, _JOINT, share, share[:, :1] * bone, share[:, 1:] * bone, radius)


@lru_cache(maxsize=1)
def own_pairs() -> tuple[np.ndarray, np.ndarray]:
    """Return indices in `NAMES`, (M,) and (M,), of the pairs of one hand's capsules that can collide."""
    pairs = [(a, b) for a, b in zip(*np.triu_indices(len(NAMES), k=1), strict=True) if not _joined(NAMES[a], NAMES[b])]
    first, second = np.array(pairs).T
    return first, second


def own_depth(pose: Pose) -> np.ndarray:
    """Return the overlap (..., M) m of fingers with each other and with the palm in posed hands (...), for `own_pairs`.

    For capsules that do not touch it is minus the gap.
    """
    radius, (first, second) = hand_capsules(pose.skeleton).radius, own_pairs()
    start, along = capsule_axes(pose)
    points = nearest_points(start[..., first, :], along[..., first, :], start[..., second, :], along[..., second, :])
    return (1 - GIVE) * (radius[first] + radius[second]) - np.linalg.norm(points[0] - points[1], axis=-1)


def mutual_depth(left: Pose, right: Pose) -> np.ndarray:
    """Return the overlap (..., C, C) m, left by right, of two posed hands (...), signed as in `own_depth`.

    `right` is the right hand as a left one, mirrored with its world at x = 0 (`hand.hand_pose`).
    """
    start, along = (part[..., :, None, :] for part in capsule_axes(left))
    other, other_along = (part[..., None, :, :] * [-1.0, 1.0, 1.0] for part in capsule_axes(right))
    radius = hand_capsules(left.skeleton).radius[:, None] + hand_capsules(right.skeleton).radius
    points = nearest_points(start, along, other, other_along)
    return (1 - GIVE) * radius - np.linalg.norm(points[0] - points[1], axis=-1)


def capsule_axes(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Return the starts of posed hands' capsules (..., C, 3) m, and the vectors to their ends (..., C, 3) m."""
    return axes_between(np.asarray(forward_kinematics(pose)[0]), hand_capsules(pose.skeleton).share)


def axes_between(position: np.ndarray, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return `capsule_axes` of hands with points at (..., 21, 3) m and capsules with `share` (..., C, 2)."""
    near = position[..., _JOINT, :]
    bone = position[..., _TOWARD, :] - near
    return near + share[..., :1] * bone, (share[..., 1:] - share[..., :1]) * bone


def nearest_points(
    start: np.ndarray, along: np.ndarray, other: np.ndarray, other_along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest points (..., 3) m of two segments, each given by its start and the vector to its end."""

    def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("...i,...i->...", a, b)

    between = start - other
    s, t = nearest_shares(
        *(dot(along, along), dot(other_along, other_along), dot(along, other_along)),
        *(dot(along, between), dot(other_along, between)),
    )
    return start + s[..., None] * along, other + t[..., None] * other_along


def _joined(one: str, other: str) -> bool:
    """Whether two capsules of a hand overlap by anatomy, or are kept apart by joint limits."""
    palms = [name.startswith("palm") for name in (one, other)]
    if any(palms):
        return all(palms) or one.endswith("1") or other.endswith("1")
    (finger, segment), (other_finger, other_segment) = (one[:-1], one[-1]), (other[:-1], other[-1])
    neighbours = abs(FINGERS.index(finger) - FINGERS.index(other_finger)) == 1 and "thumb" not in (finger, other_finger)
    return finger == other_finger or (neighbours and segment == other_segment == "1")
