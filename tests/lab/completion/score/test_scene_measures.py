"""Measures of scripted scenes: zero for the truth, and each fault that is made is counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense_lab.completion.score.scripted.scene_measures import BODY, measure_scene
from bodysense_lab.completion.score.scripted.scene_scoring import SETS, SceneJob, observe_scene
from bodysense_lab.completion.score.tracking import TrackedMotion

FEET = [f"{side}_{name}" for side in ("left", "right") for name in ("ankle", "foot", "toe")]


class Case:
    """A scene with the truth as the tracker's result."""

    def __init__(self, kind: str, index: int = 0, sensors: str = "three_point") -> None:
        self.scripted, self.scene, self.lost = SceneJob("val", kind, index).draw()
        self.seen, self.missing = observe_scene(self.scene, SETS[sensors], self.lost)
        truth = self.scene.world_pose[0]
        still = np.full(truth.shape[:2], 0.01)
        self.result = TrackedMotion(truth.copy(), self.scene.pose.rotation, still, still, np.zeros((len(truth), 4)))

    def numbers(self, position: np.ndarray | None = None, rotation: np.ndarray | None = None) -> dict[str, float]:
        result = self.result
        if position is not None:
            result = replace(result, position=position)
        if rotation is not None:
            result = replace(result, rotation=rotation)
        return measure_scene(self.scripted, self.scene, self.seen, result, self.missing).numbers()

    def moved(self, names: list[str], way: np.ndarray) -> np.ndarray:
        """Return the true positions with some points moved by (3,) or (T, 1, 3) m."""
        position = self.result.position.copy()
        position[:, self.scene.skeleton.indices(names)] += way
        return position


@pytest.mark.parametrize("kind", ["step_back", "turn", "kneel_on_both", "bow", "legs_crossed"])
def test_the_truth_has_no_fault(kind: str) -> None:
    numbers = Case(kind).numbers()
    covered = numbers.pop("covered_share")
    numbers.pop("steps")
    assert covered == 1
    assert max(map(abs, numbers.values())) < 1e-9


def test_feet_that_stay_behind_miss_steps_and_glide() -> None:
    case = Case("step_back")
    truth = case.result.position
    away = truth[:, case.scene.skeleton.indices(FEET)] - truth[:1, case.scene.skeleton.indices(FEET)]
    behind = case.numbers(case.moved(FEET, -away * [1.0, 0.0, 1.0]))
    assert case.numbers()["steps"] > 2 and behind["missed_steps_share"] == 1
    time = np.arange(len(truth))[:, None, None] / 30
    slow, fast = (case.numbers(case.moved(FEET, time * [speed, 0.0, 0.0])) for speed in (0.05, 0.2))
    assert slow["gliding_share"] < 0.02 and fast["gliding_share"] > 0.5
    assert fast["false_steps_per_minute"] > 5


def test_feet_that_float_or_cross_or_sink_are_counted() -> None:
    case = Case("bow", 1)
    raised = case.numbers(case.moved(FEET, np.array([0.0, 0.05, 0.0])))
    assert raised["float_bowing_share"] == 1 and case.numbers(case.moved(FEET, np.array([0.0, 0.02, 0.0])))[
        "float_bowing_share"
    ] == 0  # fmt: skip
    kneels = Case("kneel_on_both")
    assert kneels.numbers(kneels.moved(FEET[:3], np.array([0.0, 0.2, 0.0])))["float_kneeling_share"] == 0.5
    assert case.numbers(case.moved(FEET, np.array([0.0, -0.05, 0.0])))["under_floor_share"] == 1
    swapped = case.result.position.copy()
    left, right = (case.scene.skeleton.indices(FEET[k : k + 3]) for k in (0, 3))
    swapped[:, left], swapped[:, right] = swapped[:, right], swapped[:, left].copy()
    assert case.numbers(swapped)["crossed_share"] == 1


def test_a_pelvis_that_is_behind_lags_in_both_directions() -> None:
    lags = []
    for index in range(6):
        case = Case("turn", index)
        truth = np.asarray(case.scene.pose.rotation)
        turning = np.degrees(np.gradient(np.unwrap(2 * np.arctan2(truth[:, 0, 2], truth[:, 0, 0])))) * 30
        late = np.where(np.abs(turning) > 20, -np.sign(turning), 0.0)
        rotation = truth.copy()
        turn = quaternion_exp(np.radians(10.0) * late[:, None] * [0.0, 1.0, 0.0])
        rotation[:, 0] = quaternion_multiply(turn, truth[:, 0])
        lags.append(case.numbers(rotation=rotation)["turn_lag_deg"])
    assert np.allclose(lags, 10.0, atol=0.5)


def test_a_hand_is_scored_while_it_is_lost() -> None:
    case = Case("stand", sensors="lost_hands")
    assert case.missing.sum() == 2 * 90
    moved = case.moved(["left_wrist"], np.array([0.0, 0.2, 0.0]))
    assert case.numbers(moved)["lost_hand_cm"] == pytest.approx(10.0)
    wrist = case.seen.points.index("left_wrist")
    assert np.array_equal(case.seen.has_position[:, wrist], ~case.missing[:, 0])
    assert np.isnan(case.seen.position[case.missing[:, 0], wrist]).all()


def test_the_scenes_of_two_splits_differ_and_those_of_one_repeat() -> None:
    one, again, other = (SceneJob(split, "turn", 0).draw()[0] for split in ("val", "val", "test"))
    assert np.array_equal(one.rotation, again.rotation) and not np.array_equal(one.rotation, other.rotation)
    assert len(BODY) == one.rotation.shape[1]
