"""Tables 3 and 4 of two-hands: trials, errors of hidden markers, and reports."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove, marker_positions
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.hands import GloveModels
from bodysense.devices.gloves.networks import load_joint_network, load_marker_network
from bodysense_lab.data.datasets import Census
from bodysense_lab.papers.two_hands.score.baselines import LastKnown
from bodysense_lab.papers.two_hands.score.scores import ALONE, GloveTable, HandTask, measure_fingers, measure_markers
from bodysense_lab.papers.two_hands.score.tables import finger_report, marker_report, published_ratio
from bodysense_lab.papers.two_hands.trials import (
    BEFORE,
    DURATIONS,
    HIDDEN,
    LAST,
    HandErrors,
    cut,
    finger_error,
    hide_some,
    marker_error,
)
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion


@pytest.fixture(scope="module")
def motion(hand: Skeleton) -> HandMotion:
    return synthesize_hand(hand, 2.8, np.random.default_rng(1))


def test_trials_are_stretches_of_the_motion(motion: HandMotion) -> None:
    trials = cut([motion, motion], 30, np.random.default_rng(2))
    assert trials is not None
    markers = np.asarray(marker_positions(default_glove(), motion.pose))
    for k in range(len(trials)):
        begin = len(motion) - trials.frames[k]
        own = trials.markers[: trials.frames[k], k]
        assert np.array_equal(own, markers[begin : begin + len(own)])
        assert np.array_equal(trials.markers[-1, k], markers[min(begin + LAST[-1], len(markers) - 1)])
    assert (trials.frames > LAST[0]).all()
    short = HandMotion("short", motion.pose[:20], 60.0, "", "left")
    assert cut([short], 30, np.random.default_rng(2)) is None


def test_errors_of_the_last_known_position_are_the_distances_moved(motion: HandMotion) -> None:
    trials = cut([motion], 30, np.random.default_rng(2))
    assert trials is not None
    hidden = hide_some(len(trials), 2, np.random.default_rng(3))
    assert (hidden.sum(axis=1) == 2).all()
    errors = marker_error(trials, hidden, LastKnown())
    for row, last in enumerate(LAST):
        gone = 100 * np.linalg.norm(trials.markers[last] - trials.markers[BEFORE - 1], axis=-1)
        expected = np.array([gone[k][hidden[k]].mean() for k in range(len(trials))])
        inside = trials.frames > last
        assert np.allclose(errors[row][inside], expected[inside])
        assert np.isnan(errors[row][~inside]).all()


def test_a_perfect_network_has_no_error_of_fingers(motion: HandMotion) -> None:
    """With true angles and true markers, the solver gives true joints, hidden markers or not."""
    from bodysense.body.hands.hand import angles_of

    trials = cut([motion], 40, np.random.default_rng(2))
    assert trials is not None
    begin = len(motion) - trials.frames
    true = np.asarray(angles_of(motion.pose.rotation[:, 1:]))

    class Knowing:
        def __init__(self) -> None:
            self.frame = 0

        def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
            rows = np.minimum(begin + self.frame, len(true) - 1)
            self.frame += 1
            return true[rows]

    class Markers:
        def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
            return np.zeros_like(markers)  # before the first frame; then nothing is hidden

    nothing = np.zeros((len(trials), 9), dtype=bool)
    errors = finger_error(trials, nothing, GloveModels(Markers(), Knowing()), ALONE)
    assert errors.shape == (1 + len(DURATIONS), len(trials))
    assert np.nanmax(errors) < 1e-3


@pytest.mark.slow
def test_reports_hold_the_figures_and_the_published_ones(untrained_gloves: Path, motion: HandMotion) -> None:
    task = HandTask([motion], "main")
    markers, joints = (untrained_gloves / f"glove_{name}.onnx" for name in ("markers", "joints"))
    table = GloveTable(measure_markers(task, markers, stride=60), Census(), None, 1)
    report = marker_report(table)
    for method in ("lk", "ls", "ma", "ac", "nn"):
        for hidden in HIDDEN:
            for duration in DURATIONS:
                assert np.isfinite(report.numbers[f"{method}_{hidden}_{duration:.1f}_cm"])
    ratio = report.numbers["nn_2_0.5_cm"] / report.numbers["lk_2_0.5_cm"]
    assert report.numbers["ratio_2_0.5"] == pytest.approx(ratio)
    assert published_ratio(1, 0.1) == pytest.approx(0.56 / 1.54)
    assert published_ratio(4, 2.0) == pytest.approx(2.72 / 8.06)
    row = next(row for row in report.rows if row[1] == "affine combination" and row[2] == "4")
    assert row[-5:] == (1.66, 2.68, 4.06, 5.34, 5.45)

    fingers = finger_report(GloveTable(measure_fingers(task, markers, joints, stride=60), Census(), None, 1))
    wanted = {"ik_cm", "ik_tuned_cm", "nn_0_cm", *(f"nn_{n}_{d:.1f}_cm" for n in HIDDEN for d in DURATIONS)}
    assert wanted <= set(fingers.numbers)
    still = next(row for row in fingers.rows if row[1] == "network" and row[2] == "0")
    assert still[3] == pytest.approx(fingers.numbers["nn_0_cm"])
    assert still[-5] == 0.07


def test_synthesised_hands_have_keys_of_their_own_beside_recorded_ones() -> None:
    means = HandErrors()
    for group, error in (("main", 1.0), ("synthesised", 2.0)):
        for method in ("lk", "ls", "ma", "ac", "nn"):
            for hidden in HIDDEN:
                for duration in DURATIONS:
                    means.add((group, method, hidden, duration), np.array([error, np.nan]))
    numbers: dict[str, Any] = marker_report(GloveTable(means, Census(), None, 1)).numbers
    assert numbers["lk_1_0.1_cm"] == 1.0
    assert numbers["lk_1_0.1_cm_synthesised"] == 2.0


def test_merged_means_equal_means_of_all() -> None:
    one, other, both = HandErrors(), HandErrors(), HandErrors()
    for means in (one, both):
        means.add(("a",), np.array([1.0, 2.0, np.nan]))
    for means in (other, both):
        means.add(("a",), np.array([[6.0]]))
    one.merge(other)
    assert one.mean("a") == both.mean("a") == 3.0
    assert np.isnan(one.mean("b"))


def test_packaged_networks_are_as_exact_as_the_papers(motion: HandMotion) -> None:
    """Bounds are the paper's figures of its own people (Tables 3 and 4), at 0.1 s."""
    trials = cut([motion], 20, np.random.default_rng(2))
    assert trials is not None
    models = GloveModels(load_marker_network(), load_joint_network())
    errors = finger_error(trials, hide_some(len(trials), 1, np.random.default_rng(1)), models, ALONE)
    assert np.nanmean(errors[0]) < 0.4
    assert np.nanmean(errors[1]) < 0.5
