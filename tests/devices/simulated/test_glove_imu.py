"""Simulated inertial sensors of gloves: their rotations and their errors."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.hands.hand import HAND_JOINTS, hand_skeleton
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.simulated.device import simulate
from bodysense.devices.simulated.glove_imu import GloveImuNoise, observe_fingers
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.io.clip import Clip
from bodysense.observing.checks import check_observation

UP = np.array([0.0, 1.0, 0.0])
ONLY = {name: 0.0 for name in ("heading", "tilt", "drift", "strap", "white")}


def test_exact_sensors_have_the_rotations_of_the_joints(waving_clip: Clip) -> None:
    found = check_observation(simulate(waving_clip, "gloves_imu"))
    markers = simulate(waving_clip, "gloves")
    assert found.points[:18] == markers.points
    np.testing.assert_array_equal(found.position[:, :18], markers.position)
    names = tuple(f"{side}_{joint}" for side in ("left", "right") for joint in HAND_JOINTS)
    assert found.points[18:] == names and not found.has_position[:, 18:].any() and found.has_rotation[:, 18:].all()
    true = np.asarray(forward_kinematics(waving_clip.pose)[1])[:, waving_clip.pose.skeleton.indices(names)]
    assert geodesic_angle(found.rotation[:, 18:], true).max() < 1e-6


def still(frames: int) -> Pose:
    return rest_pose(hand_skeleton(default_skeleton(), "left"), (frames,))


def errors(noise: GloveImuNoise, seconds: float = 60.0) -> np.ndarray:
    """Return errors (T, 480, 4), in the world, of the sensors of 30 still hands at 1 Hz."""
    pose, time = still(int(seconds) + 1), np.arange(int(seconds) + 1.0)
    exact = observe_fingers({"left": pose}, time)
    parts = []
    for seed in range(30):
        wrong = observe_fingers({"left": pose}, time, np.random.default_rng(seed), noise)
        np.testing.assert_array_equal(wrong.time, time)
        parts.append(np.asarray(quaternion_multiply(wrong.rotation, quaternion_conjugate(exact.rotation))))
    return np.concatenate(parts, axis=1)


def degrees(rotation: np.ndarray) -> np.ndarray:
    return np.degrees(geodesic_angle(rotation, np.array([1.0, 0.0, 0.0, 0.0])))


def test_constant_drift_is_about_the_vertical_and_grows_since_the_calibration() -> None:
    wrong = errors(GloveImuNoise(**(ONLY | {"drift": 0.1}), session_age=20.0))
    np.testing.assert_allclose(quaternion_rotate(wrong, UP), np.broadcast_to(UP, (*wrong.shape[:-1], 3)), atol=1e-9)
    angle = degrees(wrong)
    np.testing.assert_allclose(angle[60], angle[0] * 80 / 20, rtol=1e-6)
    assert np.sqrt((angle[0] ** 2).mean()) == pytest.approx(2.0, rel=0.15)


def test_errors_have_their_given_sizes() -> None:
    for name, size, axes in (("heading", 3.0, 1), ("strap", 2.0, 3), ("white", 0.5, 3)):
        wrong = errors(GloveImuNoise(**(ONLY | {name: size})), 20.0)
        assert np.sqrt((degrees(wrong) ** 2).mean() / axes) == pytest.approx(size, rel=0.15), name
    up = quaternion_rotate(errors(GloveImuNoise(**(ONLY | {"tilt": 1.0}))), UP)
    lean = np.degrees(np.arccos(np.clip(up @ UP, -1, 1)))
    assert np.sqrt((lean**2).mean() / 2) == pytest.approx(1.0, rel=0.2)
    # A strap shifts once; noise differs in every frame.
    strap, white = (errors(GloveImuNoise(**(ONLY | {name: 1.0})), 5.0) for name in ("strap", "white"))
    assert geodesic_angle(strap[0], strap[-1]).max() < 1e-6
    assert geodesic_angle(white[0], white[-1]).mean() > np.radians(1.0)


def test_bad_settings_are_refused() -> None:
    with pytest.raises(BodysenseError, match="glove IMUs: drift is -1; give 0 or more"):
        GloveImuNoise(drift=-1.0)
