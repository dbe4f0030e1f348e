"""The adaptive body: the method follows the signal, nothing jumps, what is measured is where it is measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.glove import default_glove, glove_points, marker_positions
from bodysense.body.hand import hand_skeleton
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.errors import BodysenseError
from bodysense.estimators.adaptive import PROFILES, Adaptive, AdaptiveSettings, Profile, step_many
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.hold import Hold
from bodysense.estimators.ik_tracker import IkTracked, IkTracker
from bodysense.estimators.three_point_answers import load_three_point
from bodysense.observation import Observation
from bodysense.occlusion.three_point import POINTS, observe

SKELETON = default_skeleton()
WHERE, JOINTS = SKELETON.indices(POINTS), SKELETON.indices(BODY)
FINGERS = tuple(name for k, name in enumerate(SKELETON.points) if SKELETON.wrist_of[k] >= 0)
TRACKED = ("pelvis", "left_ankle", "right_ankle")


@pytest.fixture(scope="module")
def adaptive(small_three_point: Path) -> Adaptive:
    return Adaptive(SKELETON, model=load_three_point(small_three_point))


def signal(clip: Clip, points: tuple[str, ...]) -> Observation:
    """Points of a motion, head and hands with rotations."""
    position, rotation = (np.asarray(values) for values in forward_kinematics(clip.pose))
    places = SKELETON.indices(points)
    turned = np.full((len(clip), len(points), 4), np.nan)
    has_rotation = np.zeros((len(clip), len(points)), dtype=bool)
    for k, name in enumerate(points):
        if name in POINTS:
            turned[:, k], has_rotation[:, k] = rotation[:, SKELETON.index(name)], True
    seen = np.ones_like(has_rotation)
    accuracy = np.full(seen.shape, 0.001)
    return Observation(points, position[:, places].copy(), turned, seen, has_rotation, accuracy, np.asarray(clip.time))


def still(observation: Observation, frames: int, rate: float) -> Observation:
    """The first frame for a while, so that all that moves is the method."""
    fields = ("position", "rotation", "has_position", "has_rotation", "accuracy")
    repeated = {name: np.repeat(getattr(observation, name)[:1], frames, axis=0) for name in fields}
    return replace(observation, **repeated, time=np.arange(frames) / rate)


def without(observation: Observation, names: tuple[str, ...], frames: slice) -> Observation:
    has_position, has_rotation = observation.has_position.copy(), observation.has_rotation.copy()
    for k, name in enumerate(observation.points):
        if name in names:
            has_position[frames, k] = has_rotation[frames, k] = False
    return replace(observation, has_position=has_position, has_rotation=has_rotation)


def profiles(adaptive: Adaptive, observation: Observation) -> tuple[list[Profile], PointEstimate]:
    """Frame by frame; also that this is the same as all at once."""
    state, told, rows = adaptive.start(), [], []
    for t in range(len(observation)):
        estimate, state = adaptive.step(observation[t : t + 1], state)
        told.append(state.profile)
        rows.append(estimate.position[0])
    whole, _ = adaptive.step(observation, adaptive.start())
    np.testing.assert_array_equal(np.stack(rows), whole.position)
    return told, whole


def check_whole(estimate: PointEstimate) -> None:
    assert estimate.pose is not None
    values = (estimate.position, estimate.confidence, estimate.occluded, estimate.pose.rotation)
    assert all(np.isfinite(value).all() for value in values)
    np.testing.assert_allclose(np.linalg.norm(estimate.pose.rotation, axis=-1), 1, atol=1e-6)
    assert (estimate.pose.rotation[..., 0] >= 0).all() and (estimate.confidence >= 0).all()


def test_head_and_hands_are_the_three_point_body(adaptive: Adaptive, waving_clip: Clip) -> None:
    seen = observe(waving_clip.pose, waving_clip.time)
    told, estimate = profiles(adaptive, seen)
    assert set(told) == {"three-point"}
    alone, _ = adaptive.three_point.step(seen, adaptive.three_point.start())
    np.testing.assert_array_equal(estimate.position, alone.position)
    seen = without(seen, POINTS[1:], slice(30, None))
    told, estimate = profiles(adaptive, seen)
    assert told[:40] == ["three-point"] * 40 and told[-30:] == ["head"] * 30
    alone, _ = adaptive.three_point.step(seen, adaptive.three_point.start())
    np.testing.assert_array_equal(estimate.position, alone.position)


def test_measured_fingers_are_laid_along_their_bones(adaptive: Adaptive, waving_clip: Clip) -> None:
    """On the wearer's own bones they are where they are measured; on a larger hand only their directions count."""
    fingers = SKELETON.indices(FINGERS)
    wrist = SKELETON.wrist_of[fingers]
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])
    seen = signal(waving_clip, (*POINTS, *FINGERS))
    told, estimate = profiles(adaptive, seen)
    check_whole(estimate)
    assert set(told) == {"hands"}
    offset = estimate.position[:, fingers] - estimate.position[:, wrist]
    np.testing.assert_allclose(offset, truth[:, fingers] - truth[:, wrist], atol=1e-6)
    assert not estimate.occluded[:, fingers].any()
    larger = seen.position.copy()
    larger[:, 3:] = truth[:, wrist] + 1.2 * (truth[:, fingers] - truth[:, wrist])
    other, _ = adaptive.step(replace(seen, position=larger), adaptive.start())
    np.testing.assert_allclose(other.position[:, fingers], estimate.position[:, fingers], atol=1e-6)


