"""Both arms with their hands: their joints, the points that a camera sees, and a skeleton of the arms alone.

PAHMT (Liu et al. 2022) estimates 48 rotations of a Mixamo character, 24 for each arm: collar, upper arm, forearm, hand
and four joints for each finger. The last joint of a finger is its tip, which does not turn. Without the ten tips there
are the 38 `ARM_JOINTS`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import ARM, FINGERS, Skeleton

SIDES = ("left", "right")
FINGER_JOINTS = tuple(f"{finger}{k}" for finger in FINGERS for k in (1, 2, 3))  # of a hand, in the order of SMPL-H
ARM_JOINTS = tuple(f"{side}_{part}" for side in SIDES for part in (*ARM, *FINGER_JOINTS))  # 2 × 19
ARM_POINTS = ("shoulder", "elbow", "wrist")  # ends of upper arm and forearm
# Points of a hand in the order of MediaPipe's hand landmarks. thumb1 is the CMC joint, index1 and others the knuckles.
HAND_POINTS = (
    "wrist",
    *(f"{finger}{end}" for finger in ("thumb", "index", "middle", "ring", "pinky") for end in ("1", "2", "3", "_tip")),
)
CHEST = "spine3"  # parent of both arms


def arm_skeleton(skeleton: Skeleton) -> Skeleton:
    """Return the skeleton of both arms alone: the chest at the origin, then `ARM_JOINTS` and the ten fingertips.

    Raises BodysenseError if the skeleton lacks one of them.
    """
    joints = (CHEST, *ARM_JOINTS)
    tips = tuple(f"{side}_{finger}_tip" for side in SIDES for finger in FINGERS)
    places = skeleton.indices([*joints, *tips])
    order = {int(place): k for k, place in enumerate(places)}
    parents = (-1, *(order[skeleton.parents[place]] for place in places[1:]))
    offset = skeleton.rest_offset[places].copy()
    offset[0] = 0.0
    return Skeleton(joints, tips, parents, offset)


def arm_rotations(pose: Pose) -> np.ndarray:
    """Return the local rotations (..., 38, 4) of `ARM_JOINTS`."""
    return np.asarray(pose.rotation[..., pose.skeleton.indices(ARM_JOINTS), :])


def with_arms(pose: Pose, rotation: np.ndarray) -> Pose:
    """Replace the local rotations (..., 38, 4) of `ARM_JOINTS` in a pose."""
    turned = np.array(np.broadcast_to(pose.rotation, (*rotation.shape[:-2], *pose.rotation.shape[-2:])))
    turned[..., pose.skeleton.indices(ARM_JOINTS), :] = rotation
    root = np.broadcast_to(pose.root_position, (*rotation.shape[:-2], 3))
    return replace(pose, root_position=root.copy(), rotation=turned)
