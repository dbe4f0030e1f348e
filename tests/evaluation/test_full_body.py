"""Scores of a whole body: known errors come out as known figures, and the table has every key that is asked for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, LOWER_BODY, Skeleton
from bodysense.data.augment import at_height
from bodysense.data.clip import Clip
from bodysense.estimators.estimate import PointEstimate
from bodysense.evaluation.datasets import DataSet
from bodysense.evaluation.full_body import Mean, evaluate_full_body
from bodysense.evaluation.metrics import jitter
from bodysense.evaluation.report import Report
from bodysense.evaluation.three_point_table import PUBLISHED, evaluate_three_point, shipped_on, three_point_report
from bodysense.observation import Observation
from bodysense.occlusion.three_point import HEAD_ONLY


@dataclass(frozen=True)
class Knows:
    """Says the truth, its legs moved by `miss` m and its body by `drift` m a frame."""

    skeleton: Skeleton
    pose: Pose
    miss: float = 0.0
    drift: float = 0.0

    def start(self) -> int:
        return 0

    def step(self, observation: Observation, state: int) -> tuple[PointEstimate, int]:
        frames = np.arange(state, state + len(observation))
        size = self.skeleton.height / self.pose.skeleton.height
        root = self.pose.root_position[frames] * size + self.drift * frames[:, None] * np.array([1.0, 0, 0])
        pose = Pose(self.skeleton, root, self.pose.rotation[frames])
        position = np.asarray(forward_kinematics(pose)[0]).copy()
        position[:, self.skeleton.indices(LOWER_BODY)] += [0.0, 0.0, self.miss]
        known = np.zeros(position.shape[:-1])
        return PointEstimate(self.skeleton, position, known, known + 0.01, pose), int(frames[-1]) + 1


def knows(clip: Clip, **errors: float) -> partial[Knows]:
    return partial(Knows, pose=clip.pose, **errors)


def test_the_truth_scores_nothing(waving_clip: Clip) -> None:
    scores = evaluate_full_body([waving_clip], knows(waving_clip))
    for stage in ("estimate", "tracked"):
        for measure in ("mpjpe_cm", "rotation_deg", "mpjre_component_deg", "velocity_cm_s", "hands_world_cm"):
            assert scores.get(measure, stage) == pytest.approx(0, abs=0.05), (stage, measure)
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])[:, : len(BODY)]
    assert scores.get("jitter", "truth") == pytest.approx(jitter(truth, 30.0))
    assert scores.get("jitter", "estimate") == pytest.approx(jitter(truth, 30.0), rel=1e-6)
    assert np.isnan(scores.get("mpjpe_cm", "tracked", "dance")) and (scores.clips, scores.seconds) == (1, 3.0)


def test_a_known_error_is_counted_where_it_is(waving_clip: Clip) -> None:
    """Nine of 22 joints are off by 5 cm; a body that drifts by 1 cm a frame is 30 cm/s too fast, and skates so."""
    off = evaluate_full_body([waving_clip], knows(waving_clip, miss=0.05), tracked=False)
    assert off.get("lower_mpjpe_cm", "estimate") == pytest.approx(5)
    assert off.get("upper_mpjpe_cm", "estimate") == pytest.approx(0, abs=1e-9)
    assert off.get("mpjpe_cm", "estimate") == pytest.approx(5 * 9 / 22)
    drifting = evaluate_full_body([waving_clip], knows(waving_clip, drift=0.01), tracked=False)
    assert drifting.get("mpjpe_cm", "estimate") == pytest.approx(0, abs=1e-9)
    assert drifting.get("velocity_cm_s", "estimate") == pytest.approx(30)
    assert drifting.get("head_world_cm", "estimate") == pytest.approx(89 / 2)
    assert np.isnan(drifting.get("mpjpe_cm"))


def test_a_height_scales_clip_and_error(waving_clip: Clip) -> None:
    tall = evaluate_full_body([waving_clip], knows(waving_clip, miss=0.05), tracked=False, height=2.0)
    same = evaluate_full_body([at_height(waving_clip, 2.0)], knows(waving_clip, miss=0.05), tracked=False)
    assert tall.get("jitter", "truth") == pytest.approx(same.get("jitter", "truth"))
    assert tall.get("lower_mpjpe_cm", "estimate") == pytest.approx(5)


def test_a_height_is_taken_from_the_headset(waving_clip: Clip) -> None:
    """Of a body that stands; of one on its knees the height that is said is too small for anybody."""
    kneeling = replace(
        waving_clip, pose=replace(waving_clip.pose, root_position=waving_clip.pose.root_position * [1, 0.4, 1])
    )
    scores = evaluate_full_body([waving_clip, kneeling], knows(waving_clip), tracked=False, measured=True)
    assert scores.get("refused", "estimate") == pytest.approx(0.5)
    assert 0 < scores.get("height_error_cm", "estimate") < 8
    told = evaluate_full_body([waving_clip], knows(waving_clip), tracked=False)
    assert scores.get("mpjpe_cm", "estimate") > told.get("mpjpe_cm", "estimate")


def test_means_are_over_frames(waving_clip: Clip) -> None:
    """Of clips of different length in two groups."""
    short = replace(waving_clip, pose=waving_clip.pose[:30])
    dance = replace(waving_clip, category="dance")
    make = knows(waving_clip, drift=0.01)
    scores = evaluate_full_body([waving_clip, short, dance], make, tracked=False)
    one, two = (evaluate_full_body([clip], make, tracked=False) for clip in (waving_clip, short))
    expected = (90 * one.get("head_world_cm", "estimate") + 30 * two.get("head_world_cm", "estimate")) / 120
    assert scores.get("head_world_cm", "estimate") == pytest.approx(expected)
    assert scores.get("head_world_cm", "estimate", "dance") == pytest.approx(one.get("head_world_cm", "estimate"))
    assert np.isnan(Mean().value)


def test_processes_agree(waving_clip: Clip, small_three_point: Path) -> None:
    clips, make = [waving_clip, waving_clip], partial(shipped_on, model=small_three_point)
    alone, shared = (evaluate_full_body(clips, make, HEAD_ONLY, tracked=False, jobs=jobs) for jobs in (1, 2))
    assert {key: mean.value for key, mean in alone.sums.items()} == {k: m.value for k, m in shared.sums.items()}


@pytest.fixture(scope="module")
def report(waving_clip: Clip, small_three_point: Path, tmp_path_factory: pytest.TempPathFactory) -> Report:
    from bodysense.data.bvh import write_bvh

    folder = tmp_path_factory.mktemp("motion")
    (folder / "anna").mkdir()
    write_bvh(folder / "anna" / "a.bvh", replace(waving_clip, pose=waving_clip.pose[:30]))
    data = DataSet("motion", folder, "all")
    table, census = evaluate_three_point(data, small_three_point, 1, lambda clip: None)
    return three_point_report(table, census, data)


def test_the_table_has_every_figure(report: Report) -> None:
    wanted = (
        *("mpjpe_cm", "lower_mpjpe_cm", "upper_mpjpe_cm", "rotation_deg", "mpjre_component_deg"),
        *("velocity_cm_s", "jitter", "skate_cm_s", "penetration_cm"),
    )
    keys = {f"best_{name}" for name in wanted} | {
        *("truth_jitter", "baseline_mpjpe_cm", "head_only_mpjpe_cm", "unlocked_skate_cm_s", "unlocked_penetration_cm"),
        *("height_1.5_mpjpe_cm", "height_1.7_mpjpe_cm", "height_2.0_mpjpe_cm", "clips", "minutes"),
        *("untold_mpjpe_cm", "untold_height_error_cm", "untold_refused"),
    }
    missing = keys - set(report.numbers)
    # A waving body may stand in no frame long enough to skate.
    assert not {name for name in missing if "skate" not in name}
    assert all(np.isfinite(value) for value in report.numbers.values())
    names = [row[1] for row in report.rows]
    assert set(PUBLISHED) <= set(names) and all(len(row) == len(report.columns) for row in report.rows)
    assert any("1.5 m" in remark for remark in report.remarks)


def test_a_larger_body_errs_in_proportion(report: Report) -> None:
    for height in (1.5, 2.0):
        ratio = report.numbers[f"height_{height}_mpjpe_cm"] / report.numbers["height_1.7_mpjpe_cm"] * 1.7 / height
        assert ratio == pytest.approx(1, abs=0.15)
