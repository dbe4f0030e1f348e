"""Tracker noise: it has the measured statistics and leaves everything else unchanged."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from bodysense.devices.simulated.noise import NoiseSettings, disturb
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation

RATE = 72.0
STILL_MAP = NoiseSettings(scale=0.0)
BANDS = ((0.05, 0.3), (0.3, 1.0), (1.0, 3.0))  # Hz; above these, the robot's own errors dominate


def turns(quaternion: np.ndarray) -> Rotation:
    return Rotation.from_quat(quaternion[..., [1, 2, 3, 0]].reshape(-1, 4))


def moving_head(speed: float, sessions: int = 4, seconds: float = 60.0, points: tuple[str, ...] = ("head",)):
    """Return sessions (B, T, P) of points that move on a circle at `speed` m/s and turn at 100 `speed` °/s."""
    time = np.arange(round(seconds * RATE)) / RATE
    angle = speed * time / 0.5
    place = 0.5 * np.stack([np.cos(angle), 3.2 + 0 * angle, np.sin(angle)], axis=-1)
    turn = Rotation.from_rotvec(np.radians(100 * speed * time)[:, None] * [0.0, 1.0, 0.0]).as_quat()[:, [3, 0, 1, 2]]
    shape = (sessions, len(time), len(points))
    known = np.ones(shape, dtype=bool)
    return Observation(
        points=points,
        position=np.broadcast_to(place[:, None], (*shape, 3)).copy(),
        rotation=np.broadcast_to(turn[:, None], (*shape, 4)).copy(),
        has_position=known,
        has_rotation=known.copy(),
        accuracy=np.full(shape, 0.001),
        time=time,
    )


def errors(seen: Observation, settings: NoiseSettings = STILL_MAP, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (B, T, P, 3) of a disturbed observation, in mm and °."""
    noisy = disturb(seen, np.random.default_rng(seed), settings)
    turned = (turns(noisy.rotation) * turns(seen.rotation).inv()).as_rotvec(degrees=True)
    return 1000 * (noisy.position - seen.position), turned.reshape(seen.position.shape)


def rms(values: np.ndarray) -> float:
    """Return the root mean square length of vectors."""
    return float(np.sqrt((values**2).sum(axis=-1).mean()))


@pytest.mark.parametrize("speed", [0.05, 0.5])
def test_errors_have_the_fitted_deviations(speed: float) -> None:
    position, rotation = errors(moving_head(speed))
    drift, wobble = 0.8 * (0.37 + 1.2 * speed), 0.65 * speed
    expected = np.sqrt(3 * (drift**2 + 0.145**2 + wobble**2 + 0.01**2))
    assert 0.7 < rms(position) / expected < 1.3
    drift, wobble = 0.8 * (0.014 + 0.14 * speed), 0.12 * speed
    expected = np.sqrt(3 * (drift**2 + 0.003**2 + wobble**2 + 0.0025**2))
    assert 0.7 < rms(rotation) / expected < 1.3


def test_errors_of_head_like_paths_match_the_measurement() -> None:
    """Positions have errors of 0.8 to 1.5 mm rms, 99 % within 1.5 to 3.7 mm; rotations of 0.09 to 0.33°."""
    for speed in (0.2, 0.4):
        position, rotation = errors(moving_head(speed))
        assert 0.7 * 0.8 < rms(position) < 1.3 * 1.5
        assert 0.7 * 1.5 < np.percentile(np.linalg.norm(position, axis=-1), 99) < 1.3 * 3.7
        assert 0.7 * 0.09 < rms(rotation) < 1.3 * 0.33


@pytest.mark.parametrize("speed", [0.2, 0.4])
def test_drift_depends_on_the_travelled_distance(speed: float) -> None:
    """Its correlation falls to 1/e after 0.23 to 0.39 m, at any speed."""
    position, _ = errors(moving_head(speed, sessions=8, seconds=60.0))
    slow = signal.sosfiltfilt(signal.butter(2, 3.0, fs=RATE, output="sos"), position, axis=1)
    lags = np.arange(1, round(1.0 / speed * RATE), 4)
    correlation = np.array([(slow[:, lag:] * slow[:, :-lag]).mean() for lag in lags]) / (slow**2).mean()
    distance = speed * lags[np.argmax(correlation < 1 / np.e)] / RATE
    assert 0.7 * 0.23 < distance < 1.3 * 0.39


