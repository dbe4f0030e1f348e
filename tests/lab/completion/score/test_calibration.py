"""Calibration: errors as expected have a calibration error of 0, and others that of their bias."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import spearmanr

from bodysense_lab.completion.score.scores import Calibration

NORMAL = 1.567  # 90 % quantile of lengths of normal errors in space, by their mean


def normal_errors(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return expected errors of 1 to 30 cm, and lengths of normal errors with these means."""
    rng = np.random.default_rng(seed)
    expected = np.exp(rng.uniform(np.log(0.01), np.log(0.3), count))
    return expected, expected / (8 / np.pi) ** 0.5 * np.linalg.norm(rng.standard_normal((count, 3)), axis=-1)


def calibration(expected: np.ndarray, error: np.ndarray) -> Calibration:
    one = Calibration()
    one.add_errors(expected, error, NORMAL * expected)
    return one


def test_normal_errors_are_calibrated() -> None:
    expected, error = normal_errors(200_000)
    one = calibration(expected, error)
    assert one.ece < 0.01 and one.coverage == pytest.approx(0.9, abs=0.005)
    assert one.rank_correlation == pytest.approx(float(np.asarray(spearmanr(expected, error))[0]), abs=0.003)
    means = one.curve()
    np.testing.assert_allclose(means[0], means[1], rtol=0.05)


@pytest.mark.parametrize("factor", [0.5, 1.3])
def test_the_calibration_error_is_the_relative_bias(factor: float) -> None:
    expected, error = normal_errors(100_000)
    assert calibration(factor * expected, error).ece == pytest.approx(abs(factor - 1), abs=0.01)


def test_biases_of_bins_do_not_cancel() -> None:
    """Expected errors are twice the small true errors and half the large ones."""
    error = np.repeat([0.01, 0.1], 1000)
    assert calibration(np.repeat([0.02, 0.05], 1000), error).ece == pytest.approx((0.01 + 0.05) / 0.11)


def test_merged_calibrations_equal_the_whole() -> None:
    expected, error = normal_errors(5000)
    whole, parts = calibration(expected, error), calibration(expected[:2000], error[:2000])
    parts.merge(calibration(expected[2000:], error[2000:]))
    for name in ("ece", "coverage", "rank_correlation", "count"):
        assert getattr(parts, name) == pytest.approx(getattr(whole, name))


def test_a_calibration_without_points_is_nan() -> None:
    one = Calibration()
    assert all(np.isnan(value) for value in (one.ece, one.coverage, one.rank_correlation))
    one.add_errors(np.zeros(0), np.zeros(0), np.zeros(0))
    assert one.count == 0 and np.isnan(one.ece)
