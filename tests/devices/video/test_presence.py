"""Frames of a film without a person."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.devices.video.presence import LONGEST_MISS, Presence

RATE = 10.0


def kept_of(seen: list[bool], block: int) -> tuple[list[tuple[int, float]], Presence]:
    presence, kept, times = Presence(), [], (np.arange(len(seen)) / RATE).tolist()
    for k in range(0, len(seen), block):
        kept += presence.add(times[k : k + block], seen[k : k + block])
    presence.finish(1 / RATE)
    return kept, presence


@pytest.mark.parametrize("seed", range(12))
def test_no_frame_is_kept_without_a_person_and_none_with_one_is_lost(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spans = rng.choice([1, 3, 9, 12, 30], size=8)  # frames; up to 1 s is a miss
    seen = [bool((k + seed) % 2) for k, span in enumerate(spans) for _ in range(span)]
    kept, presence = kept_of(seen, int(rng.integers(1, 7)))
    numbers = [number for number, _ in kept]
    assert numbers == sorted(set(numbers)) and set(np.flatnonzero(seen)) <= set(numbers)
    sightings = np.flatnonzero(seen)
    for number in set(numbers) - set(sightings):
        around = sightings[sightings < number].max(), sightings[sightings > number].min()
        assert (around[1] - around[0]) / RATE <= LONGEST_MISS + 1e-9
    # Times of the motion are those of the film without the times of absence.
    times = np.array([number / RATE - lost for number, lost in kept])
    assert times[0] == pytest.approx(0.0) and (np.diff(times) <= 1 / RATE + 1e-9).all()
    assert presence.seconds == pytest.approx((len(seen) - len(kept)) / RATE)


def test_times_of_absence_are_known() -> None:
    _, presence = kept_of([False] * 5 + [True] * 10 + [False] * 15 + [True] * 5 + [False] * 20, 4)
    np.testing.assert_allclose(presence.absent, [(0.0, 0.5), (1.5, 3.0), (3.5, 5.5)])
