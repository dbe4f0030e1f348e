"""The limits of the paper's gloves: what is counted, and the table."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.hands.hand import hand_skeleton, rotations_of
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.gloves.hands import GloveModels
from bodysense.devices.simulated.camera_ring import CameraRing
from bodysense_lab.data.datasets import Census
from bodysense_lab.papers.two_hands.score.hand_pairs import SYNTHESISED, HandPair, synthesised_pair
from bodysense_lab.papers.two_hands.score.limits import (
    Findings,
    count_jumps,
    count_penetration,
    count_touches,
    fingertip_gaps,
    measure_pair,
    points_of,
)
from bodysense_lab.papers.two_hands.score.limits_report import LINES, limits_report

HAND = hand_skeleton(default_skeleton(), "left")


class Nothing:
    """A network that was never trained: it says that nothing is anywhere, or that every angle is 0."""

    def __init__(self, size: int) -> None:
        self.size = size

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.zeros((len(markers), self.size), dtype=np.float32)


def still(x: float, angles: np.ndarray, frames: int = 4) -> HandPair:
    """Two flat hands that do not move, their wrists at x of their own worlds, with the fingers' angles (26,)."""
    rotation = np.concatenate([[[1.0, 0, 0, 0]], rotations_of(angles)])
    root, rotation = np.tile([x, 0.0, 0.0], (frames, 1)), np.tile(rotation, (frames, 1, 1))
    return HandPair(Pose(HAND, root, rotation), Pose(HAND, root, rotation))


def test_hands_apart_do_not_penetrate() -> None:
    findings = Findings()
    count_penetration(findings, "truth", still(0.3, np.zeros(26)))
    numbers = findings.numbers()
    assert numbers["any_penetrating_share_truth"] == 0 and numbers["any_deepest_mm_truth"] == 0
    assert "any_penetration_mm_truth" not in numbers  # the mean of nothing


def test_penetrating_hands_are_counted() -> None:
    findings = Findings()
    count_penetration(findings, "truth", still(-0.05, np.zeros(26)))  # palms through each other
    count_penetration(findings, "truth", still(0.3, np.zeros(26), frames=12))
    numbers = findings.numbers()
    assert numbers["mutual_penetrating_share_truth"] == numbers["any_penetrating_share_truth"] == 0.25
    assert numbers["own_penetrating_share_truth"] == 0
    assert numbers["mutual_penetration_mm_truth"] == pytest.approx(numbers["mutual_deepest_mm_truth"])


def test_gaps_of_fingertips_are_between_their_surfaces() -> None:
    gaps = fingertip_gaps(still(-0.21, np.zeros(26), frames=1))
    assert gaps.shape == (1, 33)
    tips = forward_kinematics(still(-0.21, np.zeros(26), frames=1).left)[0][0, 16:]
    middle = 8 + 2 * 5 + 2
    assert gaps[0, middle] == pytest.approx(-2 * tips[2, 0], abs=1e-9)  # tips lie on the skin, face to face
    np.testing.assert_allclose(gaps[0, :4], gaps[0, 4:8])


def test_a_touch_is_kept_or_lost() -> None:
    apart = -(HAND.path @ HAND.rest_offset)[HAND.index("middle_tip"), 0]
    truth = still(apart - 0.0005, np.zeros(26))  # 1 mm between the middle fingertips
    findings = Findings()
    count_touches(findings, still(apart - 0.005, np.zeros(26)), truth)
    numbers = findings.numbers()
    assert numbers["touch_gap_mm_output"] == pytest.approx(10) and numbers["touch_kept_share_output"] == 0
    findings = Findings()
    count_touches(findings, truth, truth)
    numbers = findings.numbers()
    assert numbers["touch_gap_mm_output"] == pytest.approx(1) and numbers["touch_kept_share_output"] == 1
    assert "pinch_gap_mm_output" not in numbers


def test_a_jump_is_a_step_that_the_truth_does_not_make() -> None:
    true = np.zeros((10, 2, 21, 3))
    true[5:, ..., 2] = 0.02  # everything moves at once, also in the prediction
    predicted = true.copy()
    predicted[4:, 1, 7] += [0.0, 0.006, 0.008]
    predicted[7:, 0, 3, 0] += 0.004
    findings = Findings()
    count_jumps(findings, predicted, true)
    numbers = findings.numbers()
    assert numbers["jump_share_output"] == numbers["error_step_share_output"] == pytest.approx(1 / 9)
    assert numbers["largest_jump_mm_output"] == numbers["largest_error_step_mm_output"] == pytest.approx(10.0)
    findings = Findings()
    count_jumps(findings, np.zeros_like(true), true)  # what stands still does not jump; its error changes
    numbers = findings.numbers()
    assert numbers["jump_share_output"] == 0 and numbers["largest_error_step_mm_output"] == pytest.approx(20.0)


def test_findings_add_up() -> None:
    one, other, nothing = Findings(), Findings(), Findings()
    one.add("a", np.array([1.0, 2.0]))
    other.add("a", np.array([6.0]))
    other.add("b", np.array([0.0, 0.0, 1.0, 1.0]))
    one.add("b", np.ones(4))
    other.add_largest("c", np.array([3.0]))
    one.merge(other)
    one.merge(nothing)
    assert one.numbers() == {"a": 3.0, "b": 0.75, "c": 3.0}


def test_a_recording_is_measured_and_reported() -> None:
    pair = synthesised_pair((0, 1), seconds=0.5)
    models = GloveModels(Nothing(27), Nothing(26))
    found = measure_pair(pair, models, CameraRing(), np.random.default_rng(0))
    numbers = found.numbers()
    for line in LINES:
        for key in line.keys:
            if key and not any(part in key for part in ("penetration_mm", "touch", "pinch")):  # those may not occur
                assert np.isfinite(numbers[key]), key
    report = limits_report({"main": found, SYNTHESISED: found}, CameraRing(), None, Census(), 0.5)
    assert {row[0] for row in report.rows} == {"main", SYNTHESISED}
    assert (
        report.numbers["synthesised_error_cm_output"] == report.numbers["error_cm_output"] == numbers["error_cm_output"]
    )
    assert all(len(row) == len(report.columns) for row in report.rows)
    assert any("Jumps above 5 mm" in remark for remark in report.remarks)


def test_synthesised_hands_differ_in_shape() -> None:
    one, other = (synthesised_pair((3, piece), seconds=0.2) for piece in (0, 1))
    assert not np.allclose(one.left.skeleton.rest_offset, other.left.skeleton.rest_offset)
    assert points_of(one).shape == (len(one.time), 2, 21, 3)
    np.testing.assert_allclose(np.diff(one.time), 1 / 60)