def test_trackers_pull_the_body_nearer_to_the_truth(adaptive: Adaptive, waving_clip: Clip) -> None:
    """Hips and feet come to their trackers, head and hands stay; the rest is nearer than without."""
    truth = np.asarray(forward_kinematics(waving_clip.pose)[0])[:, JOINTS]
    told, estimate = profiles(adaptive, signal(waving_clip, (*POINTS, *TRACKED)))
    check_whole(estimate)
    assert set(told) == {"trackers"}
    worn = [BODY.index(name) for name in TRACKED]
    away = np.linalg.norm(estimate.position[:, JOINTS] - truth, axis=-1)
    assert away[:, worn].mean() < 0.02
    assert away[:, [BODY.index(name) for name in POINTS]].mean() < 0.02
    without_trackers, _ = adaptive.step(signal(waving_clip, POINTS), adaptive.start())
    assert away.mean() < 0.6 * np.linalg.norm(without_trackers.position[:, JOINTS] - truth, axis=-1).mean()


def test_a_tracker_that_cannot_be_worn_is_left_out(adaptive: Adaptive, waving_clip: Clip) -> None:
    seen = signal(waving_clip, (*POINTS, "pelvis"))[:20]
    alone, _ = adaptive.step(signal(waving_clip, POINTS)[:20], adaptive.start())
    for place in (10.0, np.nan, 1e30):
        position = seen.position.copy()
        position[:, 3] = place
        estimate, _ = adaptive.step(replace(seen, position=position), adaptive.start())
        np.testing.assert_array_equal(estimate.position, alone.position)


@pytest.mark.parametrize("rate", [30, 90])
def test_no_point_jumps_and_head_and_hands_stay(adaptive: Adaptive, waving_clip: Clip, rate: int) -> None:
    """Nobody moves, while trackers and fingers come, go one after the other, and all come back."""
    frames = 4 * rate
    seen = still(signal(waving_clip, (*POINTS, *FINGERS, *TRACKED)), frames, rate)
    seen = without(seen, (*FINGERS, *TRACKED), slice(0, rate))  # the network settles
    seen = without(seen, ("pelvis",), slice(2 * rate, frames))
    seen = without(seen, FINGERS, slice(round(2.5 * rate), 3 * rate))
    seen = without(seen, TRACKED, slice(round(2.5 * rate), 3 * rate))
    told, estimate = profiles(adaptive, seen)
    assert set(told) == {"three-point", "trackers"}
    check_whole(estimate)
    steps = np.diff(estimate.position, axis=0)
    speed = np.linalg.norm(steps, axis=-1)[rate - 1 :] * rate
    fastest = adaptive.settings.passage.fastest
    # It does move. A limb that is nearly straight may be some millimetres beside its place (`limbs.reach`).
    assert 0.3 < speed.max() < fastest + 0.004 * rate
    away = np.linalg.norm(estimate.position[rate:, WHERE] - seen.position[rate:, :3], axis=-1)
    assert away.max() < 0.02
    first = np.linalg.norm(steps[[k for k in range(1, frames - 1) if told[k + 1] != told[k]]], axis=-1)
    assert first.max() < fastest / rate + 0.004


