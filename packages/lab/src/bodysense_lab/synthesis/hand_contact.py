"""Contacts of key poses: fingers stop at the palm, the thumb passes around them, and its tip touches as requested."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.hands.hand import FINGERS, FREEDOMS, HAND_JOINTS, joint_bases, limits, rotations_of
from bodysense.body.hands.hand_capsules import (
    GIVE,
    PALM,
    HandCapsules,
    axes_between,
    hand_capsules,
    nearest_points,
    own_depth,
    own_pairs,
)
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import (
    normalize,
    quaternion_canonical,
    quaternion_rotate,
)
from bodysense_lab.synthesis.gestures import KeyPoses

PRESS_DEPTH = GIVE / 2  # share of the radii by which touching capsules overlap
# rad, how easily each angle changes: the thumb's six, then the finger's five, in the order of FREEDOMS
_SOFTNESS = np.radians([18.0, 18.0, 15.0, 18.0, 3.0, 22.0, 14.0, 5.0, 3.0, 14.0, 12.0])
_FOLDED_SHARE = 0.3  # share of this softness that folded fingers keep
# Steps that also pull toward the requested pose, then steps that only make touches and remove overlaps.
_APPROACH_STEPS, _REFINE_STEPS = 5, 6
_PAD_TOLERANCE = 0.006  # m between two pads that touch
_GAP_TOLERANCE, _OVERLAP_TOLERANCE = 0.0002, 0.002  # m between capsules that touch; overlap of others
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
_STEP = 1e-5  # rad, of the numerical derivative
_PALMAR = np.array([0.0, -1.0, 0.0])  # direction from a finger's axis to its pad, in its joint's own axes
_PAD_DIRECTIONS = np.array([_PALMAR, -_PALMAR, [0.0, 0.0, 1.0]])  # of a finger: tip, back, the thumb's side
_CURL_SHARES = np.linspace(1.0, 0.55, 10)  # shares of the flexion that are tried if fingers reach into the palm


def solve_contacts(hand: Skeleton, keys: KeyPoses) -> np.ndarray:
    """Return angles (K, 26) in rad near those of the key poses, with the requested touches and without deep overlaps.

    If the thumb touches a finger, their capsules meet to within 0.1 mm, overlapping by `PRESS_DEPTH`, unless the joint
    limits forbid it. Poses without touches and overlaps are unchanged.
    """
    angles = _limit_curl(hand, keys.angles)
    depth = own_depth(pose_hand(hand, np.zeros(3), _IDENTITY, angles))[:, own_pairs()[0] < 3]
    which = np.flatnonzero((keys.finger >= 0) | (depth.max(axis=1) > _OVERLAP_TOLERANCE / 4))
    if len(which):
        angles[which] = _solve_thumb_contacts(hand, angles[which], keys.finger[which], keys.place[which])
    return angles


def pose_hand(hand: Skeleton, root: np.ndarray, turn: np.ndarray, angles: np.ndarray) -> Pose:
    """Return a hand's pose from its wrist's position (..., 3) m and rotation (..., 4), and `angles` (..., 26) rad."""
    rotation = np.empty((*angles.shape[:-1], len(HAND_JOINTS), 4))
    rotation[..., 0, :], rotation[..., 1:, :] = quaternion_canonical(turn), rotations_of(angles)
    return Pose(hand, np.broadcast_to(root, (*angles.shape[:-1], 3)), rotation)


def _limit_curl(hand: Skeleton, angles: np.ndarray) -> np.ndarray:
    """Return angles (K, 26), with the flexion of fingers reduced until they do not reach into the palm."""
    names = np.array(hand_capsules(hand).names)
    first, second = (names[places] for places in own_pairs())
    flexions = np.array([row.angle == "flexion" and not row.joint.startswith("thumb") for row in FREEDOMS])
    trial = np.where(flexions, angles * _CURL_SHARES[:, None, None], angles)
    depth = own_depth(pose_hand(hand, np.zeros(3), _IDENTITY, trial))
    angles = angles.copy()
    for finger in FINGERS[1:]:
        pairs = [name.startswith(finger) and other in PALM for name, other in zip(first, second, strict=True)]
        free = (depth[..., pairs] <= 0).all(axis=-1)
        best = np.where(free.any(axis=0), np.argmax(free, axis=0), len(_CURL_SHARES) - 1)
        own = [row.joint.startswith(finger) for row in FREEDOMS]
        angles[:, own] = trial[best, np.arange(len(angles))][:, own]
    return angles


def _solve_thumb_contacts(hand: Skeleton, angles: np.ndarray, finger: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Solve the angles of the thumb and of the finger that it touches by damped least squares (Levenberg, 1944)."""
    capsules, count, touches = hand_capsules(hand), len(angles), (finger >= 0)[:, None]
    finger = np.maximum(finger, 0)
    columns = np.concatenate([np.tile(np.arange(6), (count, 1)), 6 + 5 * finger[:, None] + np.arange(5)], axis=1)
    low, high = (np.take_along_axis(bound[None], columns, axis=1) for bound in limits())
    start = np.take_along_axis(angles, columns, axis=1)
    nudges = np.concatenate([np.zeros((1, 11)), _STEP * np.eye(11)])[:, None]
    # A fingertip moves toward the thumb; folded fingers hardly move.
    softness = np.where((place[:, None] > 0) & (np.arange(11) >= 6), _FOLDED_SHARE, 1.0) * _SOFTNESS
    for step in range(_APPROACH_STEPS + _REFINE_STEPS):
        is_approaching = step < _APPROACH_STEPS
        here = np.take_along_axis(angles, columns, axis=1)
        trial = np.repeat(angles[None], len(nudges), axis=0)
        np.put_along_axis(trial, np.broadcast_to(columns, (len(nudges), count, 11)), here + nudges, axis=2)
        found = _measure_contacts(capsules, hand, trial, finger, place)
        gap = touches * found.gap[..., None] / (_GAP_TOLERANCE * (5 if is_approaching else 1))
        miss = touches * found.miss / _PAD_TOLERANCE * is_approaching
        residual = np.concatenate([gap, miss, np.maximum(found.depth, 0) / _OVERLAP_TOLERANCE], axis=-1)
        # Angles are in units of their softness. The first steps pull toward the requested pose, the last ones do not.
        slope = np.moveaxis(residual[1:] - residual[0], 0, -1) / _STEP * softness[:, None]  # (K, R, 11)
        weight = 1.0 if is_approaching else 1e-3
        normal = slope.swapaxes(1, 2) @ slope + weight * np.eye(11)
        pull = weight * is_approaching * (start - here) / softness - np.einsum("krc,kr->kc", slope, residual[0])
        change = np.linalg.solve(normal, pull[..., None])[..., 0]
        change *= np.minimum(1.0, 1.0 / np.maximum(np.abs(change).max(axis=1, keepdims=True), 1e-9))
        angles = angles.copy()
        np.put_along_axis(angles, columns, np.clip(here + change * softness, low, high), axis=1)
    return angles


