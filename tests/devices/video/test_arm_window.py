"""Smoothing of windows of key-points over time, over found values only."""

from __future__ import annotations

import numpy as np

from bodysense.devices.video.arm_geometry.window import smooth_window

TIME = np.arange(32) / 30
DEVIATION = 0.03


def window(hand: np.ndarray, found: np.ndarray) -> dict[str, np.ndarray]:
    """Return key-points of hanging arms, a torso that faces the camera, and hands at (32, 2)."""
    down = np.zeros((32, 2, 2, 3), np.float32)
    down[..., 1] = -1
    torso = np.zeros((32, 4), np.float32)
    torso[:, 0] = np.where(np.arange(32) % 2, -1, 1)  # the same rotation with alternating signs
    return {
        "arm": down,
        "has_arm": np.ones((32, 2), bool),
        "torso": torso,
        "has_torso": np.ones(32, bool),
        "hand": np.tile(hand[:, None, None], (1, 2, 21, 1)).astype(np.float32),
        "has_hand": np.stack([found, found], axis=-1),
    }


def test_steady_motion_does_not_lag_and_noise_is_reduced() -> None:
    steady = np.stack([TIME, -2 * TIME], axis=-1)
    hand = smooth_window(window(steady, np.ones(32, bool)), TIME, DEVIATION)["hand"][:, 0, 0]
    np.testing.assert_allclose(hand[4:-4], steady[4:-4], atol=1e-5)
    assert np.abs(hand - steady).max() < 2 * DEVIATION  # at its ends a window has neighbours on one side only
    noise = np.random.default_rng(0).normal(size=(32, 2))
    smooth = smooth_window(window(noise, np.ones(32, bool)), TIME, DEVIATION)["hand"][:, 0, 0]
    assert smooth[4:-4].std() < 0.7 * noise.std()


def test_missing_values_do_not_count_and_signs_do_not_matter() -> None:
    found = np.arange(32) % 3 != 0
    hand = np.where(found[:, None], 1.0, 1e6) * np.ones((32, 2))
    smooth = smooth_window(window(hand, found), TIME, DEVIATION)
    np.testing.assert_allclose(smooth["hand"][found], 1.0, atol=1e-5)
    np.testing.assert_allclose(np.abs(smooth["torso"][:, 0]), 1.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(smooth["arm"], axis=-1), 1.0, atol=1e-6)
    assert all(value.dtype == window(hand, found)[name].dtype for name, value in smooth.items())