def test_at_rest_there_is_almost_no_white_noise() -> None:
    """Errors change by microns from frame to frame."""
    position, rotation = errors(moving_head(0.0))
    fresh = np.diff(position, 2, axis=1)
    assert rms(fresh) / np.sqrt(6 * 3) < 0.01
    assert rms(np.diff(rotation, 2, axis=1)) / np.sqrt(6 * 3) < 0.001
    slow = position - position.mean(axis=1, keepdims=True)
    assert 0.7 * 0.145 < np.sqrt((slow**2).mean()) < 1.3 * 0.145


def test_errors_above_twenty_hertz_are_small() -> None:
    """They are below those measured with a worn headset, 0.015 mm and 0.004°, which include the wearer's motion."""
    high = signal.butter(4, 20.0, "high", fs=RATE, output="sos")
    position, rotation = errors(moving_head(0.15, sessions=2, seconds=60.0))
    # Deviation along each axis, from the tail of the wobble and the white noise.
    assert np.sqrt((signal.sosfiltfilt(high, position, axis=1) ** 2).mean()) < 1.3 * 0.015
    assert np.sqrt((signal.sosfiltfilt(high, rotation, axis=1) ** 2).mean()) < 1.3 * 0.004


@pytest.mark.parametrize("take", ["quest2_traj1", "quest_pro_traj2"])
def test_errors_match_measured_takes_in_each_band(motion_data: Path, take: str) -> None:
    """On the true motion of a take, the model's deviations are those of the device, within 30 % on average."""
    if not (motion_data / "headset" / "headset_takes.npz").is_file():
        pytest.skip("no takes of headsets")
    with np.load(motion_data / "headset" / "headset_takes.npz") as takes:
        first, last = takes[f"{take}__moving_from_to_s"]
        chosen = (takes[f"{take}__time_s"] >= first) & (takes[f"{take}__time_s"] <= last)
        columns = ("time_s", "truth_pos_m", "truth_quat_xyzw", "device_pos_m", "device_quat_xyzw")
        time, place, turn, device, device_turn = (takes[f"{take}__{name}"][chosen].astype(float) for name in columns)
    sessions, known = 4, np.ones((4, len(time), 1), dtype=bool)
    truth = Observation(
        points=("head",),
        position=np.tile(place[None, :, None], (sessions, 1, 1, 1)),
        rotation=np.tile(Rotation.from_quat(turn).as_quat()[None, :, None][..., [3, 0, 1, 2]], (sessions, 1, 1, 1)),
        has_position=known,
        has_rotation=known,
        accuracy=np.full(known.shape, 0.001),
        time=time,
    )
    measured = (1000 * (device - place), (Rotation.from_quat(device_turn) * Rotation.from_quat(turn).inv()).as_rotvec())
    simulated = errors(truth)
    for real, ours in zip((measured[0], np.degrees(measured[1])), simulated, strict=True):
        ratio = [np.log(in_bands(one) / in_bands(real)) for one in ours[:, :, 0]]
        of_bands = np.exp(np.mean(ratio, axis=0))
        assert 0.7 < np.exp(np.mean(ratio)) < 1.3, of_bands
        assert (of_bands > 0.6).all() and (of_bands < 1.5).all(), of_bands


def in_bands(error: np.ndarray) -> np.ndarray:
    frequency, power = signal.welch(error, RATE, nperseg=1024, axis=0)
    return np.array([np.sqrt(power[(frequency >= a) & (frequency < b)].sum()) for a, b in BANDS])


