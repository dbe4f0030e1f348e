"""Smoothing of joined takes: hidden joints lose their jitter, and seen ones keep every bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.body.rotation import geodesic_angle, quaternion_exp
from bodysense.completion.joining import carrying, steadied

RATE = 30.0


def jittery(seed: int, frames: int = 90) -> np.ndarray:
    """Two joints (T, 2, 4) that turn slowly, and tremble by 3°."""
    rng, time = np.random.default_rng(seed), np.arange(frames)[:, None, None] / RATE
    return np.asarray(quaternion_exp(time * [[0.5, 0.0, 0.0], [0.0, 0.4, 0.0]] + rng.normal(0, 0.05, (frames, 2, 3))))


@given(st.integers(0, 1000), st.lists(st.tuples(st.integers(0, 89), st.integers(1, 40)), max_size=4))
@settings(max_examples=25, deadline=None)
def test_seen_joints_keep_their_rotations(seed: int, spans: list[tuple[int, int]]) -> None:
    rotation, seen = jittery(seed), np.ones((90, 2), dtype=bool)
    for first, count in spans:
        seen[first : first + count, 1] = False
    found = steadied(rotation, seen, 1 / RATE)
    assert geodesic_angle(found, rotation)[seen].max(initial=0) < 1e-6
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-9)


def test_hidden_joints_lose_their_jitter() -> None:
    rotation, seen = jittery(1), np.zeros((90, 2), dtype=bool)
    found = steadied(rotation, seen, 1 / RATE)
    slow = np.asarray(quaternion_exp(np.arange(90)[:, None, None] / RATE * [[0.5, 0.0, 0.0], [0.0, 0.4, 0.0]]))
    assert geodesic_angle(found, slow).mean() < 0.6 * geodesic_angle(rotation, slow).mean()


@pytest.mark.parametrize("frames", [1, 2, 5])
def test_few_frames_and_quaternions_of_either_sign(frames: int) -> None:
    rotation, seen = jittery(2, frames), np.zeros((frames, 2), dtype=bool)
    flipped = rotation * np.where(np.arange(frames) % 2, -1.0, 1.0)[:, None, None]
    assert geodesic_angle(steadied(rotation, seen, 1 / RATE), steadied(flipped, seen, 1 / RATE)).max() < 1e-6


def test_what_carries_a_seen_point_is_not_smoothed() -> None:
    """A chain of three, and a branch."""
    seen = np.array([[False, False, True, False], [False, False, False, False]])
    np.testing.assert_array_equal(carrying(seen, (-1, 0, 1, 0)), [[True, True, True, False], [False] * 4])
