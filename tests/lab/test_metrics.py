"""Metrics on motion whose result is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bodysense.geometry.rotation import quaternion_exp
from bodysense.quality import metrics

RATE = 50.0
TIME = np.arange(20) / RATE


def along(x: np.ndarray | float = 0.0, y: np.ndarray | float = 0.0, z: np.ndarray | float = 0.0) -> np.ndarray:
    """Return a motion (T, 1, 3) in m from its coordinates over time."""
    return np.stack([np.broadcast_to(part, TIME.shape) for part in (x, y, z)], axis=-1)[:, None]


def test_the_mean_of_no_values_is_nan() -> None:
    assert metrics.mpjpe(np.array([[3.0, 4.0], [0.0, 5.0]])) == 3.0
    assert np.isnan(metrics.mpjpe(np.zeros((0, 2))))


@pytest.mark.parametrize("batch", [(), (1,), (3, 1, 2)])
def test_joint_error_is_in_centimetres(batch: tuple[int, ...]) -> None:
    truth = np.random.default_rng(0).normal(size=(*batch, 4, 5, 3))
    error = metrics.joint_error(truth + np.array([0.03, 0.0, -0.04]), truth)
    assert error.shape == (*batch, 4, 5)
    np.testing.assert_allclose(error, 5.0)


def test_rotation_error_is_the_angle_between() -> None:
    rng = np.random.default_rng(1)
    a, b = (Rotation.random(30, rng) for _ in range(2))
    ours = metrics.rotation_error(*(r.as_quat(scalar_first=True).reshape(10, 3, 4) for r in (a, b)))
    assert ours == pytest.approx(np.degrees((a.inv() * b).magnitude().mean()))
    quarter = quaternion_exp(np.array([[0.0, np.pi / 2, 0.0]]))
    assert metrics.rotation_error(quarter, quaternion_exp(np.zeros((1, 3)))) == pytest.approx(90.0)
    assert metrics.rotation_error(quarter, -quarter) == pytest.approx(0.0, abs=1e-6)


def test_velocity_error_is_independent_of_rate_and_offset() -> None:
    """One point drifts by 2 m/s and the other rests, at any frame rate; a constant offset does not count."""
    assert metrics.velocity_error(along(x=2 * TIME), along(), RATE) == pytest.approx(200.0)
    assert metrics.velocity_error(along(x=2 * TIME + 0.7), along(x=2 * TIME), RATE) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("rate", [30.0, 50.0, 120.0])
def test_the_jitter_of_a_cubic_is_its_jerk(rate: float) -> None:
    time = np.arange(40) / rate
    cubic = np.stack([300 * time**3 / 6, 400 * time**3 / 6, 5 * time**2 + time], axis=-1)[:, None]
    assert metrics.jitter(cubic, rate) == pytest.approx(5.0)  # 10² m/s³


def test_smooth_motion_has_no_jitter() -> None:
    assert metrics.jitter(along(x=3 * TIME**2, y=TIME), RATE) == pytest.approx(0.0, abs=1e-6)


def test_acceleration_is_the_mean_over_points() -> None:
    """One point falls at 9.81 m/s², the other at 8.99 m/s²."""
    falling = np.concatenate([along(y=-9.81 * TIME**2 / 2), along(y=-8.99 * TIME**2 / 2)], axis=1)
    np.testing.assert_allclose(metrics.acceleration(falling, RATE), np.tile([9.81, 8.99], (18, 1)), atol=1e-9)


def test_foot_skate_is_the_slide_of_a_foot_in_contact() -> None:
    stands = along(y=0.03)
    assert metrics.foot_skate(along(x=0.3 * TIME, y=TIME, z=0.4 * TIME), stands, RATE) == pytest.approx(50.0)
    assert metrics.foot_skate(stands, stands, RATE) == 0.0


def test_only_feet_in_contact_can_skate() -> None:
    sliding, slow = along(x=0.5 * TIME), along(x=0.09 * TIME, y=0.03)
    assert np.isnan(metrics.foot_skate(sliding, along(y=0.06), RATE))  # the truth is above the ground
    assert np.isnan(metrics.foot_skate(sliding, along(x=0.11 * TIME), RATE))  # the truth moves
    assert metrics.foot_skate(sliding, slow, RATE) == pytest.approx(50.0)
    half = along(y=np.where(TIME < 0.2, 0.0, 0.2))  # on the ground for nine steps; each slides by 1 cm
    assert metrics.foot_skate(sliding, half, RATE) == pytest.approx(50.0)


def test_floor_penetration_is_the_depth_of_feet_below_the_floor() -> None:
    position = np.concatenate([along(y=-0.02), along(y=0.5)], axis=1)
    assert metrics.floor_penetration(position) == pytest.approx(1.0)
    assert metrics.floor_penetration(np.abs(position)) == 0.0


@pytest.mark.parametrize("components", [2, 3])
def test_the_length_of_vectors_is_the_norm_to_the_bit(components: int) -> None:
    vectors = np.random.default_rng(1).normal(size=(50, 7, components))
    np.testing.assert_array_equal(metrics.vector_length(vectors), np.linalg.norm(vectors, axis=-1))
