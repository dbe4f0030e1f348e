"""Expected and true errors: bins of equal count, and correlations as SciPy has them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.io.clip import Clip
from bodysense_lab.core.scoring import scored_points
from bodysense_lab.papers.unoc.learned import Learned, load_model
from bodysense_lab.papers.unoc.score.reliability import ErrorPairs, binned, correlations, pairs_of_clip


@pytest.mark.parametrize("count", [10, 57, 1000])
def test_bins_and_correlations(count: int) -> None:
    rng = np.random.default_rng(count)
    expected = np.round(rng.gamma(2.0, size=count), 1)  # with ties
    error = expected * rng.gamma(2.0, size=count)
    pairs = ErrorPairs(expected, error)
    counts, means, errors = (np.array(column) for column in zip(*binned(pairs), strict=True))
    assert len(counts) == 10 and counts.sum() == count and set(np.diff(counts)) <= {0, -1}
    assert np.all(np.diff(means) >= 0) and counts @ errors == pytest.approx(error.sum())
    assert correlations(pairs) == pytest.approx(
        (stats.pearsonr(expected, error)[0], stats.spearmanr(expected, error)[0])
    )


def test_few_and_equal_values() -> None:
    three = ErrorPairs(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 3.0]))
    assert len(binned(three)) == 3 and correlations(three) == pytest.approx((1.0, 1.0))
    assert np.isnan(correlations(ErrorPairs(np.ones(5), np.arange(5.0)))).all()


def test_pairs_are_of_hidden_points(waving_clip: Clip, small_network: Path) -> None:
    pairs = pairs_of_clip(waving_clip, small_network)
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    estimator = Learned(load_model(small_network), waving_clip.pose.skeleton)
    estimate, _ = estimator.step(observation, estimator.start())
    truth, tested = np.asarray(forward_kinematics(waving_clip.pose)[0]), scored_points(waving_clip.pose.skeleton)
    hidden = [(t, p) for t in range(len(truth)) for p in tested if not observation.has_position[t, p]]
    body = pairs["main", "body"]
    np.testing.assert_allclose(body.expected, [100 * estimate.confidence[t, p] for t, p in hidden])
    np.testing.assert_allclose(
        body.error, [100 * np.linalg.norm(estimate.position[t, p] - truth[t, p]) for t, p in hidden]
    )
    assert len(pairs["main", "finger"].error) > 0
    without = replace(waving_clip, has_fingers=False, category="sport")
    assert set(pairs_of_clip(without, small_network)) == {("sport", "body")}