def test_gloves_come_and_go(adaptive: Adaptive, waving_clip: Clip) -> None:
    """A glove beside a headset, then the headset's hands again."""
    hand = hand_skeleton(SKELETON, "left")
    position, rotation = (np.asarray(values) for values in forward_kinematics(waving_clip.pose))
    names = [name.removeprefix("left_") for name in SKELETON.joints if name.startswith("left_")]
    places = [SKELETON.index(f"left_{name}") for name in hand.joints]
    assert set(hand.joints) <= set(names)
    wrist = SKELETON.index("left_wrist")
    local = waving_clip.pose.rotation[:, places].copy()
    local[:, 0] = rotation[:, wrist]
    markers = np.asarray(marker_positions(default_glove(), Pose(hand, position[:, wrist], local)))
    seen = signal(waving_clip, POINTS)
    count, more = len(seen), markers.shape[1]
    both = Observation(
        (*POINTS, *glove_points("left")),
        np.concatenate([seen.position, markers], axis=1),
        np.concatenate([seen.rotation, np.full((count, more, 4), np.nan)], axis=1),
        np.concatenate([seen.has_position, np.ones((count, more), dtype=bool)], axis=1),
        np.concatenate([seen.has_rotation, np.zeros((count, more), dtype=bool)], axis=1),
        np.full((count, 3 + more), 0.001),
        seen.time,
    )
    told, estimate = profiles(adaptive, without(both, glove_points("left"), slice(45, None)))
    check_whole(estimate)
    assert told[:45] == ["gloves"] * 45 and told[-20:] == ["three-point"] * 20
    fingers = [SKELETON.index(f"left_{name}_tip") for name in ("index", "ring")]
    truth = position[:, fingers] - position[:, [wrist]]
    shown = estimate.position[:, fingers] - estimate.position[:, [wrist]]
    assert np.linalg.norm(shown - truth, axis=-1)[20:45].mean() < 0.02


def test_what_cameras_see_has_an_estimator_of_its_own(small_three_point: Path, waving_clip: Clip) -> None:
    model = load_three_point(small_three_point)
    seen = signal(waving_clip, SKELETON.points)[:20]
    with_one = Adaptive(SKELETON, IkTracked(IkTracker(Hold(SKELETON))), model)
    told, estimate = profiles(with_one, seen)
    assert set(told) == {"headset-camera"}
    check_whole(estimate)
    told, estimate = profiles(Adaptive(SKELETON, model=model), seen)
    assert set(told) == {"trackers"}  # without one every joint is taken for a tracker
    check_whole(estimate)


def test_many_are_what_each_is_alone(adaptive: Adaptive, small_three_point: Path, waving_clip: Clip) -> None:
    small = Adaptive(SKELETON.scaled(1.6), model=adaptive.model)
    signals = [signal(waving_clip, points) for points in (POINTS, ("head",), (*POINTS, *FINGERS), (*POINTS, *TRACKED))]
    those = [adaptive, small, adaptive, small]
    states = [one.start() for one in those]
    alone = [one.step(seen, one.start())[0] for one, seen in zip(those, signals, strict=True)]
    for t in range(12):
        jobs = [(one, seen[t : t + 1], state) for one, seen, state in zip(those, signals, states, strict=True)]
        answers = step_many(jobs)
        states = [state for _, state in answers]
        for (estimate, _), whole in zip(answers, alone, strict=True):
            np.testing.assert_allclose(estimate.position[0], whole.position[t], atol=1e-6)
    assert {state.profile for state in states} == {"three-point", "head", "hands", "trackers"} <= set(PROFILES)


def test_after_a_gap_it_begins_anew_and_time_goes_on(adaptive: Adaptive, waving_clip: Clip) -> None:
    seen = signal(resample(waving_clip, 30), (*POINTS, *TRACKED))
    _, state = adaptive.step(seen[:10], adaptive.start())
    late = replace(without(seen, TRACKED, slice(None)), time=seen.time + 5)[10:12]
    after, state = adaptive.step(late, state)
    np.testing.assert_array_equal(after.position, adaptive.step(late, adaptive.start())[0].position)
    assert state.profile == "three-point"
    with pytest.raises(BodysenseError, match=r"adaptive body: a frame at 0 s came after one at 5\.3\d* s; give frames"):
        adaptive.step(seen[:1], state)
    with pytest.raises(BodysenseError, match="adaptive body: a frame at nan s"):
        adaptive.step(replace(seen[:1], time=np.array([np.nan])), adaptive.start())
    with pytest.raises(BodysenseError, match="adaptive settings: longest_gap is 0; it must be positive"):
        AdaptiveSettings(longest_gap=0)
