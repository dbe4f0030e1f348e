"""The second after a joint is lost or seen again: which moments count, and their jerk."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.io.clip import Clip
from bodysense_lab.core.scoring import scored_points
from bodysense_lab.data.datasets import DataSet, census_of
from bodysense_lab.papers.unoc.score.transitions import (
    EVENTS,
    METHODS,
    jerks_at,
    moments,
    transitions_of,
    transitions_report,
)


def test_moments_are_those_of_naive_loops() -> None:
    visible = np.random.default_rng(0).random((80, 6)) < 0.8
    found = moments(visible)
    for event, before in (("regained", False), ("lost", True)):
        expected = [
            (t, p)
            for t in range(3, 80 - 29)
            for p in range(6)
            if visible[t - 1, p] == before and visible[t, p] != before
        ]
        assert sorted(map(tuple, found[event].tolist())) == sorted(expected) and expected


def test_a_jump_has_the_jerk_of_its_third_difference() -> None:
    """5 cm in one frame: third differences 1, -2, 1 times it."""
    position = np.zeros((60, 2, 3))
    position[20:, 1, 0] = 0.05
    jumped = jerks_at(position, np.array([[20, 1]]))
    assert jumped == (pytest.approx([0.05 * 2 * 30**3]), pytest.approx([0.05 * 4 * 30**2]))
    peak, _ = jerks_at(position, np.array([[20, 0], [23, 1]]))
    assert peak.tolist() == [0.0, 0.0], "the jump was before frame 23, and of another point"
    assert len(jerks_at(position, np.zeros((0, 2), dtype=int))[0]) == 0


def test_a_second_is_thirty_frames() -> None:
    position = np.zeros((60, 1, 3))
    position[35:, 0, 1] = 1.0  # the jerk begins at frame 35
    assert jerks_at(position, np.array([[6, 0]]))[0] > 0
    assert jerks_at(position, np.array([[5, 0]]))[0] == 0


def test_methods_on_a_clip(waving_clip: Clip) -> None:
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])
    visible = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA).has_position
    jumpy = np.where(visible[..., None], truth, truth + 0.1)
    found = transitions_of({"truth": truth, "best": jumpy}, truth, visible, waving_clip)
    for event in EVENTS:
        for measure in ("peak", "area"):
            true, ours = (found["main", event, method, measure] for method in ("truth", "best"))
            assert true.count == ours.count > 0 and ours.mpjpe > true.mpjpe > 0
    assert found["main", "frames", "best", "occluded"].rmsjpe == pytest.approx(100 * np.sqrt(0.03))
    hidden = ~visible[:, scored_points(waving_clip.pose.skeleton)]
    expected = 100 * np.sqrt(0.03 * hidden.mean())
    assert found["main", "frames", "best", "all"].rmsjpe == pytest.approx(expected)


def test_nothing_lost_and_a_truth_at_rest(data: DataSet, waving_clip: Clip) -> None:
    """A body that does not move: no division by its jerk."""
    still = replace(waving_clip, pose=waving_clip.pose[np.zeros(90, dtype=int)])
    truth = np.asarray(forward_kinematics(still.pose)[0])
    visible = np.ones(truth.shape[:2], dtype=bool)
    visible[10:40] = False
    position = dict.fromkeys(METHODS, truth)
    report = transitions_report(transitions_of(position, truth, visible, still), census_of(still), data)
    assert [row[3] for row in report.rows] == [0.0] * len(report.rows) and report.rows
    position |= {"last_known": truth + np.array([0.1, 0, 0]), "last_known_tracker": truth + np.array([0, 0.04, 0])}
    changed = transitions_report(transitions_of(position, truth, visible, still), census_of(still), data)
    change = "from 10.00 to 4.00 cm"
    expected = f"of last known positions {change} at occluded joints (published: -3.5 cm) and {change} at all joints"
    assert expected in changed.remarks[-1]
    empty = transitions_of(position, truth, np.ones_like(visible), still)
    assert transitions_report(empty, census_of(still), data).rows == ()
