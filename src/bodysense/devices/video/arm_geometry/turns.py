"""Rotations of arms and hands after their bones were aligned with lines in the picture.

A direction does not determine the twist about the bone. The twist of an upper arm follows from its forearm, because an
elbow is a hinge and the network's rotations give its plane. A forearm keeps the network's twist relative to the upper
arm, and a hand relative to the forearm. If the landmarks of a hand are found, its palm is turned toward theirs. Palms
by network and by landmarks have equal and independent errors, so that their mean is better than either. Landmarks that
confuse the back of a hand with its palm have less weight.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.arms import ARM_JOINTS, HAND_POINTS, SIDES
from bodysense.body.skeleton import ARM, Skeleton
from bodysense.geometry.rotation import (
    angle_about,
    matrix_to_quaternion,
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
)

_UPPER, _FORE, _WRIST = (
    np.array([ARM_JOINTS.index(f"{side}_{part}") for side in SIDES]) for part in ("shoulder", "elbow", "wrist")
)
_HAND = np.array(  # wrist and fingers of each side
    [
        [k for k, name in enumerate(ARM_JOINTS) if name.startswith(side) and name.split("_")[1] not in ARM[:-1]]
        for side in SIDES
    ]
)
_KNUCKLES = [HAND_POINTS.index(f"{finger}1") for finger in ("index", "middle", "pinky")]
# Chosen on videos of validation clips.
_BENT = 0.3  # sine of an elbow's bend above which it determines most of the upper arm's twist
_PALM_SHARE = 0.5  # weight of a hand's landmarks relative to the network's
_PALM_DOUBT = np.radians(60.0)  # standard deviation of the difference of both, by which the weight falls


def align_arms(turned: np.ndarray, bones: np.ndarray, lines: np.ndarray) -> np.ndarray:
    """Return rotations (38, 4) of arms with bones turned from the directions `bones` to `lines`.

    Args:
        turned: (38, 4) rotations of `ARM_JOINTS`, in the axes of the directions.
        bones: (2, 2, 3) present unit directions of upper arm and forearm.
        lines: (2, 2, 3) new unit directions.
    """
    result = np.array(turned)
    upper, fore = turned[_UPPER], turned[_FORE]
    swung = np.asarray(quaternion_multiply(shortest_arc(bones[:, 0], lines[:, 0]), upper))
    # Twist the upper arm until the elbow bends in its own plane.
    bent = np.asarray(quaternion_rotate(quaternion_multiply(swung, quaternion_conjugate(upper)), bones[:, 1]))
    along = lines[:, 0]
    before, after = _across(bent, along), _across(lines[:, 1], along)
    angle = angle_about(along, before, after)
    sine = np.minimum(np.linalg.norm(before, axis=-1), np.linalg.norm(after, axis=-1))
    share = sine**2 / (sine**2 + _BENT**2)
    result[_UPPER] = quaternion_multiply(quaternion_exp(along * (share * angle)[:, None]), swung)
    # The forearm turns with the upper arm, then onto its own line. The hand moves with the forearm.
    carried = quaternion_multiply(result[_UPPER], quaternion_conjugate(upper))
    there = np.asarray(quaternion_rotate(carried, bones[:, 1]))
    carried = np.asarray(quaternion_multiply(shortest_arc(there, lines[:, 1]), carried))
    result[_FORE] = quaternion_multiply(carried, fore)
    result[_HAND] = quaternion_multiply(carried[:, None], turned[_HAND])
    return result


def with_palms(turned: np.ndarray, palms: np.ndarray, has_hand: np.ndarray) -> np.ndarray:
    """Return rotations (38, 4) of arms with hands, and their fingers, turned toward the landmarks' palms.

    Args:
        turned: (38, 4) rotations of `ARM_JOINTS`, in the axes of the palms.
        palms: (2, 4) rotations of both hands by their landmarks.
        has_hand: (2,) bool: the hand's landmarks were found.
    """
    result = np.array(turned)
    for side in np.flatnonzero(has_hand):
        turn = quaternion_multiply(palms[side], quaternion_conjugate(turned[_WRIST[side]]))
        away = np.asarray(quaternion_log(np.asarray(quaternion_canonical(turn))))
        share = _PALM_SHARE * float(np.exp(-0.5 * (away @ away) / _PALM_DOUBT**2))
        result[_HAND[side]] = quaternion_multiply(quaternion_exp(share * away), turned[_HAND[side]])
    return result


def palm_rotations(hands: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return rotations (..., 2, 4) of both hands of a skeleton from their `HAND_POINTS` (..., 2, 21, 3)."""
    rest = skeleton.path @ skeleton.rest_offset
    places = skeleton.indices([f"{side}_{name}" for side in SIDES for name in HAND_POINTS])
    own = _palm(rest[places].reshape(len(SIDES), len(HAND_POINTS), 3))
    return np.asarray(matrix_to_quaternion(_palm(hands) @ np.swapaxes(own, -1, -2)))


def _palm(points: np.ndarray) -> np.ndarray:
    """Return axes (..., 3, 3) of hands (..., 21, 3): wrist to knuckles, across the knuckles, normal of the palm."""
    knuckles = points[..., _KNUCKLES, :]
    ahead = np.asarray(normalize(knuckles.mean(axis=-2) - points[..., 0, :]))
    aside = np.asarray(normalize(_across(knuckles[..., 0, :] - knuckles[..., -1, :], ahead)))
    return np.stack([ahead, aside, np.cross(ahead, aside)], axis=-1)


def _across(vector: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the part of vectors (..., 3) at right angles to unit directions."""
    return vector - (vector * along).sum(axis=-1, keepdims=True) * along
