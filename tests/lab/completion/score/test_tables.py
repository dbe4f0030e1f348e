"""Tables of completion: known errors give known figures, padding does not count, all keys are present."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.skeleton import BODY, LOWER_BODY
from bodysense.cli import main
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense.observing.observation import Observation
from bodysense.parallel import parallel_map
from bodysense.quality.metrics import jitter
from bodysense_lab.completion.data.blinks import FINGER, with_finger
from bodysense_lab.completion.score import scoring, tables
from bodysense_lab.completion.score.scenes import TrackedScene, scene_of
from bodysense_lab.completion.score.scoring import evaluate_completion
from bodysense_lab.completion.score.sight.sight import jump_frames
from bodysense_lab.completion.score.tables import (
    TAKE_MEASURES,
    CompletionSettings,
    CompletionTable,
    completion_reports,
    headline,
)
from bodysense_lab.completion.score.tracking import PeopleTracker, TrackedMotion, TrackPeople, track_people
from bodysense_lab.completion.training.options import BODIES, BODY_TITLES, TABLE_SETS
from bodysense_lab.core.scoring import scored_points, suffix_of
from bodysense_lab.data.datasets import Census, DataSet

from ..conftest import Oracle

SMALL = CompletionSettings(sets=("three_point", "headset_camera"))


def score(clips: list[Clip], track: TrackPeople, settings: CompletionSettings = SMALL) -> CompletionTable:
    return evaluate_completion(clips, settings, track=track, times=None)


def figure(table: CompletionTable, sensors: str, body: str, name: str) -> float:
    """Return a figure of a cell of the main categories; NaN if nothing was counted."""
    return table.numbers().get(f"{sensors}_{body}_{name}", math.nan)


def shift_legs(position: np.ndarray, scene: TrackedScene) -> np.ndarray:
    position[:, scene.skeleton.indices(LOWER_BODY)] += [0.0, 0.0, 0.05]
    return position


def test_the_truth_scores_nothing(clips: list[Clip], scenes: list[TrackedScene]) -> None:
    table = score(clips, Oracle(scenes, confidence=0.01))
    numbers = table.numbers()
    for sensors in SMALL.sets:
        for body in BODIES:
            for group in ("main", "sport"):

                def get(name: str, cell: str = f"{sensors}_{body}", group: str = group) -> float:
                    return numbers.get(f"{cell}_{name}{suffix_of(group)}", math.nan)

                for name in ("mpjpe_cm", "lower_mpjpe_cm", "upper_mpjpe_cm", "rotation_deg", "velocity_cm_s"):
                    assert get(name) == pytest.approx(0, abs=1e-4), (sensors, body, name)
                assert get("jumps_per_minute") == 0
                for name in ("float_share", "backward_knee_share", "false_steps_per_minute", "elbow_deg"):
                    assert get(name) == pytest.approx(0, abs=1e-4, nan_ok=name == "float_share"), (sensors, body, name)
                for name in ("jumps_at_change_per_minute", "jumps_elsewhere_per_minute"):
                    assert get(name) == 0
                for name in ("jitter", "skate_cm_s", "depth_cm"):
                    truth = table.truths[tables.TRUTH_OF[body], group].get(name)
                    assert get(name) == pytest.approx(truth, nan_ok=True)
            assert f"{sensors}_{body}_mpjpe_cm_dance" not in numbers
    assert figure(table, "headset_camera", "own", "occluded_mpjpe_cm") == pytest.approx(0, abs=1e-9)
    assert table.ratio("stranger") == pytest.approx(0, abs=1e-9)
    assert np.isnan(figure(table, "three_point", "own", "occluded_mpjpe_cm"))
    own = next(scene for scene in scenes if scene.name == "cleo/cleo-waves")
    assert table.truths["own", "sport"].get("jitter") == pytest.approx(jitter(own.world_pose[0][:, : len(BODY)], 30.0))


def test_a_known_displacement_gives_known_figures(clips: list[Clip], scenes: list[TrackedScene]) -> None:
    """Nine of 22 joints are off by 5 cm, and expected errors equal true errors."""
    table = score(clips, Oracle(scenes, shift_legs))
    for body in BODIES:
        assert figure(table, "three_point", body, "lower_mpjpe_cm") == pytest.approx(5)
        assert figure(table, "three_point", body, "upper_mpjpe_cm") == pytest.approx(0, abs=1e-9)
        assert figure(table, "three_point", body, "mpjpe_cm") == pytest.approx(5 * 9 / 22)
        assert figure(table, "three_point", body, "velocity_cm_s") == pytest.approx(0, abs=1e-9)
    main = [scene for scene in scenes[::2] if scene.group == "main"]
    hidden, legs = 0, 0
    for scene in main:
        tested = scored_points(scene.skeleton)
        hidden += int((~scene.visible[:, tested]).sum())
        below = [point for point in tested if scene.skeleton.points[point] in LOWER_BODY]
        legs += int((~scene.visible[:, below]).sum())
    assert figure(table, "headset_camera", "own", "occluded_mpjpe_cm") == pytest.approx(5 * legs / hidden)
    assert table.cells["headset_camera", "own", "main"].root("occluded_square") == pytest.approx(
        5 * np.sqrt(legs / hidden)
    )
    one = table.calibration("three_point", region="lower")
    assert (one.ece, one.coverage) == (pytest.approx(0, abs=1e-9), 1.0)
    assert one.count == 9 * 4 * sum(len(scene) for scene in main)
    doubted = score(clips, Oracle(scenes, shift_legs, confidence=0.1)).calibration("three_point", "own", "lower")
    assert doubted.ece == pytest.approx(1.0)


def test_tracked_joints_do_not_count_for_calibration(clips: list[Clip], scenes: list[TrackedScene]) -> None:
    counted = score(clips, Oracle(scenes, shift_legs)).calibration("three_point", "own", "upper").count
    assert counted == (13 - 3) * (90 + 60)  # without head and wrists


def test_other_clips_in_a_batch_change_no_score(clips: list[Clip], scenes: list[TrackedScene]) -> None:
    """A clip has the same scores alone and in a batch with longer clips; averages are over frames."""

    def drifting(position: np.ndarray, scene: TrackedScene) -> np.ndarray:
        body = [point for point in range(65) if scene.skeleton.points[point] != "head"]
        position[:, body] += 0.001 * np.arange(len(position))[:, None, None]
        return position

    together = score(clips, Oracle(scenes, drifting))
    alone = [score([clip], Oracle(scenes, drifting)) for clip in clips[:2]]
    for name in ("mpjpe_cm", "rotation_deg", "depth_cm"):
        one, two = (figure(table, "three_point", "stranger", name) for table in alone)
        assert figure(together, "three_point", "stranger", name) == pytest.approx((90 * one + 60 * two) / 150)
    assert figure(together, "three_point", "own", "velocity_cm_s") == pytest.approx(100 * 0.001 * 3**0.5 * 30 * 21 / 22)


def count_jumps(position: np.ndarray, truth: np.ndarray, order: int = 1) -> int:
    return int(jump_frames(position, truth, 0.05, order).sum())


def test_jumps_are_counted_beyond_the_truth() -> None:
    truth = np.zeros((10, 3, 3))
    truth[:, 0, 0] = 0.3 * np.arange(10)  # 30 cm a frame
    position = truth + np.array([0.0, 0.2, 0.0])
    assert count_jumps(position, truth) == 0
    position[5, 1, 1] += 0.06
    assert count_jumps(position, truth) == 2  # there and back
    position[5, 2, 1] += 0.06
    assert count_jumps(position, truth) == 2  # frames, not joints
    position[8, 0, 0] += 0.04
    assert count_jumps(position, truth) == 2
    smooth = truth + 0.07 * np.arange(10)[:, None, None] * [0.0, 1.0, 0.0]  # 7 cm a frame, throughout
    assert (count_jumps(smooth[:, 1:], truth[:, 1:]), count_jumps(smooth, truth, 2)) == (9, 0)
    smooth[5:, 1, 1] += 0.06
    assert count_jumps(smooth, truth, 2) == 2  # off its course, and back on it


def test_takes_have_the_measures_of_live_tracking(clips: list[Clip]) -> None:
    """Takes completed by live tracking have its figures; without `takes` there are no figures of takes."""

    def live(person: Person, seen: Observation) -> TrackedMotion:
        return track_people([person], [seen])[0]

    settings = CompletionSettings(sets=("headset_camera",), bodies=("own",), takes=True)
    numbers = evaluate_completion(clips[:1], settings, takes=live, times=None).numbers()
    suffix = next(name for name in numbers if "_take_mpjpe_cm" in name).partition("_take_mpjpe_cm")[2]
    for name in TAKE_MEASURES:
        live_figure = numbers[f"headset_camera_own_{name}{suffix}"]
        assert numbers[f"headset_camera_own_take_{name}{suffix}"] == pytest.approx(live_figure, abs=1e-3)
    for name in ("float_share", "false_steps_per_minute", "elbow_deg", "pj_ratio", "auj"):
        key = f"headset_camera_own_{name}{suffix}"
        assert numbers.get(f"headset_camera_own_take_{name}{suffix}") == pytest.approx(numbers.get(key), rel=1e-6), name
    assert "headset_camera_own_take_pj_ratio" + suffix in numbers
    assert 0 < numbers["headset_camera_own_take_cover90" + suffix] <= 1
    assert 0.1 < numbers["headset_camera_own_take_expected_cm" + suffix] < 40
    assert not any("_take_" in name for name in evaluate_completion(clips[:1], settings, times=None).numbers())


@pytest.fixture(scope="module")
def table(clips: list[Clip], scenes: list[TrackedScene]) -> CompletionTable:
    settings = CompletionSettings()
    return evaluate_completion(
        clips, settings, track=Oracle(scenes, shift_legs), times=lambda person, seen: np.full(len(seen), 0.001)
    )


def test_all_keys_are_present(table: CompletionTable) -> None:
    numbers = table.numbers()
    for name in TABLE_SETS:
        for body in BODIES:
            for measure in ("mpjpe_cm", "rotation_deg", "jumps_per_minute", "velocity_cm_s", "jitter", "depth_cm"):
                assert np.isfinite(numbers[f"{name}_{body}_{measure}"])
            assert f"{name}_{body}_skate_cm_s" in numbers or not table.truths["own", "main"].weight.get("skate_cm_s")
            assert numbers[f"{name}_{body}_p50_ms"] == numbers[f"{name}_{body}_p99_ms"] == 1.0
        assert np.isfinite(numbers[f"{name}_ece"]) and 0 <= numbers[f"{name}_cover90"] <= 1
    for body in BODIES:
        assert numbers[f"headset_camera_{body}_occluded_mpjpe_cm"] > 0 and numbers[f"headset_camera_{body}_ratio"] > 0


@pytest.mark.slow
def test_reports_and_picture(table: CompletionTable, tmp_path: Path) -> None:
    data = DataSet("motion", tmp_path, "test")
    short, whole, sight, sure, confidence = completion_reports(table, Census(3, frozenset("a"), 6.0), data, 3)
    assert [row[0] for row in short.rows] == [name.replace("_", " ") for name in TABLE_SETS]
    assert short.columns == ("sensors", *BODY_TITLES.values()) and short.numbers["clips"] == 3
    assert {len(row) for row in whole.rows} == {len(whole.columns)}
    assert {row[0] for row in whole.rows} == {"main", "sport"}
    assert {len(row) for row in sight.rows} == {len(sight.columns)} and len(sight.rows) == 2 * len(TABLE_SETS) * len(
        BODIES
    )
    assert {len(row) for row in sure.rows} == {len(sure.columns)}
    assert len(sure.rows) == len(TABLE_SETS) * len(BODIES)
    for name in TABLE_SETS:
        for body in BODIES:
            one = table.interval(name, body)
            assert one.low <= one.value <= one.high
            assert one.value == pytest.approx(figure(table, name, body, headline(name)))
    assert {len(row) for row in confidence.rows} == {len(confidence.columns)}
    assert short.numbers["clips_in_split"] == 3 and len(short.data) == 1
    sample = completion_reports(table, Census(3, frozenset("a"), 6.0), data, 5)[0]
    one = table.interval(TABLE_SETS[0], BODIES[0])
    assert sample.data[1].startswith("A sample: 3 of 5 clips.")
    assert not np.isfinite(one.low) or f"between {one.low:.2f} and {one.high:.2f} cm" in sample.data[1]


def test_a_finger_that_is_never_tracked_changes_nothing(clips: list[Clip]) -> None:
    """The table can therefore reuse the result of the set without that finger."""
    scene = scene_of(clips[0], "own", "test").beginning(40)
    seen = scene.observe(SENSOR_SETS["three_point"])
    grown = with_finger(seen, scene.world_pose[0][:, scene.skeleton.index(FINGER)], blinking=False)
    assert FINGER in grown.points and FINGER not in seen.points
    without, steady = (track_people([Person(scene.skeleton)], [one])[0].position for one in (seen, grown))
    np.testing.assert_array_equal(without, steady)


@pytest.mark.slow
def test_processes_share_the_work(clips: list[Clip]) -> None:
    settings = CompletionSettings(sets=("three_point",), bodies=("own", "stranger"))
    score_with = partial(evaluate_completion, clips, settings, track=PeopleTracker(None), times=None)
    one, two = score_with().numbers(), score_with(parallel_map=partial(parallel_map, jobs=2)).numbers()
    assert one == pytest.approx(two, nan_ok=True)


def test_the_command(
    tmp_path: Path, clips: list[Clip], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for clip in clips:
        (tmp_path / "motion" / clip.person).mkdir(parents=True)
        write_bvh(tmp_path / "motion" / clip.person / "a.bvh", clip)

    def still(people: Sequence[Person], observations: Sequence[Observation]) -> list[TrackedMotion]:
        shapes = ((65, 3), (52, 4), (65,), (65,), (4,))
        return [TrackedMotion(*(np.zeros((len(one), *shape)) for shape in shapes)) for one in observations]

    known = partial(evaluate_completion, track=still, times=None)
    monkeypatch.setattr(scoring, "evaluate_completion", known)
    numbers, measures = tmp_path / "c.json", tmp_path / "c.csv"
    arguments = ["evaluate", "completion", "--data", str(tmp_path / "motion"), "--split", "all", "--jobs", "1"]
    arguments += ["--sets", "head", "headset_camera", "--bodies", "own", "nothing", "--limit", "2"]
    files = ["--json", str(numbers), "--csv", str(measures)]
    files += ["--keep", str(tmp_path / "kept")]
    assert main([*arguments, *files]) == 0
    found = json.loads(numbers.read_text())
    assert {"head_own_mpjpe_cm", "headset_camera_nothing_ratio", "head_ece", "clips", "cpu_seconds"} <= set(found)
    assert found["clips"] == 2 and not any(name.startswith("head_stranger") for name in found)
    assert measures.is_file() and "hidden joints" in capsys.readouterr().out
    assert main([*arguments, *files]) == 0  # with saved results of clips
    assert set(found) - set(json.loads(numbers.read_text())) == {"cpu_seconds"}
    assert main([*arguments, "--sets", "nose"]) == 2
    assert "--sets nose: unknown; valid are head, three_point" in capsys.readouterr().err
    assert main([*arguments, "--backward-model", "own.safetensors"]) == 2
    assert "--backward-model: only takes are tracked backward" in capsys.readouterr().err
    assert main([*arguments, "--limit", "0"]) == 2