@dataclass(frozen=True, eq=False)
class _Contacts:
    """Distances from the thumb to the finger that it touches, and its overlaps with the whole hand."""

    gap: np.ndarray  # (..., K) m between the capsules
    miss: np.ndarray  # (..., K, 3) m from the finger's pad to the thumb's
    depth: np.ndarray  # (..., K, M) m, overlap of each pair of capsules that contains one of the thumb


def _measure_contacts(
    capsules: HandCapsules, hand: Skeleton, angles: np.ndarray, finger: np.ndarray, place: np.ndarray
) -> _Contacts:
    """Return the contacts of angles (..., K, 26)."""
    position, world = forward_kinematics(pose_hand(hand, np.zeros(3), _IDENTITY, angles))
    begin, bone = axes_between(position, capsules.share)
    bases = np.array([(1.0, 0.0, 0.0, 0.0), *joint_bases()])
    thumb = capsules.names.index("thumb3")
    segment = np.array([[capsules.names.index(f"{name}{k}") for k in (3, 2, 2)] for name in FINGERS[1:]])
    segment, each = segment[finger, place], np.arange(len(finger))

    def outward(joint: np.ndarray, own: np.ndarray) -> np.ndarray:
        return quaternion_rotate(world[..., each, joint, :], quaternion_rotate(bases[joint], normalize(own)))

    tilted = np.array([0.5, 0.0, 0.0])  # pads are tilted a little toward the tip
    own = np.broadcast_to(_PALMAR + tilted, (len(finger), 3))
    center = begin[..., thumb, :] + bone[..., thumb, :]
    pad = center + capsules.radius[thumb] * outward(np.full(len(finger), capsules.joint[thumb]), own)
    share = np.where(place == 0, 1.0, 0.6)[:, None]
    other = begin[..., each, segment, :] + share * bone[..., each, segment, :]
    other_own = _PAD_DIRECTIONS[place] + tilted * (place == 0)[:, None]
    other_pad = other + capsules.radius[segment][:, None] * outward(capsules.joint[segment], other_own)
    reach = (1 - PRESS_DEPTH) * (capsules.radius[thumb] + capsules.radius[segment])
    return _Contacts(
        np.linalg.norm(center - other, axis=-1) - reach, pad - other_pad, _thumb_depth(capsules, begin, bone)
    )


def _thumb_depth(capsules: HandCapsules, begin: np.ndarray, bone: np.ndarray) -> np.ndarray:
    """Return the overlap (..., M) m of the thumb's capsules with others, from the start and axis of all (..., C, 3)."""
    first, second = (places[own_pairs()[0] < 3] for places in own_pairs())
    one, other = nearest_points(begin[..., first, :], bone[..., first, :], begin[..., second, :], bone[..., second, :])
    return (1 - GIVE) * (capsules.radius[first] + capsules.radius[second]) - np.linalg.norm(one - other, axis=-1)
