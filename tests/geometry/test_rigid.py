"""Rigid transforms: the axioms of a group, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_to_matrix


def random_transforms(count: int) -> list[RigidTransform]:
    rng = np.random.default_rng(0)
    return [RigidTransform(rng.normal(size=3), rng.normal(size=4)) for _ in range(count)]


def matrix(transform: RigidTransform) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = quaternion_to_matrix(transform.rotation)
    result[:3, 3] = transform.translation
    return result


def test_composition_equals_products_of_matrices() -> None:
    a, b, c = random_transforms(3)
    np.testing.assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=1e-12)
    np.testing.assert_allclose(matrix((a @ b) @ c), matrix(a @ (b @ c)), atol=1e-12)
    np.testing.assert_allclose(matrix(a.inverse()), np.linalg.inv(matrix(a)), atol=1e-12)
    np.testing.assert_allclose(matrix(a @ RigidTransform()), matrix(a), atol=1e-12)
    np.testing.assert_allclose(matrix(a.inverse() @ a), np.eye(4), atol=1e-12)


def test_points_follow() -> None:
    a, b = random_transforms(2)
    points = np.random.default_rng(1).normal(size=(4, 5, 3))
    np.testing.assert_allclose(a.apply(b.apply(points)), a.compose(b).apply(points), atol=1e-12)
    np.testing.assert_allclose(a.inverse().apply(a.apply(points)), points, atol=1e-12)
    np.testing.assert_allclose(a.apply(np.zeros(3)), a.translation, atol=1e-12)


def test_rotations_are_kept_as_unit_quaternions() -> None:
    turned = RigidTransform(np.zeros(3), np.array([-2.0, 0.0, 0.0, 2.0]))
    np.testing.assert_allclose(turned.rotation, np.array([1.0, 0, 0, -1]) / np.sqrt(2))
    again = RigidTransform(turned.translation, turned.rotation)
    np.testing.assert_array_equal(again.rotation, turned.rotation)
    with pytest.raises(ValueError, match="read-only"):
        turned.rotation[0] = 0


@pytest.mark.parametrize(
    ("translation", "rotation", "text"),
    [
        ([0, 0], [1, 0, 0, 0], "translation .* must be 3 finite numbers"),
        ([0, 0, np.nan], [1, 0, 0, 0], "translation .* must be 3 finite numbers"),
        ([0, 0, 0], [1, 0, 0], "rotation .* must be 4 finite numbers"),
        ([0, 0, 0], [0, 0, 0, 0], "is no rotation; give a quaternion"),
    ],
)
def test_invalid_transforms_are_refused(translation: list[float], rotation: list[float], text: str) -> None:
    with pytest.raises(BodysenseError, match=text):
        RigidTransform(np.array(translation), np.array(rotation))
