"""Expected errors made true: known biases are found, for means and for bounds, linear or not."""

import numpy as np
import pytest

from bodysense_lab.completion.error_map import KNOWN, MASKS, POINTS, ErrorMap, unchanged_errors
from bodysense_lab.completion.publish import ErrorSamples, fit_error_map


def samples(count: int = 6000) -> ErrorSamples:
    """Exponential errors: half of what is expected, a tenth where both of the first two points are tracked."""
    rng = np.random.default_rng(2)
    expected = np.exp(rng.uniform(np.log(0.02), np.log(0.2), (count, POINTS)))
    masks = rng.uniform(size=(count, MASKS)) < 0.5
    mean = expected * np.where(masks[:, :1] & masks[:, 1:2], 0.1, 0.5)
    certainty = np.zeros((count, POINTS))
    known = np.concatenate([np.log(expected), masks, certainty], axis=1)
    return ErrorSamples(known, rng.exponential(mean), np.ones((count, POINTS), dtype=bool))


def applied(fitted: ErrorMap, of: ErrorSamples) -> np.ndarray:
    hidden = np.tanh(of.known @ fitted.inward + fitted.inward_offset)
    return np.exp(of.known @ fitted.weight + hidden @ fitted.outward + fitted.offset)


def both_tracked(of: ErrorSamples) -> np.ndarray:
    return of.known[:, POINTS : POINTS + 2].min(axis=1) > 0


def test_the_mean_error_is_found() -> None:
    of = samples()
    mean = applied(fit_error_map(of, steps=500), of)
    for chosen in (both_tracked(of), ~both_tracked(of)):
        assert mean[chosen].mean() == pytest.approx(of.error[chosen].mean(), rel=0.1)


def test_nine_of_ten_errors_are_within_the_bound() -> None:
    of = samples()
    within = of.error <= applied(fit_error_map(of, 0.9, steps=500), of)
    for chosen in (both_tracked(of), ~both_tracked(of)):
        assert within[chosen].mean() == pytest.approx(0.9, abs=0.03)


def test_an_unchanged_map_changes_nothing() -> None:
    of = samples(50)
    np.testing.assert_allclose(np.log(applied(unchanged_errors(), of)), of.known[:, :POINTS])
    assert of.known.shape[1] == KNOWN
