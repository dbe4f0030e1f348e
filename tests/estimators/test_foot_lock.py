"""Feet that stand: no skating while held, no jump when released, nothing under the floor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from bodysense.errors import BodysenseError
from bodysense.estimators.foot_lock import FootLockSettings, lock_feet, released

STANDING = np.array(
    [[[0.1, 0.08, 0.0], [0.1, 0.02, 0.12], [0.1, 0.0, 0.2]], [[-0.1, 0.08, 0.0], [-0.1, 0.02, 0.12], [-0.1, 0.0, 0.2]]]
)
SETTINGS = FootLockSettings()
STEP = 1 / 60


def run(feet: np.ndarray, contact: np.ndarray, interval: float = STEP) -> np.ndarray:
    """Feet (T, 2, 3, 3) as they come out."""
    state, shown = released(), []
    for foot, likely in zip(feet, contact, strict=True):
        move, state = lock_feet(foot, likely, interval, SETTINGS, state)
        shown.append(foot + move[:, None])
    return np.stack(shown)


def test_a_foot_that_stands_does_not_skate() -> None:
    """It drifts by 5 cm in a second; where it is held it stays, the free one is as it was."""
    drift = np.linspace(0, 0.05, 60)[:, None, None, None] * np.array([1.0, 0, 1.0])
    feet = STANDING + drift
    contact = np.zeros((60, 2, 2))
    contact[:, 0] = 0.9
    shown = run(feet, contact)
    np.testing.assert_allclose(shown[:, 0], np.tile(shown[0, 0], (60, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(shown[:, 1], feet[:, 1], atol=1e-12)


@pytest.mark.parametrize("interval", [1 / 120, 1 / 30])
def test_a_released_foot_comes_back_by_halves(interval: float) -> None:
    frames = round(0.5 / interval)
    drift = np.minimum(np.arange(frames) * interval, 0.2)[:, None, None, None] * np.array([0.3, 0, 0])
    contact = np.where(np.arange(frames) * interval < 0.2, 0.9, 0.0)[:, None, None] * np.ones((1, 2, 2))
    feet = STANDING + drift
    behind = np.linalg.norm(run(feet, contact, interval) - feet, axis=-1)[:, 0, 0]
    held = int(np.argmin(contact[:, 0, 0])) - 1
    later = round(SETTINGS.half_life / interval)
    assert behind[held] > 0.04
    assert behind[held + later] == pytest.approx(behind[held] / 2, rel=0.05)


def test_a_foot_is_not_held_beyond_reach() -> None:
    drift = np.linspace(0, 1.0, 60)[:, None, None, None] * np.array([1.0, 0, 0])
    shown = run(STANDING + drift, np.ones((60, 2, 2)))
    behind = np.linalg.norm(shown - STANDING - drift, axis=-1)
    assert behind.max() <= SETTINGS.longest + 1e-9
    assert np.linalg.norm(np.diff(shown, axis=0), axis=-1).max() <= 1.0 / 59 + 1e-9


def test_a_flicker_does_not_let_go() -> None:
    """Between hold and release nothing changes."""
    drift = np.linspace(0, 0.05, 60)[:, None, None, None] * np.array([1.0, 0, 0])
    contact = np.full((60, 2, 2), 0.5)
    contact[0] = 0.7
    shown = run(STANDING + drift, contact)
    assert np.ptp(shown[..., 0], axis=0).max() < 1e-12


@settings(max_examples=50, deadline=None)
@given(
    npst.arrays(float, (12, 2, 3, 3), elements=st.floats(-0.9, 0.3)),
    npst.arrays(float, (12, 2, 2), elements=st.floats(0, 1)),
)
def test_feet_are_lifted_onto_the_floor(noise: np.ndarray, contact: np.ndarray) -> None:
    shown, lowest = run(STANDING + noise, contact)[..., 1], (STANDING + noise)[..., 1].min(axis=-1)
    # A foot that is deeper than any is lifted is lifted by that much.
    np.testing.assert_allclose(shown.min(axis=-1), lowest + np.clip(-lowest, 0, SETTINGS.highest), atol=1e-12)
    assert np.isfinite(shown).all()


def test_settings_that_cannot_be() -> None:
    with pytest.raises(BodysenseError, match=r"release 0\.7 and hold 0\.6 must be probabilities"):
        FootLockSettings(release=0.7)
    with pytest.raises(BodysenseError, match=r"half_life is 0; it must be positive"):
        FootLockSettings(half_life=0)
