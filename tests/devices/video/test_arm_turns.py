"""Rotations of arms aligned with other lines, and of hands by their landmarks."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.arms import ARM_JOINTS, ARM_POINTS, HAND_POINTS, SIDES, arm_skeleton
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.arm_geometry.turns import align_arms, palm_rotations, with_palms
from bodysense.geometry.rotation import (
    normalize,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
)

ARMS = arm_skeleton(default_skeleton())
JOINT = {name: ARM_JOINTS.index(name) for name in ARM_JOINTS}


def posed(bend: float, seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rotations (38, 4), bones (2, 2, 3) and hands (2, 21, 3) of arms with elbows bent by `bend` degrees."""
    rng = np.random.default_rng(seed)
    rotation = np.asarray(quaternion_exp(0.3 * rng.normal(size=(len(ARM_JOINTS) + 1, 3))))
    for side, sign in (("left", -1.0), ("right", 1.0)):
        rotation[1 + JOINT[f"{side}_elbow"]] = quaternion_exp(np.array([0.0, sign * np.radians(bend), 0.0]))
    position, turned = map(np.asarray, forward_kinematics(Pose(ARMS, np.zeros(3), rotation)))
    joints = ARMS.indices([f"{side}_{part}" for side in SIDES for part in ARM_POINTS]).reshape(2, 3)
    hands = ARMS.indices([f"{side}_{name}" for side in SIDES for name in HAND_POINTS]).reshape(2, 21)
    return turned[1:], np.asarray(normalize(np.diff(position[joints], axis=1))), position[hands]


def apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the angles (degrees) between rotations (..., 4)."""
    turn = np.asarray(quaternion_log(quaternion_multiply(second, quaternion_conjugate(first))))
    return np.degrees(np.linalg.norm(turn, axis=-1))


def local(turned: np.ndarray, joint: str, parent: str) -> np.ndarray:
    """Return the local rotations (2, 4) of a joint of both sides."""
    own, above = (turned[[JOINT[f"{side}_{name}"] for side in SIDES]] for name in (joint, parent))
    return np.asarray(quaternion_multiply(quaternion_conjugate(above), own))


def test_arms_on_their_own_lines_are_unchanged() -> None:
    turned, bones, _ = posed(60.0)
    assert apart(turned, align_arms(turned, bones, bones)).max() < 1e-3


def test_bones_point_along_their_lines() -> None:
    turned, bones, _ = posed(60.0)
    lines = np.asarray(normalize(bones + 0.3 * np.random.default_rng(2).normal(size=bones.shape)))
    aligned = align_arms(turned, bones, lines)
    for k, part in enumerate(("shoulder", "elbow")):
        places = [JOINT[f"{side}_{part}"] for side in SIDES]
        own = quaternion_rotate(quaternion_conjugate(turned[places]), bones[:, k])
        np.testing.assert_allclose(quaternion_rotate(aligned[places], own), lines[:, k], atol=1e-6)


@pytest.mark.parametrize("bend, most", [(90.0, 4.0), (60.0, 5.0)])
def test_a_bent_elbow_determines_the_twist_of_the_upper_arm(bend: float, most: float) -> None:
    """A twist of 30° about the upper arms is found from directions of bones."""
    turned, bones, _ = posed(bend)
    twist = np.asarray(quaternion_exp(np.radians(30.0) * bones[:, 0]))
    lines = np.stack([bones[:, 0], np.asarray(quaternion_rotate(twist, bones[:, 1]))], axis=1)
    aligned = align_arms(turned, bones, lines)
    upper = [JOINT[f"{side}_shoulder"] for side in SIDES]
    assert apart(aligned[upper], np.asarray(quaternion_multiply(twist, turned[upper]))).max() < most
    assert apart(local(aligned, "elbow", "shoulder"), local(turned, "elbow", "shoulder")).max() < most
    np.testing.assert_allclose(local(aligned, "wrist", "elbow"), local(turned, "wrist", "elbow"), atol=1e-6)


def test_a_straight_elbow_does_not_twist_its_upper_arm() -> None:
    turned, bones, _ = posed(1.0)
    twist = np.asarray(quaternion_exp(np.radians(90.0) * bones[:, 0]))
    lines = np.stack([bones[:, 0], np.asarray(quaternion_rotate(twist, bones[:, 1]))], axis=1)
    assert apart(turned, align_arms(turned, bones, lines)).max() < 2.0


def test_palms_of_a_body_equal_its_hands() -> None:
    turned, _, hands = posed(40.0)
    wrists = turned[[JOINT[f"{side}_wrist"] for side in SIDES]]
    assert apart(wrists, palm_rotations(hands, default_skeleton())).max() < 1e-3


def test_hands_and_fingers_turn_halfway_to_their_landmarks() -> None:
    turned, _, _ = posed(40.0)
    wrists = [JOINT[f"{side}_wrist"] for side in SIDES]

    def with_palm_turned(degrees: float) -> np.ndarray:
        turn = quaternion_exp(np.radians(degrees) * np.array([0.6, 0.0, 0.8]))
        return with_palms(turned, np.asarray(quaternion_multiply(turn, turned[wrists])), np.array([True, False]))

    near = with_palm_turned(10.0)
    assert apart(turned, near)[wrists[0]] == pytest.approx(5.0, abs=0.2)
    assert apart(turned, near)[JOINT["left_index1"]] == pytest.approx(5.0, abs=0.2)
    assert apart(turned, near)[JOINT["left_elbow"]] < 1e-6
    assert apart(turned, near)[[JOINT[name] for name in ARM_JOINTS if name.startswith("right")]].max() < 1e-6
    assert apart(turned, with_palm_turned(170.0))[wrists[0]] < 3.0, (
        "the landmarks confuse the back of the hand with its palm"
    )
