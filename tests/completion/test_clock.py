"""The clock: intervals, gaps, and the one error of time."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.completion.clock import Clock
from bodysense.errors import BodysenseError

CLOCK = Clock()


@pytest.mark.parametrize("origin", [0.0, -5.0, 1.7e9])
def test_intervals_of_people_who_began_at_different_times(origin: float) -> None:
    """The first has no frame before, the second goes on, the third comes back after a gap."""
    before = np.array([np.nan, origin - 1 / 60, origin - 3.0])
    interval, fresh = CLOCK.interval(np.full(3, origin), before)
    np.testing.assert_allclose(interval, [1 / 30, 1 / 60, 1 / 30], atol=3e-7)
    np.testing.assert_array_equal(fresh, [True, False, True])


def test_a_gap_is_longer_than_the_longest() -> None:
    interval, fresh = CLOCK.interval(np.array([1.0, 1.01]), np.zeros(2))
    np.testing.assert_array_equal(fresh, [False, True])
    np.testing.assert_array_equal(interval, [CLOCK.longest, CLOCK.first])


@pytest.mark.parametrize(
    ("time", "before", "text"),
    [
        ([1.0, 2.0], [0.9, 2.0], "tracker: a frame at 2 s came after one at 2 s; give frames in order of time"),
        ([1.0, 1.5], [0.9, 2.0], "a frame at 1.5 s came after one at 2 s"),
        ([1.7e9], [1.7e9 + 0.01], r"a frame at 1700000000 s came after one at 1700000000\.01 s"),
        ([np.nan], [0.0], "a frame at nan s came after one at 0 s"),
        ([np.inf], [np.nan], "a frame at inf s; give frames in order of time, in seconds"),
        ([-np.inf], [0.0], "a frame at -inf s"),
    ],
)
def test_time_increases(time: list[float], before: list[float], text: str) -> None:
    with pytest.raises(BodysenseError, match=text):
        CLOCK.interval(np.array(time), np.array(before))


@pytest.mark.parametrize("field", ["longest_gap", "first", "longest"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
def test_settings_that_cannot_be(field: str, value: float) -> None:
    with pytest.raises(BodysenseError, match=f"clock: {field} is .*; it must be positive"):
        Clock(**{field: value})
