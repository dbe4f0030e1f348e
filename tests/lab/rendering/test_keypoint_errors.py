from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.keypoints import ArmKeypoints, Camera
from bodysense.geometry.rotation import normalize, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense_lab.papers.pahmt.camera_view import FRONT, sample_cameras, view, view_points
from bodysense_lab.papers.pahmt.keypoint_noise import DetectorNoise, detect, flattened
from bodysense_lab.rendering.keypoint_errors import ARM_BONES, keypoint_errors, noise_figures


@pytest.fixture(scope="module")
def true(waving_clip: Clip) -> ArmKeypoints:
    points = view_points(waving_clip.pose)
    camera = sample_cameras(points[:1], np.random.default_rng(0), FRONT)
    camera = Camera(camera.position[0], camera.axes[0], camera.focal[0], camera.aspect[0])
    return view(points, waving_clip.time, camera)


def test_the_truth_has_no_errors(true: ArmKeypoints) -> None:
    figures = noise_figures([keypoint_errors(true, true)])
    figures.pop("depth")  # 0 / 0
    assert [figures.pop(f"{bone}_depth_kept") for bone in ARM_BONES] == pytest.approx([1.0, 1.0])
    assert figures.pop("arm_jitter") < 0.5  # the detector's model flattens arms that point at the camera
    assert all(value == pytest.approx(0, abs=1e-9) for value in figures.values())


def test_known_errors_are_measured(true: ArmKeypoints) -> None:
    rng = np.random.default_rng(1)
    frames = len(true)
    jitter = rng.normal(0, [0.02, 0.02, 0.05], (frames, 2, 2, 3))
    turn = quaternion_exp(np.radians([0.0, 9.0, 0.0]) + np.radians(rng.normal(0, 2.0, (frames, 3))))
    middle = true.hand.mean(axis=-2, keepdims=True)
    found = replace(
        true,
        arm=true.arm + jitter,
        torso=np.asarray(quaternion_multiply(turn, true.torso)),
        hand=middle + 0.3 + 1.1 * (true.hand - middle),  # displaced and larger
        has_hand=true.has_hand & (np.arange(frames) % 4 > 0)[:, None],
    )
    flat = flattened(true.arm, np.array([0.7, 0.5]), np.array([0.0, 0.2]))
    measured = noise_figures([keypoint_errors(replace(true, arm=flat), true)])
    assert [measured[f"{bone}_depth_kept"] for bone in ARM_BONES] == pytest.approx([0.7, 0.5])
    assert [measured[f"{bone}_nearer"] for bone in ARM_BONES] == pytest.approx([0.0, 0.2])
    assert measured["arm_drift"] == pytest.approx(0.0, abs=1e-6)
    figures = noise_figures([keypoint_errors(found, true)])
    assert figures["arm_jitter"] == pytest.approx(np.degrees(0.02), rel=0.15)
    assert figures["arm_drift"] < 0.5 * figures["arm_jitter"]
    assert figures["depth"] == pytest.approx(2.5, rel=0.15)
    assert figures["torso_jitter"] == pytest.approx(2.0, rel=0.15)
    assert figures["torso_drift"] == pytest.approx(9.0 / np.sqrt(3), rel=0.15)  # about one axis of three
    assert figures["hand_shape"] == pytest.approx(0.1 / np.sqrt(2))  # on the diagonal of a 2 × 2 matrix
    assert figures["hand_drift"] == pytest.approx(0, abs=1e-9)
    assert figures["missed"] == pytest.approx(np.mean((np.arange(frames) % 4 == 0)[true.has_hand[:, 0]]), abs=0.02)


def test_the_simulated_detector_has_the_errors_of_its_settings(true: ArmKeypoints) -> None:
    """Measured errors of the simulated detector equal the fields of its settings."""
    quiet = DetectorNoise(
        **dict.fromkeys(("hand_shape", "blur", "missed", "missed_fast", "lost", "swapped", "arm_missed"), 0.0),
        small=1e-6,
        quality=0.0,
        arm_drift=0.0,
        depth_kept=(1.0, 1.0),
        depth_kept_spread=(0.0, 0.0),
        nearer=(0.0, 0.0),
        nearer_spread=(0.0, 0.0),
        arm_jitter=1.0,
        hand_drift=0.0,
        hand_jitter=0.01,
    )
    parts = [keypoint_errors(detect(true, quiet, np.random.default_rng(seed)), true) for seed in range(5)]
    figures = noise_figures(parts)
    assert figures["arm_jitter"] == pytest.approx(1.0, rel=0.35)  # a little less, because directions are normalised
    assert figures["hand_jitter"] == pytest.approx(0.01, rel=0.15)
    assert figures["missed"] == pytest.approx(0.0, abs=1e-3)


def test_figures_without_detections_are_nan(true: ArmKeypoints) -> None:
    nothing = replace(
        true,
        has_arm=np.zeros_like(true.has_arm),
        has_torso=np.zeros_like(true.has_torso),
        has_hand=np.zeros_like(true.has_hand),
        arm=np.asarray(normalize(true.arm)) * np.nan,
        hand=true.hand * np.nan,
    )
    figures = noise_figures([keypoint_errors(nothing, true)])
    assert figures["missed"] == figures["arm_missed"] == 1.0
    assert np.isnan([figures["arm_drift"], figures["hand_jitter"], figures["torso_drift"]]).all()
