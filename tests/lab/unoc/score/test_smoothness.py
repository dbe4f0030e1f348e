"""Strong accelerations: counted where they are, for the truth and every method, before and after the tracker."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.io.clip import Clip
from bodysense.quality.metrics import acceleration
from bodysense_lab.core.scoring import scored_points
from bodysense_lab.papers.unoc.ik_tracker import IkTrackerSettings
from bodysense_lab.papers.unoc.score.smoothness import (
    after_tracker,
    smoothness_of,
)


def test_counts_are_those_of_the_metric(waving_clip: Clip) -> None:
    rng = np.random.default_rng(0)
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])
    noisy = truth + rng.normal(scale=0.004, size=truth.shape)
    hidden = rng.random(truth.shape[:2]) < 0.3
    sums = smoothness_of({"truth": truth, "gru": noisy}, truth, hidden, waving_clip)
    tested = scored_points(waving_clip.pose.skeleton)
    for method, position in (("truth", truth), ("gru", noisy)):
        assert sums["main", "body", method, "strong"].mpjpe == pytest.approx(
            100 * (acceleration(position[:, tested], 30.0) > 9).mean()
        )
    strong = [np.linalg.norm(np.diff(p[:, tested], 2, axis=0), axis=-1) * 900 > 9 for p in (truth, noisy)]
    assert sums["main", "body", "gru", "added"].mpjpe == pytest.approx(100 * (strong[1] & ~strong[0]).mean())
    assert sums["main", "body", "truth", "added"].mpjpe == 0
    error = 100 * np.linalg.norm((noisy - truth)[:, tested], axis=-1)[hidden[:, tested]]
    assert sums["main", "body", "gru", "occluded"].rmsjpe == pytest.approx(np.sqrt((error**2).mean()))
    short = replace(waving_clip, has_fingers=False, category="other")
    found = smoothness_of({"truth": truth[:2]}, truth[:2], hidden[:2], short)
    assert {key[:3] for key in found} == {("other", "body", "truth")}


def test_the_tracker_keeps_bones_and_calms(waving_clip: Clip) -> None:
    skeleton = waving_clip.pose.skeleton
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])[:40]
    noisy = truth + np.random.default_rng(1).normal(scale=0.01, size=truth.shape)
    observation = observe(waving_clip.pose[:40], waving_clip.time[:40], HEADSET_CAMERA)
    out = after_tracker(noisy, observation, skeleton, IkTrackerSettings())
    length = np.linalg.norm(out[:, 1:] - out[:, list(skeleton.parents[1:])], axis=-1)
    np.testing.assert_allclose(length, np.broadcast_to(skeleton.bone_length[1:], length.shape), atol=1e-9)
    tested = scored_points(skeleton)
    assert (acceleration(out[:, tested], 30.0) > 9).mean() < (acceleration(noisy[:, tested], 30.0) > 9).mean()
