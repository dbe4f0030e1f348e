"""Expected errors made true: known biases are found, for means and for bounds."""

import numpy as np
import pytest

from bodysense.lab.completion.error_map import MASKS, ErrorMap, unchanged_errors
from bodysense.lab.completion.uncertainty import ErrorSamples, fit_error_map


def samples(count: int = 6000) -> ErrorSamples:
    """Exponential errors whose mean is half of what is expected, and a tenth where the first mask is set."""
    rng = np.random.default_rng(2)
    expected = np.exp(rng.uniform(np.log(0.02), np.log(0.2), (count, 25)))
    masks = rng.uniform(size=(count, MASKS)) < 0.5
    mean = expected * np.where(masks[:, :1], 0.1, 0.5)
    return ErrorSamples(expected, masks, rng.exponential(mean), np.ones((count, 25), dtype=bool))


def applied(fitted: ErrorMap, of: ErrorSamples) -> np.ndarray:
    return np.exp(fitted.slope * np.log(of.expected) + of.masks @ fitted.weight + fitted.offset)


def test_the_mean_error_is_found() -> None:
    of = samples()
    mean = applied(fit_error_map(of), of)
    for chosen in (of.masks[:, 0], ~of.masks[:, 0]):
        assert mean[chosen].mean() == pytest.approx(of.error[chosen].mean(), rel=0.1)


def test_nine_of_ten_errors_are_within_the_bound() -> None:
    of = samples()
    within = of.error <= applied(fit_error_map(of, 0.9), of)
    for chosen in (of.masks[:, 0], ~of.masks[:, 0]):
        assert within[chosen].mean() == pytest.approx(0.9, abs=0.03)


def test_an_unchanged_map_changes_nothing() -> None:
    of = samples(50)
    np.testing.assert_allclose(applied(unchanged_errors(), of), of.expected)
