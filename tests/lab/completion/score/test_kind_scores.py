"""Table of kinds: variants of sets, a head that is lost, expected errors, pairs of sets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.observing.observation import Observation
from bodysense.parallel import parallel_map
from bodysense_lab.completion.kinds.kind_scores import (
    VARIANTS,
    KindJob,
    kind_jobs,
    kind_numbers,
    kind_report,
    score_all,
    score_kind,
)
from bodysense_lab.completion.kinds.lattice import random_edges
from bodysense_lab.completion.kinds.lattice_scores import score_lattice
from bodysense_lab.completion.score.scenes import TrackedScene, scene_of
from bodysense_lab.completion.score.tracking import TrackedMotion


@pytest.fixture(scope="module")
def scene() -> TrackedScene:
    clip = packaged_performance()
    return scene_of(replace(clip, pose=clip.pose[:150]), "own", "test")


class Oracle:
    """Tracker that knows the truth, up to an error of the left knee and a shift of the whole body."""

    def __init__(self, scene: TrackedScene, knee: float = 0.0, lost_head: float = 0.0) -> None:
        self.scene, self.knee, self.lost_head = scene, knee, lost_head
        self.seen: list[Observation] = []

    def __call__(self, people: Sequence[Person], observations: Sequence[Observation]) -> list[TrackedMotion]:
        self.seen += observations
        tracked = []
        for one in observations:
            position = self.scene.world_pose[0].copy()
            position[:, self.scene.skeleton.index("left_knee"), 1] += self.knee
            if "head" in one.points:
                lost = ~one.has_position[:, one.points.index("head")]
                position[lost, self.scene.skeleton.index("right_knee"), 1] += self.lost_head
            position += [0.3, 0.0, -0.2]
            size = np.full(position.shape[:2], 0.02)
            rotation, contact = self.scene.pose.rotation, np.zeros((len(position), 4))
            tracked.append(TrackedMotion(position, rotation, size, 2 * size, contact))
        return tracked


def test_errors_are_relative_to_the_pelvis_and_expected_ones_of_hidden_joints(scene: TrackedScene) -> None:
    score = score_kind(KindJob("three_point", "", (SENSOR_SETS["three_point"],)), [scene], Oracle(scene, 0.22))
    assert score.error == pytest.approx(22 / 22)
    assert score.expected == pytest.approx(2.0) and score.true == pytest.approx(22 / 19)
    assert score.covered == pytest.approx(18 / 19)


@pytest.mark.parametrize("lost", ["position", "rotation", "pose"])
def test_a_lost_head_is_scored_while_it_is_lost(scene: TrackedScene, lost: str) -> None:
    oracle = Oracle(scene, lost_head=0.22)
    score = score_kind(KindJob("a", "", (SENSOR_SETS["three_point"],), lost), [scene], oracle)
    assert score.error == pytest.approx(0.0 if lost == "rotation" else 1.0, abs=1e-9)
    (seen,) = oracle.seen
    head = seen.points.index("head")
    hidden = np.arange(150) % 120 >= 90
    np.testing.assert_array_equal(~seen.has_position[:, head], hidden & (lost != "rotation"))
    np.testing.assert_array_equal(~seen.has_rotation[:, head], hidden & (lost != "position"))
    assert np.isnan(seen.position[~seen.has_position]).all() and np.isnan(seen.rotation[~seen.has_rotation]).all()
    others = np.arange(len(seen.points)) != head
    assert seen.has_position[:, others].all() and seen.has_rotation[:, others].all()


def test_variants_leave_out_the_head_the_rotations_or_the_positions() -> None:
    sensors = SensorSet(("head", "pelvis"), ("head", "left_knee"))
    variants = {name: change(sensors) for name, change in VARIANTS.items()}
    assert variants == {
        "": sensors,
        "no_head": SensorSet(("pelvis",), ("left_knee",)),
        "rotations": SensorSet((), ("head", "left_knee")),
        "positions": SensorSet(("head", "pelvis"), ()),
    }


def test_cells_have_no_empty_and_no_equal_variants() -> None:
    jobs = kind_jobs(3)
    cells = [(job.row, job.variant) for job in jobs]
    assert len(set(cells)) == len(cells) and ("mocopi_six", "no_head") in cells
    assert ("mocopi_six", "rotations") not in cells and ("mocopi_six", "positions") not in cells
    assert ("head_position", "no_head") not in cells
    assert all(one.points for job in jobs for one in job.sets)
    assert {job.row for job in jobs if len(job.sets) == 3} >= {"random_any", "random_alone"}
    assert kind_jobs(3) == jobs


def test_numbers_and_report(scene: TrackedScene) -> None:
    track, jobs = Oracle(scene, 0.22), [job for job in kind_jobs(0) if job.row in ("mocopi_six", "head_position")]
    scores = score_all(jobs, [scene], track, lambda work, items: parallel_map(work, items, 1), lambda name: None)
    edges = score_lattice(random_edges(3), [scene], track)
    numbers = kind_numbers(scores, edges)
    assert numbers["mocopi_six_cm"] == numbers["mocopi_six_no_head_cm"] == pytest.approx(1.0)
    assert numbers["mocopi_six_expected_ratio"] == pytest.approx(2.0)  # all 22 joints have no position
    assert numbers["pairs"] == 3 and numbers["pairs_worse"] == 0 and abs(numbers["pairs_worst_share"]) < 1e-9
    report = kind_report(scores, edges, "motion, test", 1)
    assert [row[0] for row in report.rows] == ["mocopi six", "head position"]
    assert {len(row) for row in report.rows} == {len(report.columns)}
    assert report.rows[0][3] is None and report.numbers["clips"] == 1.0
