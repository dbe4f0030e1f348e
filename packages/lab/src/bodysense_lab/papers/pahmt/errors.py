"""Errors of rotations of arms and hands, on arms of given lengths (PAHMT, Table 1).

Arm twist is how far a bone of an arm is turned about itself, which positions of joints do not tell. The paper estimates
arms and hands together because the hand tells the twist. It is measured as the twist of the swing-twist split of local
rotations; the comparison is inverse kinematics on true positions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bodysense.body.arms import ARM_JOINTS, SIDES, arm_skeleton, with_arms
from bodysense.body.pose import forward_kinematics, rest_pose
from bodysense.body.skeleton import ARM, Skeleton, default_skeleton
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_log,
    quaternion_multiply,
    swing_twist,
)
from bodysense.quality.metrics import joint_error
from bodysense_lab.papers.pahmt.options import FINGERS

TWISTS = ("upper_arm", "forearm")
ARMS = tuple(k for k, name in enumerate(ARM_JOINTS) if name.partition("_")[2] in ARM)  # all but fingers
EVERY = tuple(range(len(ARM_JOINTS)))


def arm_errors(
    predicted: np.ndarray, truth: np.ndarray, skeleton: Skeleton, joints: Sequence[int] = EVERY
) -> dict[str, np.ndarray]:
    """Compute errors of rotations (..., N, 4) of `joints`, truth (..., 38, 4), both in the form of `arms_from_torso`.

    `hands_cm` of finger joints and tips from their wrist, in its axes; `fingers_deg` the geodesic angle of fingers.
    With all joints also `overall_cm` of all joints of both arms and hands, from the torso; `arms_deg` the geodesic
    angle of collars, upper arms, forearms and hands, `arms_rad` their mean absolute difference of axis-angle
    components, the paper's MPJRE; and the twists. Both bodies have the skeleton's lengths, so that rotations alone are
    compared.
    """
    arms, whole = arm_skeleton(skeleton), truth.copy()
    whole[..., list(joints), :] = predicted
    angle = np.degrees(np.asarray(geodesic_angle(whole, truth)))
    hands = (_from_wrist(arms, one) for one in (whole, truth))
    found = {"hands_cm": joint_error(*hands), "fingers_deg": angle[..., FINGERS]}
    if len(joints) < len(EVERY):
        return found
    overall = (_places(arms, one)[..., 1:, :] for one in (whole, truth))
    ours, true = (quaternion_log(np.asarray(quaternion_canonical(one[..., ARMS, :]))) for one in (whole, truth))
    return found | {
        "overall_cm": joint_error(*overall),
        "arms_deg": angle[..., ARMS],
        "arms_rad": np.abs(np.asarray(ours) - np.asarray(true)).mean(axis=-1),
        **twist_errors(whole, truth, skeleton),
    }


def table_errors(predicted: np.ndarray, truth: np.ndarray, joints: Sequence[int]) -> dict[str, np.ndarray]:
    """Return `arm_errors` on the default body in the units of Table 1: `hands_m`, `overall_m`, `arms` in radians."""
    names = {"hands_cm": ("hands_m", 0.01), "overall_cm": ("overall_m", 0.01), "arms_rad": ("arms", 1.0)}
    found = {}
    for measure, values in arm_errors(predicted, truth, default_skeleton(), joints).items():
        name, factor = names.get(measure, (measure, 1.0))
        found[name] = factor * values
    return found


def twist_errors(predicted: np.ndarray, truth: np.ndarray, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Return differences (..., 2), degrees, of the twists about left and right bones, of rotations (..., 38, 4).

    Keys are `upper_arm_twist_deg` and `forearm_twist_deg`; bones are the skeleton's, whose arms the rotations turn. A
    forearm's twist is that of elbow and wrist together: motion capture puts it into either.
    """
    ours, true = _twists(predicted, skeleton), _twists(truth, skeleton)
    return {f"{bone}_twist_deg": np.degrees(np.asarray(geodesic_angle(ours[bone], true[bone]))) for bone in TWISTS}


def _twists(rotation: np.ndarray, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """By bone the twist (..., 2, 4) of both sides."""

    def turn(joint: str) -> np.ndarray:
        return rotation[..., [ARM_JOINTS.index(f"{side}_{joint}") for side in SIDES], :].astype(float)

    def along(end: str) -> np.ndarray:
        bone = skeleton.rest_offset[skeleton.indices([f"{side}_{end}" for side in SIDES])]
        return np.broadcast_to(bone / np.linalg.norm(bone, axis=-1, keepdims=True), (*rotation.shape[:-2], 2, 3))

    elbow = swing_twist(turn("elbow"), along("wrist"))[1]
    wrist = swing_twist(quaternion_conjugate(turn("wrist")), along("wrist"))[1]  # twist, then swing, from the forearm
    return {
        "upper_arm": np.asarray(swing_twist(turn("shoulder"), along("elbow"))[1]),
        "forearm": np.asarray(quaternion_multiply(elbow, quaternion_conjugate(wrist))),
    }


def _places(arms: Skeleton, rotation: np.ndarray) -> np.ndarray:
    """(..., P, 3) m: the points of arms alone."""
    return np.asarray(forward_kinematics(with_arms(rest_pose(arms, rotation.shape[:-2]), rotation))[0])


def _from_wrist(arms: Skeleton, rotation: np.ndarray) -> np.ndarray:
    """(..., F, 3) m: finger joints and tips from their wrist, in its axes."""
    still = rotation.copy()
    still[..., ARMS, :] = [1.0, 0.0, 0.0, 0.0]
    place, fingers = _places(arms, still), arms.wrist_of >= 0
    return place[..., fingers, :] - place[..., arms.wrist_of[fingers], :]
