"""Depths of arms: predictions, bounded by seen lengths."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.devices.video.arm_geometry.lines import with_depths

FOCAL, AWAY = 1.0, 2.7  # heights of the picture, m
LENGTH = np.array([[0.28, 0.25]] * 2)


def arms(depth: float) -> np.ndarray:
    """Return unit directions (2, 2, 3) of arms held to the sides, toward the camera by a share of their length."""
    across = np.sqrt(1 - depth**2)
    return np.array([[[sign * across, 0.0, depth]] * 2 for sign in (1.0, -1.0)])


def seen(bones: np.ndarray) -> np.ndarray:
    """Return positions (2, 3, 2) in the picture of shoulders 0.36 m apart, elbows and wrists."""
    joints = np.zeros((2, 3, 3))
    joints[:, 0] = [[0.18, 0.0, -AWAY], [-0.18, 0.0, -AWAY]]
    joints[:, 1:] = joints[:, :1] + np.cumsum(bones * LENGTH[..., None], axis=1)
    return FOCAL * joints[..., :2] / -joints[..., 2:]


def degrees(bones: np.ndarray) -> np.ndarray:
    return np.degrees(np.arcsin(bones[..., 2]))


def found(predicted: float, true: float, whole: float = 1.0) -> np.ndarray:
    bones = arms(predicted)
    return degrees(with_depths(bones, bones, seen(arms(true)), FOCAL, np.full(2, AWAY), LENGTH, whole))


def test_arms_seen_in_full_length_are_not_deep() -> None:
    assert (np.abs(found(0.5, 0.0)) < 27).all()  # 30° are predicted, with half the weight
    assert (found(0.5, 0.0)[:, 0] < found(0.5, 0.0, whole=0.0)[:, 0] - 4).all(), (
        "without legs in the picture lengths count less"
    )


@pytest.mark.parametrize("depth", [-0.8, -0.4, 0.0, 0.4, 0.8])
def test_consistent_depths_are_kept(depth: float) -> None:
    np.testing.assert_allclose(found(depth, depth)[:, 0], np.degrees(np.arcsin(depth)), atol=6)
    np.testing.assert_allclose(found(depth, depth)[:, 1], np.degrees(np.arcsin(depth)), atol=10)  # forearms have a bias


@pytest.mark.parametrize("depth", [-0.8, 0.0, 0.5])
def test_without_legs_depths_are_the_networks(depth: float) -> None:
    np.testing.assert_allclose(found(depth, 0.3, whole=0.1), np.degrees(np.arcsin(depth)), atol=1e-6)


def test_directions_have_unit_length() -> None:
    bones = arms(0.3)
    places = np.random.default_rng(1).normal(size=(2, 3, 2))
    deep = with_depths(bones, -bones, places, FOCAL, np.full(2, AWAY), LENGTH, 0.5)
    np.testing.assert_allclose(np.linalg.norm(deep, axis=-1), 1.0)
