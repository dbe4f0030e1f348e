"""Intervals by bootstrap over people, compared with SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from bodysense_lab.core.intervals import interval

RNG = np.random.default_rng(0)
VALUES = RNG.normal(5.0, 1.0, 15)
EQUAL = {f"p{k}": (float(value), 1.0) for k, value in enumerate(VALUES)}


def test_the_interval_equals_that_of_scipy() -> None:
    one = interval(EQUAL)
    theirs = stats.bootstrap((VALUES,), np.mean, method="percentile", n_resamples=5000, rng=1).confidence_interval
    assert one.value == pytest.approx(VALUES.mean())
    assert (one.low, one.high) == pytest.approx((theirs.low, theirs.high), abs=0.05)


def test_a_person_with_weight_0_does_not_count() -> None:
    assert interval({**EQUAL, "none": (1e6, 1e-12)}).value == pytest.approx(VALUES.mean(), abs=1e-4)


def test_differences_pair_the_same_people() -> None:
    """If people differ by 1 cm and the methods by 0.1 cm on each person, the difference is significant."""
    worse = {name: (value + 0.1, weight) for name, (value, weight) in EQUAL.items()}
    one = interval(worse, EQUAL)
    assert (one.value, one.low, one.high) == pytest.approx((0.1, 0.1, 0.1))
    assert one.verdict == "worse" and interval(EQUAL, worse).verdict == "better"
    noisy = {
        name: (value + noise, 1.0)
        for (name, (value, _)), noise in zip(EQUAL.items(), VALUES - VALUES.mean(), strict=True)
    }
    assert interval(noisy, EQUAL).verdict == "none"


def test_intervals_of_fewer_than_two_people_are_nan() -> None:
    assert math.isnan(interval({}).value)
    one = interval({"a": (3.0, 2.0)})
    assert one.value == 3.0 and math.isnan(one.low) and math.isnan(one.high)
    assert math.isnan(interval({"a": (3.0, 1.0)}, {"b": (2.0, 1.0)}).value)
