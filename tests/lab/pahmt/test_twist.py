from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.body.arms import ARM_JOINTS, arm_rotations, with_arms
from bodysense.body.keypoints import arms_from_torso
from bodysense.body.pose import Pose, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_canonical
from bodysense.io.clip import Clip
from bodysense_lab.papers.pahmt.errors import ARMS, TWISTS, arm_errors, twist_errors
from bodysense_lab.papers.pahmt.tables import solved_from_positions

SKELETON = default_skeleton()


def quaternions(turn: Rotation) -> np.ndarray:
    return turn.as_quat(scalar_first=True)


def random_arms(seed: int, frames: int = 7) -> np.ndarray:
    turns = Rotation.random(frames * len(ARM_JOINTS), rng=np.random.default_rng(seed))
    return np.asarray(quaternion_canonical(quaternions(turns).reshape(frames, len(ARM_JOINTS), 4)))


def along(side: str, end: str) -> np.ndarray:
    bone = SKELETON.rest_offset[SKELETON.index(f"{side}_{end}")]
    return bone / np.linalg.norm(bone)


def twisted(arms: np.ndarray, joint: str, end: str, degrees: float) -> np.ndarray:
    """Arms whose joint is turned further: about the bone from it to `end`, or a wrist about the forearm."""
    arms = arms.copy()
    for side in ("left", "right"):
        place = ARM_JOINTS.index(f"{side}_{joint}")
        twist = Rotation.from_rotvec(np.radians(degrees) * along(side, end))
        turn = Rotation.from_quat(arms[:, place], scalar_first=True)
        arms[:, place] = quaternions(twist * turn if joint == end else turn * twist)
    return arms


@pytest.mark.parametrize("bone, joint, end", [("upper_arm", "shoulder", "elbow"), ("forearm", "elbow", "wrist")])
@pytest.mark.parametrize("degrees", [20.0, -75.0, 170.0])
def test_a_twist_about_the_bone_is_measured_whole(bone: str, joint: str, end: str, degrees: float) -> None:
    truth = random_arms(1)
    errors = twist_errors(twisted(truth, joint, end, degrees), truth, SKELETON)
    assert errors.keys() == {f"{name}_twist_deg" for name in TWISTS}
    for name in TWISTS:
        wanted = abs(degrees) if name == bone else 0.0
        assert errors[f"{name}_twist_deg"] == pytest.approx(np.full((7, 2), wanted), abs=1e-4)


def test_a_forearm_may_be_twisted_at_the_elbow_or_at_the_wrist() -> None:
    truth = random_arms(6)
    at_wrist = twisted(truth, "wrist", "wrist", 50.0)
    assert twist_errors(at_wrist, truth, SKELETON)["forearm_twist_deg"] == pytest.approx(np.full((7, 2), 50), abs=1e-4)
    at_elbow = twisted(truth, "elbow", "wrist", 50.0)
    assert twist_errors(at_wrist, at_elbow, SKELETON)["forearm_twist_deg"] == pytest.approx(np.zeros((7, 2)), abs=1e-4)


def test_a_swing_is_no_twist() -> None:
    """A forearm that is straight at rest and bends about an axis across it keeps its twist."""
    truth = arm_rotations(rest_pose(SKELETON, (3,)))
    predicted = truth.copy()
    predicted[:, ARM_JOINTS.index("left_elbow")] = quaternions(
        Rotation.from_rotvec(np.outer([0.3, -1.0, 1.5], [0, 1, 0]))
    )
    assert twist_errors(predicted, truth, SKELETON)["forearm_twist_deg"] == pytest.approx(np.zeros((3, 2)), abs=1e-5)


def test_batches_are_their_parts() -> None:
    predicted, truth = random_arms(2, 6), random_arms(3, 6)
    whole = twist_errors(predicted, truth, SKELETON)
    parts = twist_errors(predicted.reshape(2, 3, -1, 4), truth.reshape(2, 3, -1, 4), SKELETON)
    for name, values in whole.items():
        assert parts[name] == pytest.approx(values.reshape(2, 3, 2))


def test_the_truth_has_no_error() -> None:
    truth = random_arms(4)
    for values in arm_errors(truth, -truth, SKELETON).values():  # −q is the same turn
        assert np.abs(values).max() < 1e-4


def test_an_arm_that_is_wrong_moves_its_hand_but_not_its_fingers() -> None:
    truth = arm_rotations(rest_pose(SKELETON, (1,)))
    predicted, turn = truth.copy(), np.radians(60.0)
    predicted[:, ARM_JOINTS.index("left_elbow")] = quaternions(Rotation.from_euler("y", turn))
    errors = arm_errors(predicted, truth, SKELETON)
    assert errors["hands_cm"].max() < 1e-9
    lengths = np.linalg.norm(SKELETON.rest_offset[SKELETON.indices(["left_wrist"])])
    moved = errors["overall_cm"][errors["overall_cm"] > 1e-9]
    assert moved.min() == pytest.approx(200 * lengths * np.sin(turn / 2))  # the wrist's chord
    assert errors["arms_deg"].max() == pytest.approx(60.0)
    assert errors["arms_deg"].mean() == pytest.approx(60.0 / len(ARMS))


def test_a_wrong_finger_is_wrong_in_the_hand() -> None:
    truth = random_arms(5, 2)
    predicted = truth.copy()
    predicted[:, ARM_JOINTS.index("right_index3")] = quaternions(Rotation.random(rng=np.random.default_rng(1)))
    errors = arm_errors(predicted, truth, SKELETON)
    assert (errors["hands_cm"] > 1e-6).sum() == 2, "a tip a frame"
    assert (errors["overall_cm"] > 1e-6).sum() == 2
    assert errors["arms_deg"].max() < 1e-4


def test_positions_leave_the_twist_of_a_straight_arm_open(waving_clip: Clip) -> None:
    """The hand determines the forearm's twist; nothing determines the twist of shoulders above straight arms."""
    pose = waving_clip.pose[:12]
    arms = arm_rotations(pose).copy()
    for side in ("left", "right"):
        shoulder, elbow = (ARM_JOINTS.index(f"{side}_{name}") for name in ("shoulder", "elbow"))
        half_turn = Rotation.from_rotvec(1.0 * along(side, "elbow"))
        arms[:, shoulder] = quaternions(Rotation.from_quat(arms[:, shoulder], scalar_first=True) * half_turn)
        arms[:, elbow] = quaternions(half_turn.inv())  # straight, and untwisted for what hangs below
    truth = with_arms(Pose(pose.skeleton, pose.root_position, pose.rotation), arms)
    errors = arm_errors(solved_from_positions(truth), arms_from_torso(truth), truth.skeleton)
    assert errors["overall_cm"].mean() < 0.2
    assert errors["upper_arm_twist_deg"].mean() > 20
