"""Hidden markers go on where they were: a network's error is taken off its later predictions."""

from __future__ import annotations

import numpy as np
import pytest
from flat_hands import FLAT, INTERVAL, flat_gap_filler, run
from scipy.spatial.transform import Rotation

from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError


def bent_hand() -> np.ndarray:
    """(9, 3) m: a hand whose index finger is bent, which the network has straight."""
    bent = FLAT.copy()
    bent[5] += [-0.03, -0.05, 0.0]
    return bent


def alone(hand: Skeleton, frames: np.ndarray) -> np.ndarray:
    """The network's own prediction of the index finger's tip in the last frame."""
    return run(flat_gap_filler(hand), frames[-1:])[0, 0, 5]


def test_by_default_half_of_an_error_is_left_after_eight_seconds(hand: Skeleton) -> None:
    bent, count = bent_hand(), round(8 / INTERVAL)
    frames = np.tile(bent, (count + 2, 1, 1, 1))
    frames[1:, 0, 5] = np.nan
    shown, told = run(flat_gap_filler(hand), frames)[-1, 0, 5], alone(hand, frames)
    np.testing.assert_allclose(shown - told, 0.5 * (bent[5] - told), rtol=0.01)


def test_an_error_fades_and_what_is_found_is_where_it_is(hand: Skeleton) -> None:
    bent = bent_hand()
    frames = np.tile(bent, (80, 1, 1, 1))
    frames[10:60, 0, 5] = np.nan
    frames[60:, 0, 5] += 0.05
    shown = run(flat_gap_filler(hand, fading=0.5), frames)[:, 0, 5]
    told = alone(hand, frames[:60])
    share = 0.5 ** (np.arange(50) * INTERVAL / 0.5)  # the first hidden frame is where it was
    np.testing.assert_allclose(shown[10:60], told + share[:, None] * (bent[5] - told), atol=1e-6)
    np.testing.assert_array_equal(shown[60:], frames[60:, 0, 5])
    with pytest.raises(BodysenseError, match="fading is -1; it must be positive, or None"):
        flat_gap_filler(hand, fading=-1.0)


@pytest.mark.parametrize("other", [0, 3, 8])
def test_a_marker_that_comes_back_leaves_no_more_than_there_was(hand: Skeleton, other: int) -> None:
    """A still hand of which one more marker is hidden for a while: the error of the first does not grow by it."""
    bent = FLAT + np.random.default_rng(3).normal(scale=0.02, size=FLAT.shape)
    frames = np.tile(bent, (60, 1, 1, 1))
    frames[10:, 0, 5] = np.nan
    frames[20:40, 0, other] = np.nan
    shown = run(flat_gap_filler(hand, fading=None), frames)[:, 0, 5]
    np.testing.assert_allclose(shown[:40], np.tile(bent[5], (40, 1)), atol=1e-6)
    told = alone(hand, frames)
    assert np.linalg.norm(shown[40:] - told, axis=-1).max() < np.linalg.norm(bent[5] - told) + 1e-6


def test_the_error_turns_with_the_hand(hand: Skeleton) -> None:
    bent = bent_hand()
    bent[3] += [-0.03, -0.05, 0.0]
    turns = Rotation.from_rotvec(np.linspace(0, 3, 60)[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    frames = (bent @ turns.swapaxes(1, 2) + np.linspace(0, 0.5, 60)[:, None, None])[:, None]
    truth = frames[:, 0].copy()
    frames[20:, 0, 5] = np.nan
    np.testing.assert_allclose(run(flat_gap_filler(hand, fading=None), frames)[:, 0], truth, atol=1e-5)


def test_one_hand_does_not_disturb_another(hand: Skeleton) -> None:
    rng = np.random.default_rng(1)
    frames = FLAT + rng.normal(scale=0.02, size=(100, 2, 9, 3))
    frames[np.repeat(rng.random((20, 2, 9)) < 0.3, 5, axis=0)] = np.nan
    both = run(flat_gap_filler(hand), frames)
    for k in range(2):
        np.testing.assert_allclose(both[:, k], run(flat_gap_filler(hand), frames[:, k : k + 1])[:, 0], atol=1e-6)
