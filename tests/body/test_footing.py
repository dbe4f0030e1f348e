"""A foot that stands stays; one that is lifted does not; known frames are never moved, and nothing jumps."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.footing import FADE, FARTHEST, stop_sliding

RATE = 30.0


def sliding(frames: int, speed: float) -> np.ndarray:
    """(T, 2, 3) an ankle and a ball that drift along x by `speed` m/s."""
    place = np.zeros((frames, 2, 3))
    place[:, 0, 1], place[:, 1, 2] = 0.08, 0.12
    place[..., 0] = speed * np.arange(frames)[:, None] / RATE
    return place


def free(frames: int, first: int, end: int) -> np.ndarray:
    found = np.zeros(frames, dtype=bool)
    found[first:end] = True
    return found


def test_a_foot_that_stands_does_not_slide() -> None:
    place, gap = sliding(60, 0.05), free(60, 10, 60)
    shift = stop_sliding(place, np.ones((60, 2)), gap, 1 / RATE)
    assert not shift[:10].any()
    np.testing.assert_allclose((place[:, 0] + shift)[9:], np.tile(place[9, 0], (51, 1)), atol=1e-12)


def test_a_foot_moves_evenly_between_two_known_positions() -> None:
    place, gap = sliding(60, 0.0), free(60, 10, 50)
    place[10:50, :, 0] += 0.03 * np.sin(np.linspace(0, np.pi, 40))[:, None]  # there and back
    place[50:, :, 0] += 0.01
    shift = stop_sliding(place, np.ones((60, 2)), gap, 1 / RATE)
    steps = np.diff((place[:, 0] + shift)[:, 0])
    np.testing.assert_allclose(steps[9:50], 0.01 / 41, atol=1e-12)
    assert not shift[~gap].any()


def test_the_foot_rolls_from_heel_to_ball() -> None:
    """The resting point stays in place, also while the foot rolls from heel to ball."""
    place = sliding(40, 0.04)
    place[20:, 0, 1] += 0.002 * np.arange(20)  # the heel rises
    contact = np.zeros((40, 2))
    contact[:20, 0], contact[20:, 1] = 0.9, 0.9
    moved = place + stop_sliding(place, contact, np.ones(40, dtype=bool), 1 / RATE)[:, None]
    steps = np.abs(np.diff(moved[..., [0, 2]], axis=0)).max(axis=-1)
    assert steps[:19, 0].max() < 1e-12 and steps[20:, 1].max() < 1e-12


def test_a_lifted_foot_returns_to_its_path_without_a_jump() -> None:
    place, gap = sliding(90, 0.1), free(90, 5, 85)
    contact = np.zeros((90, 2))
    contact[30:45] = 0.9
    shift = stop_sliding(place, contact, gap, 1 / RATE)
    away = round(FADE * RATE) + 1
    assert not shift[: 30 - away].any() and not shift[45 + away :].any() and shift[30:45].any()
    assert np.abs(np.diff(shift, axis=0)).max() < 0.02
    assert not shift[:, 1].any()


@pytest.mark.parametrize("contact", [0.0, 0.5])
def test_a_foot_with_low_contact_is_unchanged(contact: float) -> None:
    assert not stop_sliding(sliding(30, 0.3), np.full((30, 2), contact), free(30, 5, 25), 1 / RATE).any()


def test_the_shift_is_bounded() -> None:
    shift = stop_sliding(sliding(90, 2.0), np.ones((90, 2)), free(90, 0, 90), 1 / RATE)
    assert np.linalg.norm(shift, axis=-1).max() <= FARTHEST + 1e-12


def test_thresholds_decide_which_feet_stand() -> None:
    """A foot of contact 0.7 is let be where 0.8 is asked for."""
    place = np.zeros((30, 2, 3))
    place[:, :, 0] = np.linspace(0, 0.05, 30)[:, None]
    contact, free = np.full((30, 2), 0.7), np.ones(30, dtype=bool)
    assert np.abs(stop_sliding(place, contact, free, 1 / 30)).max() > 0.01
    np.testing.assert_array_equal(stop_sliding(place, contact, free, 1 / 30, hold=(0.8, 0.6)), 0)
