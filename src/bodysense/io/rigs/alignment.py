"""Alignment: the rotations from a source's rest bones to ours, joint by joint.

Source files have rest poses of their own. From the root outward, each joint of ours is given one constant
rotation, which takes the source's rest bones to ours. It is its parent's unless the bone to its child then points away
from the default skeleton's by more than `LIMB_TOLERANCE` (arms, legs, fingers) or `OTHER_TOLERANCE` (elsewhere, where
bodies differ in shape); then the shortest arc onto the default's direction is added. Pelvis, chest and wrist have
several children and are aligned with two directions (left to right and up; along the hand and across it). So a
skeleton that already stands in a T-pose keeps its own bone directions, and its rotations pass through unchanged.

Twist of arms and legs from bending: an elbow or a knee turns about one axis, which its motion reveals.

A rest pose whose bones all lie along one axis defines the directions of bones, but not their twist. In our
T-pose elbows bend about the vertical axis and knees about the transverse one; the turn about the bone that brings the
axis found there is the missing twist.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import (
    geodesic_angle,
    matrix_to_quaternion,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
)
from bodysense.body.skeleton import Skeleton
from bodysense.io.fingers import is_finger

LIMB_TOLERANCE = np.deg2rad(15.0)
OTHER_TOLERANCE = np.deg2rad(45.0)
TWIST_UNKNOWN = np.deg2rad(135.0)  # a bone turned by more than this into the T-pose does not define its twist
_LIMBS = ("hip", "knee", "shoulder", "elbow", "wrist", "index", "middle", "ring", "pinky")

Vectors = dict[str, np.ndarray]  # points of ours by name: positions, offsets (..., 3) m, or rotations (..., 4)


def alignment(ours: Skeleton, place: Vectors, parents: Mapping[str, str]) -> tuple[Vectors, str | None]:
    """Return for each matched joint the rotation (4,) from the source's rest bones to ours (see the module's text).

    Also the first limb joint, if any, whose bone turns so far that its twist remains unknown.
    """
    default_place = dict(zip(ours.points, ours.path @ ours.rest_offset, strict=True))
    align: Vectors = {}
    unknown = None
    for name in (name for name in ours.joints if name in place):
        turn = align[parents[name]] if name in parents else np.array([1.0, 0.0, 0.0, 0.0])
        children = [child for child, parent in parents.items() if parent == name]
        is_limb = any(limb in name for limb in _LIMBS)
        tolerance = LIMB_TOLERANCE if is_limb else OTHER_TOLERANCE
        pairs = _two_directions(name, children, place)
        wanted, found = (_frame(pairs, default_place), _frame(pairs, place)) if pairs else (None, None)
        if wanted is not None and found is not None:
            whole = matrix_to_quaternion(wanted @ found.T)
            if geodesic_angle(whole, turn) > tolerance:
                turn = whole
        elif len(children) == 1:
            bone = quaternion_rotate(turn, place[children[0]] - place[name])
            wanted = default_place[children[0]] - default_place[name]
            angle = angle_between(bone, wanted)
            if is_limb and angle > TWIST_UNKNOWN and not is_finger(name):  # a finger's twist is harmless
                unknown = unknown or name
            if angle > tolerance:
                turn = quaternion_multiply(shortest_arc(bone, wanted), turn)
        align[name] = turn
    return align, unknown


def turned_by_places(ours: Skeleton, place: Vectors, parents: Mapping[str, str]) -> Vectors:
    """Return world rotations (T, 4) of joints with known positions (T, 3) only, with the least possible twist."""
    default_place = dict(zip(ours.points, ours.path @ ours.rest_offset, strict=True))
    world: Vectors = {}
    for name in (name for name in ours.joints if name in place):
        still = np.tile([1.0, 0.0, 0.0, 0.0], (len(place[name]), 1))
        turn = world[parents[name]] if name in parents else still
        children = [child for child, parent in parents.items() if parent == name]
        pairs = _two_directions(name, children, place)
        wanted, found = (_frame(pairs, default_place), _frame(pairs, place)) if pairs else (None, None)
        if wanted is not None and found is not None:
            turn = matrix_to_quaternion(found @ wanted.T)
        elif len(children) == 1:
            bone = quaternion_rotate(turn, default_place[children[0]] - default_place[name])
            turn = quaternion_multiply(shortest_arc(bone, place[children[0]] - place[name]), turn)
        world[name] = turn
    return world


def _two_directions(name: str, children: list[str], place: Vectors) -> list[tuple[str, str]]:
    """Return two pairs of points (from, to) that orient a joint with several children, or an empty list."""
    side = name.partition("_")[0]
    if name.endswith("_wrist"):
        along = [f"{side}_{finger}1" for finger in ("middle", "index", "ring", "pinky") if f"{side}_{finger}1" in place]
        inner = [f"{side}_{finger}1" for finger in ("pinky", "ring") if f"{side}_{finger}1" in place]
        return [(name, along[0]), (inner[0], f"{side}_index1")] if inner and f"{side}_index1" in place else []
    across = [(f"right_{child[5:]}", child) for child in children if child.startswith("left_")]
    up = [(name, child) for child in children if "_" not in child]
    return [across[0], up[0]] if across and across[0][0] in place and up else []


def _frame(pairs: list[tuple[str, str]], place: Vectors) -> np.ndarray | None:
    """Return orthonormal axes (..., 3, 3), as columns, from two directions; None if they are zero or parallel."""
    first, second = (place[b] - place[a] for a, b in pairs)
    third = np.cross(first, second)
    size, across, area = (np.linalg.norm(vector, axis=-1, keepdims=True) for vector in (first, second, third))
    if (area < 1e-6 * np.maximum(1e-9, size * across)).any():
        return None
    x, z = first / size, third / area
    return np.stack([x, np.cross(z, x), z], axis=-1)


def angle_between(u: np.ndarray, v: np.ndarray) -> float:
    """Return the angle between two vectors, radians; 0 if one has zero length."""
    return float(np.arctan2(np.linalg.norm(np.cross(u, v)), u @ v))


LEAST_BEND = np.deg2rad(15.0)  # a joint that never bends more reveals no axis
_LEAST_AGREEMENT = 0.5  # mean resultant of the axes found: below it they do not agree

# Limb, its joints, and the axis about which the second bends in the T-pose.
_HINGES = [
    ((f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist"), (0.0, -sign, 0.0))
    for side, sign in (("left", 1), ("right", -1))
] + [((f"{side}_hip", f"{side}_knee", f"{side}_ankle"), (1.0, 0.0, 0.0)) for side in ("left", "right")]


def twisted_by_hinges(
    align: dict[str, np.ndarray], pose: Pose, standing: Pose, match: Mapping[str, int]
) -> dict[str, np.ndarray]:
    """Twist the alignments (4,) of upper arms, thighs, forearms and shins so that they bend as ours do."""
    position, rotation = forward_kinematics(pose)
    rest = forward_kinematics(standing)[1]
    twisted = dict(align)
    for (first, second, third), hinge in (limb for limb in _HINGES if limb[0][0] in match):
        upper, lower = (position[:, match[b]] - position[:, match[a]] for a, b in ((first, second), (second, third)))
        normal = np.cross(upper, lower)
        lengths = np.linalg.norm(upper, axis=-1) * np.linalg.norm(lower, axis=-1)
        bend = np.linalg.norm(normal, axis=-1) / np.maximum(lengths, 1e-12)  # sine
        clear = bend > np.sin(LEAST_BEND)
        if clear.sum() < 2:
            continue
        for joint, bone in ((first, upper), (second, lower)):
            ours = quaternion_multiply(
                rotation[clear, match[joint]],
                quaternion_conjugate(quaternion_multiply(align[joint], rest[match[joint]])),
            )
            back = quaternion_conjugate(ours)
            angle, agreement = _turn_about(
                quaternion_rotate(back, bone[clear]), np.array(hinge), quaternion_rotate(back, normal[clear])
            )
            if agreement > _LEAST_AGREEMENT:
                axis = quaternion_rotate(back, bone[clear]).mean(axis=0)
                axis /= max(float(np.linalg.norm(axis)), 1e-9)
                # The joint's frame turns with its twist, so a direction in it turns the opposite way.
                twist = quaternion_exp(-angle * axis)
                twisted[joint] = quaternion_multiply(twist, align[joint])
                hand = third.endswith("_wrist") and joint == second
                if hand and third.replace("wrist", "index1") not in match:  # the palm would define it
                    twisted[third] = quaternion_multiply(twist, align[third])
    return twisted


def _turn_about(bone: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[float, float]:
    """Return the mean angle (radians) about bones (N, 3) from a direction (3,) to others (N, 3), weighted by length."""
    along = bone / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), 1e-12)
    flat = start - (along @ start)[:, None] * along
    sine = (np.cross(flat, end) * along).sum(-1)
    cosine = (flat * end).sum(-1)
    length = np.hypot(sine, cosine)
    total = complex(cosine.sum(), sine.sum())
    return float(np.angle(total)), abs(total) / max(float(length.sum()), 1e-12)