def test_controllers_have_larger_errors_and_cameras_the_largest() -> None:
    seen = moving_head(0.3, sessions=3, seconds=60.0, points=("head", "left_wrist"))
    position, rotation = errors(seen)
    assert 2.0 < rms(position[:, :, 1]) / rms(position[:, :, 0]) < 3.0
    assert 2.0 < rms(rotation[:, :, 1]) / rms(rotation[:, :, 0]) < 3.0
    position, rotation = errors(seen, replace(STILL_MAP, cameras=True))
    of_session = np.sqrt((position[:, :, 1] ** 2).sum(axis=-1).mean(axis=1))
    assert (of_session > 0.7 * 3).all() and (of_session < 1.3 * 8).all() and np.ptp(of_session) > 1
    of_session = np.sqrt((rotation[:, :, 1] ** 2).sum(axis=-1).mean(axis=1))
    assert (of_session > 0.7 * 2).all() and (of_session < 1.3 * 5).all()
    assert rms(position[:, :, 0]) < 1.5


def test_points_with_rotation_only_are_imus() -> None:
    seen = moving_head(0.3, sessions=20, seconds=20.0, points=("head", "left_knee"))
    seen.has_position[..., 1] = False
    seen.position[..., 1, :] = np.nan
    noisy = check_observation(disturb(seen, np.random.default_rng(0), STILL_MAP))
    turned = (turns(noisy.rotation) * turns(seen.rotation).inv()).as_rotvec(degrees=True)
    deviation = np.sqrt((turned.reshape(*seen.rotation.shape[:-1], 3)[:, :, 1] ** 2).mean(axis=(0, 1)))
    np.testing.assert_allclose(deviation, [0.7, 3.0, 0.7], rtol=0.3)
    assert np.isnan(noisy.position[..., 1, :]).all()


def test_masks_are_kept_and_accuracy_matches_the_error(waving_clip: Clip) -> None:
    seen = observe(waving_clip.pose, waving_clip.time, SENSOR_SETS["headset_camera"])
    for settings in (NoiseSettings(), NoiseSettings(cameras=True)):
        noisy = check_observation(disturb(seen, np.random.default_rng(3), settings))
        np.testing.assert_array_equal(noisy.has_position, seen.has_position)
        np.testing.assert_array_equal(noisy.has_rotation, seen.has_rotation)
        assert np.isnan(noisy.position[~noisy.has_position]).all()
    many = moving_head(0.5, sessions=6, seconds=40.0, points=("head", "left_wrist"))
    for settings in (STILL_MAP, replace(STILL_MAP, cameras=True)):
        noisy = disturb(many, np.random.default_rng(4), settings)
        error = np.linalg.norm(noisy.position - many.position, axis=-1).mean(axis=(0, 1))
        np.testing.assert_allclose(noisy.accuracy.mean(axis=(0, 1)), np.hypot(error, 0.001), rtol=0.3)


def test_sessions_have_a_scale_and_time_jitter() -> None:
    seen = moving_head(0.3, sessions=200, seconds=5.0)
    noisy = disturb(seen, np.random.default_rng(5), NoiseSettings(headset=0.0))
    height = noisy.position[:, :, 0, 1] / seen.position[:, :, 0, 1]
    np.testing.assert_allclose(height, np.broadcast_to(height[:, :1], height.shape), rtol=1e-12)
    assert 0.7 * 0.003 < height.std() < 1.3 * 0.003
    assert (np.diff(noisy.time) > 0).all()
    assert 0.7 * 0.0004 < np.std(noisy.time - seen.time) < 1.3 * 0.0004


def test_errors_depend_on_the_generator_only(waving_clip: Clip) -> None:
    seen = observe(waving_clip.pose, waving_clip.time, SENSOR_SETS["six_point"])
    once, again, other = (disturb(seen, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(once.position, again.position)
    assert (once.position != other.position).all()
    alone = disturb(seen[:1], np.random.default_rng(1))
    assert np.isfinite(alone.position).all() and len(alone) == 1


def test_bad_settings_are_refused() -> None:
    with pytest.raises(BodysenseError, match="trackers is -1; give 0 or more"):
        NoiseSettings(trackers=-1.0)
    with pytest.raises(BodysenseError, match="camera_time is 0 s; it must be positive"):
        NoiseSettings(camera_time=0.0)
