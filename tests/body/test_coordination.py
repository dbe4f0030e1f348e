"""Coordination: missing joints are expected from known ones, and nothing is expected at the sides of a gap."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.coordination import NOISE, ROOT, Coordination, coordination, deviations
from bodysense.body.skeleton import BODY
from bodysense.demo import packaged_performance
from bodysense.geometry import gaps
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply

RATE = 30.0


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Local rotations (T, J, 4) and places of the root (T, 3) m of the packaged performance."""
    pose = packaged_performance().pose
    joints = pose.skeleton.indices(BODY)
    return np.asarray(pose.rotation)[:, joints], np.asarray(pose.root_position)


def test_the_packaged_covariances_are_symmetric_positive_and_grow_with_the_gap() -> None:
    found = coordination()
    assert found.covariance.shape == (len(found.seconds), 3 * len(BODY) + 3, 3 * len(BODY) + 3)
    np.testing.assert_array_equal(found.covariance, found.covariance.transpose(0, 2, 1))
    for covariance in found.covariance:
        assert np.linalg.eigvalsh(covariance).min() > -1e-6
    hips = 3 * BODY.index("left_hip")
    assert (np.diff(found.covariance[:, hips, hips]) > 0).all()


@given(st.integers(0, 10_000), st.floats(0.05, 30.0))
@settings(max_examples=30, deadline=None)
def test_known_deviations_are_unchanged_and_zero_predicts_zero(seed: int, seconds: float) -> None:
    rng = np.random.default_rng(seed)
    known, is_known = rng.normal(scale=0.1, size=(4, ROOT + 1, 3)), rng.random(ROOT + 1) < 0.6
    found = coordination().expected(known, is_known, seconds)
    np.testing.assert_array_equal(found[:, is_known], known[:, is_known])
    assert np.isfinite(found).all()
    np.testing.assert_array_equal(coordination().expected(0 * known, is_known, seconds), 0 * known)
    np.testing.assert_allclose(coordination().expected(2 * known, is_known, seconds), 2 * found)


@pytest.mark.parametrize("are_known", [False, True])
def test_all_known_or_nothing_known(are_known: bool) -> None:
    known = np.ones((2, ROOT + 1, 3))
    found = coordination().expected(known, np.full(ROOT + 1, are_known), 1.0)
    np.testing.assert_array_equal(found, known * are_known)


def test_predicted_deviations_are_conditional_means() -> None:
    """Two coordinates of a made-up distribution, in which one is half of the other."""
    size = 3 * (ROOT + 1)
    covariance = np.eye(size)
    covariance[0, 3] = covariance[3, 0] = 0.5
    known = np.zeros((1, ROOT + 1, 3))
    known[0, 1, 0] = 0.2
    is_known = np.ones(ROOT + 1, dtype=bool)
    is_known[0] = False
    found = Coordination(np.array([0.5, 1.0]), np.stack([covariance, covariance])).expected(known, is_known, 0.7)
    np.testing.assert_allclose(found[0, 0], [0.1 / (1 + NOISE), 0, 0], atol=1e-12)


@given(st.integers(2, 100), st.integers(1, 60))
@settings(max_examples=20, deadline=None)
def test_interpolation_plus_deviation_is_the_truth(first: int, count: int) -> None:
    rotation, root = motion()
    end = first + count
    found = deviations(rotation, root, first, end, 1 / RATE)
    inside = gaps.interpolate(rotation, first, end, gaps.COASTING * RATE)
    turned = np.asarray(quaternion_multiply(inside, quaternion_exp(found[:, :ROOT])))
    np.testing.assert_allclose(np.abs((turned * rotation[first:end]).sum(axis=-1)), 1, atol=1e-9)


def test_motion_of_constant_speed_has_no_deviation() -> None:
    time = np.arange(60.0)[:, None, None]
    axes = np.random.default_rng(1).normal(size=(1, ROOT, 3))
    rotation = np.asarray(quaternion_exp(0.01 * time * axes))
    found = deviations(rotation, time[:, 0] * [0.01, 0.0, 0.02], 20, 50, 1 / RATE)
    np.testing.assert_allclose(found, 0, atol=1e-7)
