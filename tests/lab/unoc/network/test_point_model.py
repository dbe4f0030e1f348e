"""Fingers and upper bodies at run time: streaming is the whole, files that are not ours, hands that are lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import bodysense.weights
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.resting import local_offset
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.observation import Observation
from bodysense_lab.papers.unoc.fingers import FingerSynthesis, finger_rotations, synthesize
from bodysense_lab.papers.unoc.learned_upper_body import LEG_ERROR, LearnedUpperBody, fitted_arms, load_upper_body
from bodysense_lab.papers.unoc.point_model import PointModel, load_point_model

SKELETON = default_skeleton()
FINGER = np.flatnonzero(SKELETON.wrist_of >= 0)
FINGER_JOINTS = FINGER[len(SKELETON.joints) > FINGER]


@pytest.fixture(scope="module")
def fingers() -> PointModel:
    return load_point_model("fingers")


@pytest.fixture(scope="module")
def upper_body() -> LearnedUpperBody:
    return LearnedUpperBody(SKELETON, load_upper_body())


FINGERS = Path(bodysense.weights.__path__[0]) / "fingers.onnx"


# --- from positions to rotations


@settings(max_examples=20)
@given(seed=st.integers(0, 9999), frames=st.integers(1, 4))
def test_positions_of_this_hand_are_reached_exactly(seed: int, frames: int) -> None:
    """Fingers turned at random: the rotations that are found put every joint and tip back where it was."""
    rng = np.random.default_rng(seed)
    rotation = np.tile([1.0, 0, 0, 0], (frames, len(SKELETON.joints), 1))
    rotation[:, FINGER_JOINTS] = quaternion_exp(rng.uniform(-1.2, 1.2, size=(frames, len(FINGER_JOINTS), 3)))
    truth = local_offset(SKELETON, *forward_kinematics(Pose(SKELETON, np.zeros((frames, 3)), rotation)))[:, FINGER]
    joints, local = finger_rotations(SKELETON, truth, FINGER)
    np.testing.assert_array_equal(joints, FINGER_JOINTS)
    found = np.tile([1.0, 0, 0, 0], (frames, len(SKELETON.joints), 1))
    found[:, joints] = local
    again = local_offset(SKELETON, *forward_kinematics(Pose(SKELETON, np.zeros((frames, 3)), found)))[:, FINGER]
    np.testing.assert_allclose(again, truth, atol=1e-7)


@settings(max_examples=10)
@given(seed=st.integers(0, 9999))
def test_bones_do_not_twist(seed: int) -> None:
    """A turn by the shortest arc has its axis at right angles to the bone."""
    offset = np.random.default_rng(seed).normal(scale=0.1, size=(3, len(FINGER), 3))
    joints, local = finger_rotations(SKELETON, offset, FINGER)
    for k, joint in enumerate(joints.tolist()):
        bone = SKELETON.rest_offset[SKELETON.parents.index(joint)]
        axis = Rotation.from_quat(local[:, k], scalar_first=True).as_rotvec()
        np.testing.assert_allclose(axis @ bone / np.linalg.norm(bone), 0, atol=1e-6)


# --- synthesis


def test_the_state_before_the_first_frame_is_of_one_body_by_default() -> None:
    network = load_point_model("fingers")
    one, three = network.start(), network.start(3)
    assert one and all(values.shape[0] == 1 for values in one.values())
    for name, values in three.items():
        np.testing.assert_array_equal(values, np.repeat(one[name], 3, axis=0))


def test_the_body_is_untouched_and_fingers_are_rigid(fingers: PointModel, waving_clip: Clip) -> None:
    made = synthesize(waving_clip, fingers)
    body = np.setdiff1d(np.arange(len(SKELETON.joints)), FINGER_JOINTS)
    np.testing.assert_array_equal(made.pose.root_position, waving_clip.pose.root_position)
    np.testing.assert_array_equal(made.pose.rotation[:, body], waving_clip.pose.rotation[:, body])
    assert np.abs(made.pose.rotation[:, FINGER_JOINTS] - waving_clip.pose.rotation[:, FINGER_JOINTS]).max() > 0.01
    position, _ = forward_kinematics(made.pose)
    length = np.linalg.norm(position[:, 1:] - position[:, list(SKELETON.parents[1:])], axis=-1)
    np.testing.assert_allclose(length, np.tile(SKELETON.bone_length[1:], (len(made), 1)), atol=1e-9)
    assert made.has_fingers and made.name == waving_clip.name


def test_the_clips_own_fingers_are_not_read(fingers: PointModel, waving_clip: Clip) -> None:
    other = waving_clip.pose.rotation.copy()
    other[:, FINGER_JOINTS] = [1.0, 0, 0, 0]
    flat = replace(waving_clip, pose=replace(waving_clip.pose, rotation=other))
    first, second = (synthesize(clip, fingers).pose.rotation for clip in (waving_clip, flat))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("half_life", [0.0, 0.05])
def test_fingers_frame_by_frame_are_those_of_the_whole(
    fingers: PointModel, waving_clip: Clip, half_life: float
) -> None:
    method = FingerSynthesis(SKELETON, fingers, half_life)
    whole, _ = method.step(waving_clip.pose, waving_clip.time, method.start())
    state, rows = method.start(), []
    for t in range(len(waving_clip)):
        row, state = method.step(waving_clip.pose[t : t + 1], waving_clip.time[t : t + 1], state)
        rows.append(row)
    np.testing.assert_array_equal(np.concatenate(rows), whole)


def test_the_network_steps_at_its_own_rate(fingers: PointModel, waving_clip: Clip) -> None:
    """At 120 Hz every fourth frame is that of 30 Hz."""
    method = FingerSynthesis(SKELETON, fingers, half_life=0)
    fast = resample(waving_clip, 120.0)
    often, _ = method.step(fast.pose, fast.time, method.start())
    seldom, _ = method.step(fast.pose[::4], fast.time[::4], method.start())
    np.testing.assert_allclose(often[::4], seldom, atol=1e-6)


def test_smoothing_closes_half_of_a_jump_in_its_half_life(fingers: PointModel) -> None:
    method = FingerSynthesis(SKELETON, fingers, half_life=0.1)
    zero, one = np.zeros((2, 3)), np.ones((2, 3))
    for steps in (1, 7):
        state = method._smoothed(zero, 0.0, method.start())
        for k in range(steps):
            state = method._smoothed(one, 0.1 * (k + 1) / steps, state)
        assert state.offset is not None
        np.testing.assert_allclose(state.offset, 0.5, atol=1e-9)


def test_time_that_stands_still_is_refused(fingers: PointModel, waving_clip: Clip) -> None:
    method = FingerSynthesis(SKELETON, fingers)
    with pytest.raises(BodysenseError, match=r"a frame at 0 s came after one at 0 s; give frames in order of time"):
        method.step(waving_clip.pose[:2], np.zeros(2), method.start())
    with pytest.raises(BodysenseError, match=r"half-life -1 s: give 0 or more seconds"):
        FingerSynthesis(SKELETON, fingers, -1.0)


# --- the upper body


def test_an_upper_body_frame_by_frame_is_that_of_the_whole(upper_body: LearnedUpperBody, waving_clip: Clip) -> None:
    observation = observe(waving_clip.pose, waving_clip.time, THREE_POINT)
    whole, _ = upper_body.step(observation, upper_body.start())
    state, rows = upper_body.start(), []
    for t in range(len(observation)):
        row, state = upper_body.step(observation[t : t + 1], state)
        rows.append(row)
    for name in ("position", "confidence", "occluded"):
        np.testing.assert_array_equal(np.concatenate([getattr(row, name) for row in rows]), getattr(whole, name))


def test_every_point_is_predicted_and_measured_points_are_kept(upper_body: LearnedUpperBody, waving_clip: Clip) -> None:
    observation = observe(waving_clip.pose, waving_clip.time, THREE_POINT)
    estimate, _ = upper_body.step(observation, upper_body.start())
    assert np.isfinite(estimate.position).all() and (estimate.confidence > 0).all()
    np.testing.assert_array_equal(estimate.position[:, SKELETON.indices(observation.points)], observation.position)
    truth, _ = forward_kinematics(waving_clip.pose)
    top = SKELETON.index("head_top")
    np.testing.assert_allclose(estimate.position[:, top], truth[:, top], atol=1e-9)
    ankles = SKELETON.indices(["left_ankle", "right_ankle"])
    np.testing.assert_array_equal(estimate.confidence[:, ankles], LEG_ERROR)
    length = estimate.position[:, SKELETON.index("left_knee")] - estimate.position[:, ankles[0]]
    np.testing.assert_allclose(np.linalg.norm(length, axis=1), SKELETON.bone_length[ankles[0]], atol=1e-9)


@settings(max_examples=10)
@given(yaw=st.floats(-np.pi, np.pi))
def test_an_upper_body_turns_with_the_world(upper_body: LearnedUpperBody, waving_clip: Clip, yaw: float) -> None:
    turn, along = Rotation.from_rotvec([0, yaw, 0]), np.array([2.0, 0, -1])
    pose = waving_clip.pose[:5]
    rotation = pose.rotation.copy()
    rotation[:, 0] = (turn * Rotation.from_quat(rotation[:, 0], scalar_first=True)).as_quat(scalar_first=True)
    moved = Pose(SKELETON, turn.apply(pose.root_position) + along, rotation)
    here, there = (
        upper_body.step(observe(one, np.arange(5) / 30, THREE_POINT), upper_body.start())[0] for one in (pose, moved)
    )
    expected = turn.apply(here.position.reshape(-1, 3)).reshape(here.position.shape) + along
    np.testing.assert_allclose(there.position, expected, atol=1e-4)


def hidden(observation: Observation, point: int, frames: slice) -> Observation:
    values = {
        name: getattr(observation, name).copy() for name in ("position", "rotation", "has_position", "has_rotation")
    }
    values["position"][frames, point] = values["rotation"][frames, point] = np.nan
    values["has_position"][frames, point] = values["has_rotation"][frames, point] = False
    return replace(observation, **values)


@settings(max_examples=20)
@given(seed=st.integers(0, 9999))
def test_a_fitting_arm_is_unchanged_and_another_nearly_fits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shoulder, elbow, wrist = rng.normal(size=(3, 4, 3))
    upper, fore = (np.linalg.norm(a - b, axis=1, keepdims=True) for a, b in ((elbow, shoulder), (wrist, elbow)))
    for was, now in zip((shoulder, elbow), fitted_arms(shoulder, elbow, wrist, upper, fore), strict=True):
        np.testing.assert_allclose(now, was, atol=1e-9)
    noisy = elbow + rng.normal(scale=0.05, size=elbow.shape)
    s, e = fitted_arms(shoulder, noisy, wrist, upper, fore)
    before, after = (
        np.abs(np.linalg.norm(a - b, axis=1, keepdims=True) - upper) for a, b in ((noisy, shoulder), (e, s))
    )
    assert after.max() <= max(0.2 * before.max(), 0.02)


def test_a_hand_that_is_lost_goes_with_the_head(upper_body: LearnedUpperBody, waving_clip: Clip) -> None:
    observation = hidden(observe(waving_clip.pose, waving_clip.time, THREE_POINT), 1, slice(5, None))
    estimate, _ = upper_body.step(observation, upper_body.start())
    wrist, head = SKELETON.indices(["left_wrist", "head"])
    away = np.linalg.norm(estimate.position[:, wrist] - estimate.position[:, head], axis=1)
    np.testing.assert_allclose(away[5:], away[4], atol=1e-9)
    assert (estimate.confidence[5:, wrist] > 0.05).all() and (estimate.confidence[:5, wrist] < 0.05).all()


def test_before_the_first_signal_the_body_stands(upper_body: LearnedUpperBody, waving_clip: Clip) -> None:
    observation = observe(waving_clip.pose[:1], waving_clip.time[:1], THREE_POINT)
    for point in range(3):
        observation = hidden(observation, point, slice(None))
    estimate, _ = upper_body.step(observation, upper_body.start())
    assert np.isfinite(estimate.position).all()


# --- files that are not ours


def test_a_network_of_another_task_is_refused() -> None:
    with pytest.raises(BodysenseError, match=r"fingers\.onnx: a network for fingers, not upper-body; give the \.onnx"):
        load_point_model("upper-body", FINGERS)


def test_a_skeleton_with_other_points_is_refused(fingers: PointModel) -> None:
    other = Skeleton(("head", "left_wrist", "right_wrist"), (), (-1, 0, 0), np.zeros((3, 3)))
    with pytest.raises(
        BodysenseError, match=r"needs a skeleton of 65 points; .* has 3 and no pelvis: bring the motion"
    ):
        FingerSynthesis(other, fingers).start()


# --- the packaged networks
