"""Calibration of expected errors: the fit finds known biases of means and bounds, linear or not."""

import numpy as np
import pytest

from bodysense_lab.completion.networks.error_map import INPUTS, MASKS, POINTS, ErrorMap, disagreement_map, identity_map
from bodysense_lab.completion.networks.error_samples import ErrorSamples
from bodysense_lab.completion.networks.publish import fit_error_map


def samples(count: int = 6000) -> ErrorSamples:
    """Return exponential errors: half the expected ones, or a tenth if both of the first two points are tracked."""
    rng = np.random.default_rng(2)
    expected = np.exp(rng.uniform(np.log(0.02), np.log(0.2), (count, POINTS)))
    masks = rng.uniform(size=(count, MASKS)) < 0.5
    mean = expected * np.where(masks[:, :1] & masks[:, 1:2], 0.1, 0.5)
    certainty = np.zeros((count, POINTS))
    disagreement = np.log(rng.uniform(0.01, 0.5, (count, INPUTS - 2 * POINTS - MASKS)))
    mean *= np.where(disagreement[:, :1] > np.log(0.25), 1.5, 1.0)
    in_training = rng.uniform(size=count) < 0.7
    mean *= np.where(in_training, 0.6, 1.0)[:, None]
    rarity = rng.choice([1.0, 2.0], count)
    inputs = np.concatenate([np.log(expected), masks, certainty, disagreement], axis=1)
    weight = np.full(count, 1 / count)
    error = rng.exponential(mean) * rarity[:, None]
    return ErrorSamples(inputs, error, np.ones((count, POINTS), dtype=bool), rarity, in_training, weight)


def applied(fitted: ErrorMap, of: ErrorSamples) -> np.ndarray:
    hidden = np.tanh(of.inputs @ fitted.inward + fitted.inward_offset)
    return np.exp(of.inputs @ fitted.weight + hidden @ fitted.outward + fitted.offset)


def both_tracked(of: ErrorSamples) -> np.ndarray:
    return of.inputs[:, POINTS : POINTS + 2].min(axis=1) > 0


def disagree(of: ErrorSamples) -> np.ndarray:
    """Return a mask of samples in which the network's two answers for the first joint are far apart."""
    return of.inputs[:, -22] > np.log(0.25)


@pytest.mark.slow
def test_the_mean_error_is_found() -> None:
    of = samples()
    mean = applied(fit_error_map(of, steps=800), of)
    for rows in (both_tracked(of), ~both_tracked(of), disagree(of), ~disagree(of)):
        chosen = rows & ~of.in_training  # the map must hold for people who were not in training
        assert mean[chosen].mean() == pytest.approx(of.error[chosen].mean(), rel=0.1)


@pytest.mark.slow
def test_nine_of_ten_errors_are_within_the_bound() -> None:
    of = samples()
    within = of.error <= of.rarity[:, None] * applied(fit_error_map(of, 0.9, steps=700), of)
    for chosen in (both_tracked(of), ~both_tracked(of), disagree(of), ~disagree(of), of.rarity == 1, of.rarity == 2):
        assert within[chosen & ~of.in_training].mean() == pytest.approx(0.9, abs=0.03)
    assert within[of.in_training].mean() > 0.95


def test_the_map_of_disagreements_returns_them_and_one_metre_for_points_that_are_no_joints() -> None:
    of = samples(50)
    sampled = applied(disagreement_map(), of)
    np.testing.assert_allclose(np.log(sampled[:, :22]), of.inputs[:, -22:])
    np.testing.assert_allclose(sampled[:, 22:], 1.0)


def test_the_identity_map_keeps_expected_errors() -> None:
    of = samples(50)
    np.testing.assert_allclose(np.log(applied(identity_map(), of)), of.inputs[:, :POINTS])
    assert of.inputs.shape[1] == INPUTS
