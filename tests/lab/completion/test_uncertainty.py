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
    apart = np.log(rng.uniform(0.01, 0.5, (count, KNOWN - 2 * POINTS - MASKS)))
    mean *= np.where(apart[:, :1] > np.log(0.25), 1.5, 1.0)
    learned = rng.uniform(size=count) < 0.7
    mean *= np.where(learned, 0.6, 1.0)[:, None]
    known = np.concatenate([np.log(expected), masks, certainty, apart], axis=1)
    group = np.zeros(count, dtype=int)
    return ErrorSamples(known, rng.exponential(mean), np.ones((count, POINTS), dtype=bool), learned, group)


def applied(fitted: ErrorMap, of: ErrorSamples) -> np.ndarray:
    hidden = np.tanh(of.known @ fitted.inward + fitted.inward_offset)
    return np.exp(of.known @ fitted.weight + hidden @ fitted.outward + fitted.offset)


def both_tracked(of: ErrorSamples) -> np.ndarray:
    return of.known[:, POINTS : POINTS + 2].min(axis=1) > 0


def disagree(of: ErrorSamples) -> np.ndarray:
    """Where the network's two answers about the first joint are far apart."""
    return of.known[:, -22] > np.log(0.25)


@pytest.mark.slow
def test_the_mean_error_is_found() -> None:
    of = samples()
    mean = applied(fit_error_map(of, steps=800), of)
    for rows in (both_tracked(of), ~both_tracked(of), disagree(of), ~disagree(of)):
        chosen = rows & ~of.learned  # the map must hold for people who were not in training
        assert mean[chosen].mean() == pytest.approx(of.error[chosen].mean(), rel=0.1)


@pytest.mark.slow
def test_nine_of_ten_errors_are_within_the_bound() -> None:
    of = samples()
    within = of.error <= applied(fit_error_map(of, 0.9, steps=700), of)
    for chosen in (both_tracked(of), ~both_tracked(of), disagree(of), ~disagree(of)):
        assert within[chosen & ~of.learned].mean() == pytest.approx(0.9, abs=0.03)
    assert within[of.learned].mean() > 0.95


def test_an_unchanged_map_changes_nothing() -> None:
    of = samples(50)
    np.testing.assert_allclose(np.log(applied(unchanged_errors(), of)), of.known[:, :POINTS])
    assert of.known.shape[1] == KNOWN
