"""Continuity of hidden markers: a network's error is subtracted from its later predictions."""

from __future__ import annotations

import numpy as np
import pytest
from filled_frames import filled_frames
from scipy.spatial.transform import Rotation

from bodysense.body.hands.glove import default_glove, template
from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.gloves.gap_fillers import FADING, GapFiller, GapFillerStack, NetworkGapFiller, RigidGapFiller
from bodysense.errors import BodysenseError

INTERVAL = 1 / 60
FLAT = template(default_glove(), hand_skeleton(default_skeleton(), "left"))


class Flat:
    """A network that predicts a flat hand for all markers: it has large errors, and jumps with the registration."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.tile(FLAT.reshape(-1), (len(markers), 1)).astype(np.float32)


def flat_gap_filler(hand: Skeleton, fading: float | None = FADING) -> GapFiller:
    return GapFillerStack((NetworkGapFiller(Flat(), (hand,), fading=fading), RigidGapFiller(FLAT)))


def bent_hand() -> np.ndarray:
    """Return markers (9, 3) m of a hand with a bent index finger, which the network predicts as straight."""
    bent = FLAT.copy()
    bent[5] += [-0.03, -0.05, 0.0]
    return bent


def prediction_alone(hand: Skeleton, frames: np.ndarray) -> np.ndarray:
    """Return the network's own prediction of the index finger's tip in the last frame."""
    return filled_frames(flat_gap_filler(hand), frames[-1:])[0, 0, 5]


def test_half_of_an_error_remains_after_eight_seconds_by_default(hand: Skeleton) -> None:
    bent, count = bent_hand(), round(8 / INTERVAL)
    frames = np.tile(bent, (count + 2, 1, 1, 1))
    frames[1:, 0, 5] = np.nan
    filled, predicted = filled_frames(flat_gap_filler(hand), frames)[-1, 0, 5], prediction_alone(hand, frames)
    np.testing.assert_allclose(filled - predicted, 0.5 * (bent[5] - predicted), rtol=0.01)


def test_an_error_fades_and_found_markers_are_unchanged(hand: Skeleton) -> None:
    bent = bent_hand()
    frames = np.tile(bent, (80, 1, 1, 1))
    frames[10:60, 0, 5] = np.nan
    frames[60:, 0, 5] += 0.05
    filled = filled_frames(flat_gap_filler(hand, fading=0.5), frames)[:, 0, 5]
    predicted = prediction_alone(hand, frames[:60])
    share = 0.5 ** (np.arange(50) * INTERVAL / 0.5)  # the first hidden frame is where it was
    np.testing.assert_allclose(filled[10:60], predicted + share[:, None] * (bent[5] - predicted), atol=1e-6)
    np.testing.assert_array_equal(filled[60:], frames[60:, 0, 5])
    with pytest.raises(BodysenseError, match="fading is -1; it must be positive, or None"):
        flat_gap_filler(hand, fading=-1.0)


@pytest.mark.parametrize("other", [0, 3, 8])
def test_a_found_marker_does_not_increase_the_error_of_others(hand: Skeleton, other: int) -> None:
    """Hide a second marker of a still hand for a while; the error of the first one must not grow."""
    bent = FLAT + np.random.default_rng(3).normal(scale=0.02, size=FLAT.shape)
    frames = np.tile(bent, (60, 1, 1, 1))
    frames[10:, 0, 5] = np.nan
    frames[20:40, 0, other] = np.nan
    filled = filled_frames(flat_gap_filler(hand, fading=None), frames)[:, 0, 5]
    np.testing.assert_allclose(filled[:40], np.tile(bent[5], (40, 1)), atol=1e-6)
    predicted = prediction_alone(hand, frames)
    assert np.linalg.norm(filled[40:] - predicted, axis=-1).max() < np.linalg.norm(bent[5] - predicted) + 1e-6


def test_the_error_turns_with_the_hand(hand: Skeleton) -> None:
    bent = bent_hand()
    bent[3] += [-0.03, -0.05, 0.0]
    turns = Rotation.from_rotvec(np.linspace(0, 3, 60)[:, None] * [0.0, 1.0, 0.0]).as_matrix()
    frames = (bent @ turns.swapaxes(1, 2) + np.linspace(0, 0.5, 60)[:, None, None])[:, None]
    truth = frames[:, 0].copy()
    frames[20:, 0, 5] = np.nan
    np.testing.assert_allclose(filled_frames(flat_gap_filler(hand, fading=None), frames)[:, 0], truth, atol=1e-5)


def test_one_hand_does_not_disturb_another(hand: Skeleton) -> None:
    rng = np.random.default_rng(1)
    frames = FLAT + rng.normal(scale=0.02, size=(100, 2, 9, 3))
    frames[np.repeat(rng.random((20, 2, 9)) < 0.3, 5, axis=0)] = np.nan
    both = filled_frames(flat_gap_filler(hand), frames)
    for k in range(2):
        np.testing.assert_allclose(
            both[:, k], filled_frames(flat_gap_filler(hand), frames[:, k : k + 1])[:, 0], atol=1e-6
        )
