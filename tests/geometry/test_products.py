"""Fast quaternion products against their slow twins in `rotation.py`."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry import products, rotation


def turns(seed: int, count: int = 20) -> np.ndarray:
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


@given(seed=st.integers(0, 9999))
def test_products_equal_the_slow_twin(seed: int) -> None:
    a, b = turns(seed), turns(seed + 1)
    np.testing.assert_allclose(products.multiply(a, b), rotation.quaternion_multiply(a, b), atol=1e-15)
    np.testing.assert_allclose(products.log(a), rotation.quaternion_log(a), atol=1e-12)
    vector = np.random.default_rng(seed).normal(size=(20, 3))
    np.testing.assert_allclose(products.exp(vector), rotation.quaternion_exp(vector), atol=1e-14)
    np.testing.assert_allclose(products.to_matrix(a), rotation.quaternion_to_matrix(a), atol=1e-14)
    np.testing.assert_allclose(products.rotate(a, vector), rotation.quaternion_rotate(a, vector), atol=1e-14)
    np.testing.assert_allclose(products.cross(a[:, 1:], vector), np.cross(a[:, 1:], vector), atol=1e-15)


@pytest.mark.parametrize("size", [0.0, 1e-300, 1e-15, 1e-9, 1e-5, 3.14159])
def test_log_inverts_exp_for_small_and_large_turns(size: float) -> None:
    vector = np.array([[0.6, -0.8, 0.0], [0.0, 0.0, 1.0]]) * size
    there = products.exp(vector)
    np.testing.assert_allclose(np.linalg.norm(there, axis=1), 1, atol=1e-15)
    np.testing.assert_allclose(products.log(there), vector, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(products.log(-there), vector, rtol=1e-6, atol=1e-12)


@settings(max_examples=20)
@given(seed=st.integers(0, 9999))
def test_world_rotations_equal_forward_kinematics(seed: int) -> None:
    skeleton = default_skeleton()
    local = turns(seed, len(skeleton.joints))
    _, world = forward_kinematics(Pose(skeleton, np.zeros(3), local))
    np.testing.assert_allclose(products.world_rotation(skeleton.parents, skeleton.levels, local), world, atol=1e-12)
