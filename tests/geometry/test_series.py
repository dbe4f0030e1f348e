"""Series: smoothing, fading and signs over time."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from bodysense.geometry.rotation import geodesic_angle
from bodysense.geometry.series import continuous, fade_out, smoothed


def test_smoothing_is_a_gaussian_with_extended_ends() -> None:
    values = np.random.default_rng(0).normal(size=(50, 2))
    expected = gaussian_filter1d(values, 2.0, axis=0, mode="nearest", radius=6)
    np.testing.assert_allclose(smoothed(values, 2.0), expected, atol=1e-12)


def test_a_fade_falls_between_one_and_zero_with_level_ends_and_is_symmetric() -> None:
    fade = fade_out(9)
    steps = -np.diff([1.0, *fade, 0.0])
    assert (steps > 0).all() and steps.argmax() in {4, 5} and steps[0] < steps[4] / 4
    assert fade + fade[::-1] == pytest.approx(1.0)
    assert fade_out(0).shape == (0,)


def test_signs_are_chosen_without_changing_rotations() -> None:
    rng = np.random.default_rng(1)
    smooth = np.cumsum(rng.normal(size=(40, 3, 4)) * 0.05, axis=0) + np.eye(4)[0]
    smooth /= np.linalg.norm(smooth, axis=-1, keepdims=True)
    found = continuous(smooth * rng.choice([-1.0, 1.0], (40, 3, 1)))
    assert ((found[1:] * found[:-1]).sum(axis=-1) >= 0).all()
    np.testing.assert_allclose(geodesic_angle(found, smooth), 0, atol=1e-7)
