"""Key poses that flesh allows: fingers end at the palm, the thumb goes round them and touches what it is to touch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.hand import FINGERS, FREEDOMS, HAND_JOINTS, joint_bases, limits, rotations_of
from bodysense.body.hand_capsules import (
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
from bodysense.body.rotation import (
    normalize,
    quaternion_canonical,
    quaternion_rotate,
)
from bodysense.body.skeleton import Skeleton
from bodysense_lab.synthesis.gestures import KeyPoses

PRESSED = GIVE / 2  # of the radii: so deep the flesh of two that touch is pressed in
# How readily angles give way: the thumb's six, then the finger's five, in the order of FREEDOMS.
_SOFTNESS = np.radians([18.0, 18.0, 15.0, 18.0, 3.0, 22.0, 14.0, 5.0, 3.0, 14.0, 12.0])
_FOLDED = 0.3  # of their readiness is left to folded fingers
_SETTLING, _CLOSING = 5, 6  # steps toward the pose that is asked for, then steps that touch and part alone
_FACING, _GAP, _INSIDE = 0.006, 0.0002, 0.002  # m: how far pads may miss each other, gaps may be wide, flesh overlap
_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
_STEP = 1e-5  # rad, of the numerical derivative
_PALMAR = np.array([0.0, -1.0, 0.0])  # where a finger's flesh touches, in its joint's own axes
_PLACES = np.array([_PALMAR, -_PALMAR, [0.0, 0.0, 1.0]])  # of a finger: tip, back, the thumb's side
_CURLS = np.linspace(1.0, 0.55, 10)  # shares of their flexion that are tried where fingers reach into the palm


def settled(hand: Skeleton, keys: KeyPoses) -> np.ndarray:
    """Angles (K, 26), radians, near those of the key poses, with the touches made and nothing deep in something else.

    Where the thumb touches a finger their capsules meet to within 0.1 mm, pressed in by `PRESSED`, unless the limits
    forbid it. Possible poses without contact are unchanged.
    """
    angles = _out_of_the_palm(hand, keys.angles)
    depth = own_depth(posed(hand, np.zeros(3), _UNTURNED, angles))[:, own_pairs()[0] < 3]
    which = np.flatnonzero((keys.finger >= 0) | (depth.max(axis=1) > _INSIDE / 4))
    if len(which):
        angles[which] = _thumbs_settled(hand, angles[which], keys.finger[which], keys.place[which])
    return angles


def posed(hand: Skeleton, root: np.ndarray, turn: np.ndarray, angles: np.ndarray) -> Pose:
    """A hand's pose: wrist at `root` (..., 3) m and turned by `turn` (..., 4), fingers by `angles` (..., 26) rad."""
    rotation = np.empty((*angles.shape[:-1], len(HAND_JOINTS), 4))
    rotation[..., 0, :], rotation[..., 1:, :] = quaternion_canonical(turn), rotations_of(angles)
    return Pose(hand, np.broadcast_to(root, (*angles.shape[:-1], 3)), rotation)


def _out_of_the_palm(hand: Skeleton, angles: np.ndarray) -> np.ndarray:
    """Angles (K, 26) with fingers flexed only so far that they do not reach into the palm."""
    names = np.array(hand_capsules(hand).names)
    first, second = (names[places] for places in own_pairs())
    flexions = np.array([row.angle == "flexion" and not row.joint.startswith("thumb") for row in FREEDOMS])
    trial = np.where(flexions, angles * _CURLS[:, None, None], angles)
    depth = own_depth(posed(hand, np.zeros(3), _UNTURNED, trial))
    angles = angles.copy()
    for finger in FINGERS[1:]:
        pairs = [name.startswith(finger) and other in PALM for name, other in zip(first, second, strict=True)]
        free = (depth[..., pairs] <= 0).all(axis=-1)
        best = np.where(free.any(axis=0), np.argmax(free, axis=0), len(_CURLS) - 1)
        own = [row.joint.startswith(finger) for row in FREEDOMS]
        angles[:, own] = trial[best, np.arange(len(angles))][:, own]
    return angles


