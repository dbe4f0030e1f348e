"""Expected errors of the packaged network match true errors in size and rank."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import spearmanr

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.simulated.device import simulate
from bodysense.tracking.tracker import Tracker


@pytest.mark.parametrize(("device", "most"), [("head", 1.5), ("three_point", 1.55), ("six_point", 1.5)])
def test_expected_errors_match_true_errors(device: str, most: float) -> None:
    clip = performance_of_unseen_body()
    body = clip.pose.skeleton.indices(BODY)
    tracker = Tracker(Person(skeleton=clip.pose.skeleton))
    estimate, _ = tracker.step(simulate(clip, device), tracker.start())
    truth = np.asarray(forward_kinematics(clip.pose)[0])
    guessed = ~estimate.measured[:, body]
    error = np.linalg.norm(estimate.points - truth, axis=-1)[:, body][guessed]
    expected, bound = estimate.confidence[:, body][guessed], estimate.bound[:, body][guessed]
    assert 0.7 < expected.mean() / error.mean() < most  # recorded people are less smooth
    assert 0.78 < (error <= bound).mean() < 0.975  # bounds must hold for people and scenes that are less usual
    assert np.asarray(spearmanr(expected, error))[0] > 0.6


@pytest.mark.parametrize("draw", range(4))
def test_hands_where_no_one_has_them_make_the_rest_of_the_body_uncertain(draw: int) -> None:
    """A network that cannot explain what is measured does not know the rest either."""
    clip = performance_of_unseen_body()
    body = clip.pose.skeleton.indices(BODY)
    seen = simulate(clip, "three_point")
    aside = np.random.default_rng(draw).normal(size=(3, 3))
    aside *= 0.6 / np.linalg.norm(aside, axis=-1, keepdims=True)  # m
    displaced = seen.position + aside * np.array([0.0, 1.0, 1.0])[:, None]  # the hands, not the head
    tracker = Tracker(Person(skeleton=clip.pose.skeleton))
    usual, _ = tracker.step(seen, tracker.start())
    strange, _ = tracker.step(replace(seen, position=displaced), tracker.start())
    for name in ("confidence", "bound"):
        before, after = (getattr(each, name)[:, body][~each.measured[:, body]].mean() for each in (usual, strange))
        assert after > 1.4 * before, name
