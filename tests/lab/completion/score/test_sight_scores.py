"""Scores of visible faults over clips: known faults give known figures, and saved results equal new ones."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from bodysense.body.person import Person
from bodysense.body.skeleton import LOWER_BODY
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation
from bodysense_lab.completion.data.blinks import EVERY, FINGER, gap_seconds, lose_hands, with_finger
from bodysense_lab.completion.score.clip_results import ClipResults
from bodysense_lab.completion.score.measures import count_jumps
from bodysense_lab.completion.score.scenes import TrackedScene
from bodysense_lab.completion.score.scores import histogram, percentile
from bodysense_lab.completion.score.scoring import evaluate_completion
from bodysense_lab.completion.score.sight.sight_scores import CellScores, measure_sight, measure_transitions
from bodysense_lab.completion.score.tables import CompletionSettings, WorstFrame
from bodysense_lab.completion.score.tracking import TrackedMotion, track_people
from bodysense_lab.completion.score.worst import draw_worst, worst_frames
from bodysense_lab.core.scoring import RATE

from ..conftest import Oracle

SMALL = CompletionSettings(sets=("three_point", "headset_camera"))


def exact(scene: TrackedScene, position: np.ndarray | None = None) -> TrackedMotion:
    shape = scene.world_pose[0].shape[:2]
    return TrackedMotion(
        position=scene.world_pose[0].copy() if position is None else position,
        rotation=scene.pose.rotation.copy(),
        confidence=np.full(shape, 0.01),
        bound=np.full(shape, 0.02),
        contact=np.zeros((len(scene), 4)),
    )


@pytest.fixture(scope="module")
def scene(scenes: list[TrackedScene]) -> TrackedScene:
    return scenes[0]


@pytest.fixture(scope="module")
def seen(scene: TrackedScene) -> Observation:
    return scene.observe(SENSOR_SETS["three_point"])


def test_errors_of_measured_points_are_counted(scene: TrackedScene, seen: Observation) -> None:
    """A wrist that is 3 cm off is one of three measured points, and beyond its bound of 2 cm."""
    position = scene.world_pose[0].copy()
    position[:, scene.skeleton.index("left_wrist"), 0] += 0.03
    numbers = measure_sight(scene, seen, exact(scene, position)).numbers()
    assert numbers["measured_p95_cm"] == pytest.approx(3, rel=0.01)
    assert numbers["measured_covered"] == pytest.approx(2 / 3)
    assert measure_sight(scene, seen, exact(scene)).numbers()["measured_covered"] == 1


def test_errors_of_measured_rotations_are_counted(scene: TrackedScene, seen: Observation) -> None:
    """One of three measured joints, the head, is turned by 4°; a turn of only 0.3 s does not count."""
    head, turned = scene.skeleton.index("head"), exact(scene)
    turn = quaternion_exp(np.radians([4.0, 0.0, 0.0]))
    turned.rotation[:, head] = quaternion_multiply(turned.rotation[:, head], turn)
    assert measure_sight(scene, seen, turned).numbers()["measured_rotation_deg"] == pytest.approx(4, rel=0.01)
    turned.rotation[round(0.3 * RATE) :, head] = scene.pose.rotation[round(0.3 * RATE) :, head]
    assert measure_sight(scene, seen, turned).numbers()["measured_rotation_deg"] == pytest.approx(0, abs=1e-3)
    hidden = scene.skeleton.index("left_hip")  # its rotation is not measured
    turned.rotation[:, hidden] = quaternion_multiply(turned.rotation[:, hidden], turn)
    assert measure_sight(scene, seen, turned).numbers()["measured_rotation_deg"] == pytest.approx(0, abs=1e-3)


def test_jumps_at_and_away_from_mask_changes_are_separate(scene: TrackedScene, seen: Observation) -> None:
    lost = with_finger(seen, scene.world_pose[0][:, scene.skeleton.index(FINGER)], False)
    lost.has_position[30, lost.points.index(FINGER)] = True  # changes in frames 30 and 31
    lost.position[30, lost.points.index(FINGER)] = 0.0
    position = scene.world_pose[0].copy()
    position[31:, scene.skeleton.index("left_knee"), 1] += 0.2
    position[50:, scene.skeleton.index("left_knee"), 1] += 0.2
    numbers = measure_sight(scene, lost, exact(scene, position)).numbers()
    minutes = (len(scene) - 1) / RATE / 60
    assert numbers["jumps_at_change_per_minute"] * minutes == pytest.approx(1)
    assert numbers["jumps_elsewhere_per_minute"] * minutes == pytest.approx(1)


def test_a_hand_that_leaps_back_has_a_higher_peak_of_jerk(scene: TrackedScene, seen: Observation) -> None:
    lost = lose_hands(seen, np.random.default_rng(0))
    assert (~lost.has_position[:, 1]).any()
    same = measure_transitions(scene, lost, exact(scene)).numbers()
    assert same["pj_ratio"] == 1 and same["auj"] == 0
    position = scene.world_pose[0].copy()
    hidden = ~lost.has_position[:, lost.points.index("left_wrist")]
    position[hidden, scene.skeleton.index("left_wrist"), 1] -= 0.3
    leapt = measure_transitions(scene, lost, exact(scene, position)).numbers()
    assert leapt["pj_ratio"] > 1.5 and leapt["auj"] > 0


def test_gaps_have_the_measured_durations() -> None:
    gaps = gap_seconds(200_000, np.random.default_rng(1))
    assert np.median(gaps) == pytest.approx(0.1, rel=0.05)
    assert (gaps < 0.2).mean() == pytest.approx(0.61, abs=0.01)
    assert (gaps > 1).mean() == pytest.approx(0.11, abs=0.01)
    assert np.percentile(gaps, 99) == pytest.approx(6.7, rel=0.05)
    assert gaps.max() <= 17


@given(st.integers(0, 100))
def test_only_hands_are_lost_and_each_on_its_own(seed: int) -> None:
    frames, points = 1800, ("head", "left_wrist", "left_index1", "right_wrist")
    seen = Observation(
        points,
        np.zeros((frames, 4, 3)),
        np.tile([1.0, 0.0, 0.0, 0.0], (frames, 4, 1)),
        np.ones((frames, 4), dtype=bool),
        np.ones((frames, 4), dtype=bool),
        np.full((frames, 4), 0.001),
        np.arange(frames) / RATE,
    )
    lost = check_observation(lose_hands(seen, np.random.default_rng(seed)))
    head, left, finger, right = lost.has_position.T
    assert head.all() and (left == finger).all() and (left != right).any()
    assert 0 < (~left).mean() < 0.9 and (lost.has_rotation == lost.has_position).all()


def test_a_finger_blinks_and_nothing_else_changes(scene: TrackedScene, seen: Observation) -> None:
    place = scene.world_pose[0][:, scene.skeleton.index(FINGER)]
    blinking, steady = (check_observation(with_finger(seen, place, on)) for on in (True, False))
    on = blinking.has_position[:, -1]
    np.testing.assert_array_equal(np.flatnonzero(np.diff(on.astype(int))) + 1, np.arange(EVERY, len(scene), EVERY))
    assert not steady.has_position[:, -1].any() and steady.points == blinking.points
    np.testing.assert_array_equal(blinking.has_position[:, :-1], seen.has_position)
    camera = scene.observe(SENSOR_SETS["headset_camera"])
    hidden = with_finger(camera, place, True)
    finger = camera.points.index(FINGER)
    others = np.arange(len(camera.points)) != finger
    np.testing.assert_array_equal(hidden.has_position[:, others], camera.has_position[:, others])
    assert not (hidden.has_position[:, finger] & ~camera.has_position[:, finger]).any()


@given(st.lists(st.floats(0, 100), min_size=1, max_size=50), st.sampled_from([5, 50, 95]))
def test_quantiles_are_true_to_one_percent(values: list[float], percent: float) -> None:
    half = len(values) // 2
    count = histogram(np.array(values[:half])) + histogram(np.array(values[half:]))
    exact = float(np.percentile(values, percent, method="inverted_cdf"))
    assert percentile(count, percent) == pytest.approx(exact, rel=0.011, abs=2e-6)
    assert math.isnan(percentile(np.zeros(9), 50))


def test_merged_scores_equal_the_whole(scenes: list[TrackedScene]) -> None:
    whole, parts = CellScores(), []
    for scene in scenes[:2]:
        shaken = scene.world_pose[0] + np.random.default_rng(3).normal(0, 0.02, scene.world_pose[0].shape)
        parts.append(measure_sight(scene, scene.observe(SENSOR_SETS["headset_camera"]), exact(scene, shaken)))
        whole.merge(parts[-1])
    shares = [(one.get("measured_covered"), one.weight["measured_covered"]) for one in parts]
    mean = sum(value * weight for value, weight in shares) / sum(weight for _, weight in shares)
    assert whole.numbers()["measured_covered"] == pytest.approx(mean)


def test_clips_with_saved_results_are_not_scored_again(
    clips: list[Clip], scenes: list[TrackedScene], tmp_path: Path
) -> None:
    def shaken(position: np.ndarray, scene: TrackedScene) -> np.ndarray:
        return position + np.random.default_rng(len(scene)).normal(0, 0.02, position.shape)

    def refuse(people: object, observations: object) -> list[TrackedMotion]:
        raise AssertionError("a clip with saved results was tracked")

    track = Oracle(scenes, shaken)
    fresh = evaluate_completion(clips, SMALL, track=track, times=None)
    results = ClipResults.open(tmp_path / "kept", SMALL, "packaged")
    evaluate_completion(clips[:2], SMALL, track=track, times=None, results=results)
    evaluate_completion(clips, SMALL, track=track, times=None, results=results)
    again = evaluate_completion(
        clips, SMALL, track=refuse, times=None, results=ClipResults.open(results.folder, SMALL, "packaged")
    )
    assert again.numbers() == pytest.approx(fresh.numbers(), nan_ok=True)
    assert set(again.worst) == set(fresh.worst)
    with pytest.raises(BodysenseError, match=r"--keep .*scored with network 'packaged', not 'mine.onnx'"):
        ClipResults.open(results.folder, SMALL, "mine.onnx")


def test_the_sheet_has_the_worst_frames(clips: list[Clip], scenes: list[TrackedScene], tmp_path: Path) -> None:
    def leapt(position: np.ndarray, scene: TrackedScene) -> np.ndarray:
        """Let the body drift from the head by a millimetre a frame, and a knee leap by 30 cm."""
        position[:, scene.skeleton.indices(LOWER_BODY), 1] += 0.001 * np.arange(len(position))[:, None] + 0.1
        if len(position) > 40:
            position[40:, scene.skeleton.index("left_knee"), 0] += 0.3
            position[45:, scene.skeleton.indices(LOWER_BODY), 1] += 0.04
        return position

    cut = [scene.beginning(frames) for scene in scenes for frames in {41, len(scene)} if len(scene) >= frames]
    track = Oracle(cut, leapt)
    table = evaluate_completion(clips, SMALL, track=track, times=None)
    leaps, errors = (worst_frames(table.worst, 12, fault) for fault in ("leap", "error"))
    assert [one.frame for one in leaps] == [40, 40] and len({one.clip for one in leaps}) == 2
    assert all(25 < one.size < 35 for one in leaps) and min(one.frame for one in errors) > 45
    draw_worst(tmp_path / "leaps.png", table.worst, clips, SMALL, track, 2, "leap")
    draw_worst(tmp_path / "worst.png", table.worst, clips, SMALL, track, 1, "error")
    with Image.open(tmp_path / "leaps.png") as drawn, Image.open(tmp_path / "worst.png") as alone:
        assert drawn.width == 3 * alone.width  # two pictures of three bodies, with the frame before; one of two
    with pytest.raises(BodysenseError, match=r"--sheet .*: no clip of the main .*; give a larger --limit"):
        draw_worst(tmp_path / "none.png", [], clips, SMALL, track, 1, "error")
    some = [WorstFrame("head", "own", "a", frame, "error", size) for frame, size in ((1, 2.0), (2, 3.0))]
    assert [one.frame for one in worst_frames(some, 5, "error")] == [2] and not worst_frames(some, 5, "leap")


def test_a_finger_blinks_with_a_tracked_head_alone(clips: list[Clip], scenes: list[TrackedScene]) -> None:
    settings = CompletionSettings(sets=("head",), bodies=("own",))
    numbers = evaluate_completion(clips, settings, track=Oracle(scenes), times=None).numbers()
    assert numbers["head_own_extra_jumps_per_minute"] == 0 and "head_own_pj_ratio" not in numbers


@pytest.mark.parametrize("sensors", ["three_point", "headset_camera", "six_point"])
def test_a_finger_that_blinks_makes_no_body_jump(sensors: str) -> None:
    """With the packaged network, a blinking finger causes no more jumps than a finger that is never tracked."""
    clip = resample(performance_of_unseen_body(), RATE)
    scene = TrackedScene(clip.name, "main", clip.pose)
    seen, place = scene.observe(SENSOR_SETS[sensors]), scene.world_pose[0][:, scene.skeleton.index(FINGER)]
    jumps = []
    for blinking in (False, True):
        (tracked,) = track_people([Person(scene.skeleton)], [with_finger(seen, place, blinking)])
        jumps.append(count_jumps(tracked.position, scene))
    assert jumps[1] <= jumps[0]