def _thumbs_settled(hand: Skeleton, angles: np.ndarray, finger: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Damped least squares (Levenberg, 1944) over the angles of the thumb and of the finger that it touches."""
    capsules, count, touches = hand_capsules(hand), len(angles), (finger >= 0)[:, None]
    finger = np.maximum(finger, 0)
    columns = np.concatenate([np.tile(np.arange(6), (count, 1)), 6 + 5 * finger[:, None] + np.arange(5)], axis=1)
    low, high = (np.take_along_axis(bound[None], columns, axis=1) for bound in limits())
    start = np.take_along_axis(angles, columns, axis=1)
    nudges = np.concatenate([np.zeros((1, 11)), _STEP * np.eye(11)])[:, None]
    # A fingertip comes to meet the thumb; folded fingers lie still.
    softness = np.where((place[:, None] > 0) & (np.arange(11) >= 6), _FOLDED, 1.0) * _SOFTNESS
    for step in range(_SETTLING + _CLOSING):
        settling = step < _SETTLING
        here = np.take_along_axis(angles, columns, axis=1)
        trial = np.repeat(angles[None], len(nudges), axis=0)
        np.put_along_axis(trial, np.broadcast_to(columns, (len(nudges), count, 11)), here + nudges, axis=2)
        found = _measure(capsules, hand, trial, finger, place)
        gap = touches * found.gap[..., None] / (_GAP * (5 if settling else 1))
        miss = touches * found.miss / _FACING * settling
        residual = np.concatenate([gap, miss, np.maximum(found.depth, 0) / _INSIDE], axis=-1)
        # In units of softness, drawn to the pose that was asked for; later the least change that will do.
        slope = np.moveaxis(residual[1:] - residual[0], 0, -1) / _STEP * softness[:, None]  # (K, R, 11)
        weight = 1.0 if settling else 1e-3
        normal = slope.swapaxes(1, 2) @ slope + weight * np.eye(11)
        pull = weight * settling * (start - here) / softness - np.einsum("krc,kr->kc", slope, residual[0])
        change = np.linalg.solve(normal, pull[..., None])[..., 0]
        change *= np.minimum(1.0, 1.0 / np.maximum(np.abs(change).max(axis=1, keepdims=True), 1e-9))
        angles = angles.copy()
        np.put_along_axis(angles, columns, np.clip(here + change * softness, low, high), axis=1)
    return angles


@dataclass(frozen=True, eq=False)
class _Touch:
    """How a thumb stands to a finger, and to all of the hand."""

    gap: np.ndarray  # (..., K) m
    miss: np.ndarray  # (..., K, 3) m from the finger's pad to the thumb's
    depth: np.ndarray  # (..., K, M) m, of the pairs of capsules that the thumb is of


def _measure(
    capsules: HandCapsules, hand: Skeleton, angles: np.ndarray, finger: np.ndarray, place: np.ndarray
) -> _Touch:
    """Return the contacts of angles (..., K, 26)."""
    position, world = forward_kinematics(posed(hand, np.zeros(3), _UNTURNED, angles))
    begin, bone = axes_between(position, capsules.share)
    bases = np.array([(1.0, 0.0, 0.0, 0.0), *joint_bases()])
    thumb = capsules.names.index("thumb3")
    segment = np.array([[capsules.names.index(f"{name}{k}") for k in (3, 2, 2)] for name in FINGERS[1:]])
    segment, each = segment[finger, place], np.arange(len(finger))

    def outward(joint: np.ndarray, own: np.ndarray) -> np.ndarray:
        return quaternion_rotate(world[..., each, joint, :], quaternion_rotate(bases[joint], normalize(own)))

    tilted = np.array([0.5, 0.0, 0.0])  # pads face a little toward the tip
    own = np.broadcast_to(_PALMAR + tilted, (len(finger), 3))
    center = begin[..., thumb, :] + bone[..., thumb, :]
    pad = center + capsules.radius[thumb] * outward(np.full(len(finger), capsules.joint[thumb]), own)
    share = np.where(place == 0, 1.0, 0.6)[:, None]
    other = begin[..., each, segment, :] + share * bone[..., each, segment, :]
    other_own = _PLACES[place] + tilted * (place == 0)[:, None]
    other_pad = other + capsules.radius[segment][:, None] * outward(capsules.joint[segment], other_own)
    reach = (1 - PRESSED) * (capsules.radius[thumb] + capsules.radius[segment])
    return _Touch(np.linalg.norm(center - other, axis=-1) - reach, pad - other_pad, _thumb_depth(capsules, begin, bone))


def _thumb_depth(capsules: HandCapsules, begin: np.ndarray, bone: np.ndarray) -> np.ndarray:
    """How deep (..., M) m the thumb's capsules stand in others, from where all begin (..., C, 3) and their bones."""
    first, second = (places[own_pairs()[0] < 3] for places in own_pairs())
    one, other = nearest_points(begin[..., first, :], bone[..., first, :], begin[..., second, :], bone[..., second, :])
    return (1 - GIVE) * (capsules.radius[first] + capsules.radius[second]) - np.linalg.norm(one - other, axis=-1)
