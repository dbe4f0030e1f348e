"""Arm twist: how far a bone of an arm is turned about itself, which positions of joints do not tell.

PAHMT (Liu et al. 2022) estimates arms and hands together because the hand tells the twist. What is measured is the
twist of the swing-twist split of local rotations; the comparison is inverse kinematics on true positions.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.arms import ARM_JOINTS, ARM_PARTS, SIDES, arm_skeleton, with_arms
from bodysense.body.ik import IkSettings, InverseKinematics, solve_sequence
from bodysense.body.keypoints import arms_from_torso
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.rotation import geodesic_angle, quaternion_conjugate, quaternion_multiply, swing_twist
from bodysense.body.skeleton import Skeleton

TWISTS = ("upper_arm", "forearm")
ARMS = tuple(k for k, name in enumerate(ARM_JOINTS) if name.partition("_")[2] in ARM_PARTS)  # all but fingers


def twist_errors(said: np.ndarray, truth: np.ndarray, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Difference of the twists about the bones, degrees, (..., 2) of left and right, of rotations (..., 38, 4).

    Keys are `upper_arm_twist_deg` and `forearm_twist_deg`; bones are the skeleton's, whose arms the rotations turn. A
    forearm's twist is that of elbow and wrist together: motion capture puts it into either.
    """
    ours, true = _twists(said, skeleton), _twists(truth, skeleton)
    angles = {bone: np.degrees(np.asarray(geodesic_angle(ours[bone], true[bone]))) for bone in TWISTS}
    return {f"{bone}_twist_deg": angle for bone, angle in angles.items()}


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


def arm_errors(said: np.ndarray, truth: np.ndarray, skeleton: Skeleton) -> dict[str, np.ndarray]:
    """Errors of estimated rotations (T, 38, 4) beside true ones, both as of `arms_from_torso`, on a skeleton's arms.

    `overall_cm` (T, P) of all joints of both arms and hands, from the torso; `hands_cm` (T, P') of finger joints and
    tips, from their wrist and in its axes; `arms_deg` (T, 8) the geodesic angle of collars, upper arms, forearms and
    hands; and the twists. Both bodies have the skeleton's lengths, so that rotations alone are compared.
    """
    arms = arm_skeleton(skeleton)
    fingers = arms.wrist_of >= 0
    overall, hands = [], []
    for rotation in (said, truth):
        overall.append(_places(arms, rotation)[:, 1:])
        still = rotation.copy()
        still[:, ARMS] = [1.0, 0.0, 0.0, 0.0]
        place = _places(arms, still)
        hands.append(place[:, fingers] - place[:, arms.wrist_of[fingers]])
    return {
        "overall_cm": 100 * np.linalg.norm(overall[0] - overall[1], axis=-1),
        "hands_cm": 100 * np.linalg.norm(hands[0] - hands[1], axis=-1),
        "arms_deg": np.degrees(np.asarray(geodesic_angle(said[:, ARMS], truth[:, ARMS]))),
    } | twist_errors(said, truth, skeleton)


def solved_from_positions(truth: Pose) -> np.ndarray:
    """Rotations (T, 38, 4), as of `arms_from_torso`, that inverse kinematics finds for true positions of every point.

    The best that positions can do: no video gives as much. Twists that they leave open are those of the body's
    relaxed posture (`body/ik.py`).
    """
    position = np.asarray(forward_kinematics(truth)[0])
    ik = InverseKinematics(truth.skeleton, IkSettings(max_iterations=50))
    return arms_from_torso(solve_sequence(ik, position))


def _places(arms: Skeleton, rotation: np.ndarray) -> np.ndarray:
    """(T, P, 3) m: the points of arms alone."""
    return np.asarray(forward_kinematics(with_arms(rest_pose(arms, rotation.shape[:1]), rotation))[0])
