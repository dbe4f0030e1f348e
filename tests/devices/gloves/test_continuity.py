from __future__ import annotations

import numpy as np
import pytest
from flat_hands import FLAT, INTERVAL, flat_filler, run

from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.continuity import Remembered
from bodysense.errors import BodysenseError
from bodysense_lab.two_hands.baselines import LastKnown


def test_by_default_half_of_an_offset_is_left_after_eight_seconds(hand: Skeleton) -> None:
    bent = FLAT.copy()
    bent[5] += [-0.03, -0.05, 0.0]
    count = round(8 / INTERVAL)
    frames = np.tile(bent, (count + 2, 1, 1, 1))
    frames[1:, 0, 5] = np.nan
    shown, told = run(Remembered(flat_filler(hand)), frames)[-1, 0, 5], run(flat_filler(hand), frames)[-1, 0, 5]
    np.testing.assert_allclose(shown - told, 0.5 * (bent[5] - told), rtol=0.01)


def test_what_is_remembered_fades_and_what_is_found_is_where_it_is(hand: Skeleton) -> None:
    bent = FLAT.copy()
    bent[5] += [-0.03, -0.05, 0.0]
    frames = np.tile(bent, (80, 1, 1, 1))
    frames[10:60, 0, 5] = np.nan
    frames[60:, 0, 5] += 0.05
    shown = run(Remembered(flat_filler(hand), fading=0.5), frames)[:, 0, 5]
    told = run(flat_filler(hand), frames)[40, 0, 5]
    share = 0.5 ** (np.arange(50) * INTERVAL / 0.5)  # the first hidden frame is where it was
    np.testing.assert_allclose(shown[10:60], told + share[:, None] * (bent[5] - told), atol=1e-6)
    np.testing.assert_array_equal(shown[60:], frames[60:, 0, 5])
    with pytest.raises(BodysenseError, match="fading is -1; it must be positive, or None"):
        Remembered(LastKnown(), fading=-1.0)


@pytest.mark.parametrize("other", [0, 3, 8])
def test_a_marker_that_comes_back_leaves_no_more_than_there_was(hand: Skeleton, other: int) -> None:
    """A still hand of which one more marker is hidden for a while: the offset of the first does not grow by it."""
    bent = FLAT + np.random.default_rng(3).normal(scale=0.02, size=FLAT.shape)
    frames = np.tile(bent, (60, 1, 1, 1))
    frames[10:, 0, 5] = np.nan
    frames[20:40, 0, other] = np.nan
    shown = run(Remembered(flat_filler(hand), fading=None), frames)[:, 0, 5]
    np.testing.assert_allclose(shown[:40], np.tile(bent[5], (40, 1)), atol=1e-6)
    told = run(flat_filler(hand), frames)[-1, 0, 5]
    assert np.linalg.norm(shown[40:] - told, axis=-1).max() < np.linalg.norm(bent[5] - told) + 1e-6
