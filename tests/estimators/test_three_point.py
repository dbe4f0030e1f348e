"""The three-point estimator: whole at every frame, hands and head where measured, feet that stand, any input."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from bodysense.body.pose import forward_kinematics
from bodysense.body.rotation import geodesic_angle, quaternion_exp
from bodysense.body.skeleton import BODY, Skeleton, default_skeleton
from bodysense.data.augment import at_height
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.errors import BodysenseError
from bodysense.estimators.estimate import PointEstimate
from bodysense.estimators.foot_lock import FootLockSettings
from bodysense.estimators.ik_tracker import IkTracker
from bodysense.estimators.three_point import ThreePoint, packaged_three_point
from bodysense.estimators.three_point_answers import PACKAGED, Answer, Memory, load_three_point, steadied
from bodysense.estimators.three_point_state import ThreePointSettings
from bodysense.estimators.whole_body import WholeBody
from bodysense.evaluation.metrics import jitter
from bodysense.observation import Observation
from bodysense.occlusion.dropout import hide
from bodysense.occlusion.three_point import HEAD_ONLY, POINTS, observe

SKELETON = default_skeleton()
WHERE = SKELETON.indices(POINTS)


@pytest.fixture(scope="module")
def estimator(small_three_point: Path) -> ThreePoint:
    return ThreePoint(SKELETON, load_three_point(small_three_point))


@pytest.fixture
def seen(waving_clip: Clip) -> Observation:
    return observe(waving_clip.pose, waving_clip.time)


def complete(estimator: ThreePoint, observation: Observation) -> PointEstimate:
    return estimator.step(observation, estimator.start())[0]


def lost(observation: Observation, points: tuple[int, ...], frames: slice) -> Observation:
    hidden = np.zeros(observation.has_position.shape, dtype=bool)
    hidden[frames, list(points)] = True
    return hide(observation, hidden)


def at_rate(observation: Observation, rate: float) -> Observation:
    """The same frames, as if they had been taken faster or slower."""
    return replace(observation, time=np.arange(len(observation)) / rate)


def check_whole(estimate: PointEstimate) -> None:
    """Nothing is missing, bones are rigid, rotations are unit and make the positions."""
    pose = estimate.pose
    assert pose is not None
    values = (estimate.position, estimate.confidence, estimate.occluded, pose.root_position, pose.rotation)
    assert all(np.isfinite(value).all() for value in values)
    np.testing.assert_allclose(np.linalg.norm(pose.rotation, axis=-1), 1, atol=1e-6)
    assert (pose.rotation[..., 0] >= 0).all()
    position, _ = forward_kinematics(pose)
    scale = 1 + np.abs(estimate.position).max()
    hand = (SKELETON.wrist_of >= 0) | np.isin(np.arange(len(SKELETON.points)), WHERE[1:])
    np.testing.assert_allclose(position[:, ~hand], estimate.position[:, ~hand], atol=1e-5 * scale)
    assert (estimate.confidence > 0).all() and np.isin(estimate.occluded, [0, 1]).all()


def test_frame_by_frame_is_the_whole(estimator: ThreePoint, seen: Observation) -> None:
    seen = lost(seen, (1,), slice(20, 50))
    whole, state = complete(estimator, seen), estimator.start()
    check_whole(whole)
    for t in range(len(seen)):
        one, state = estimator.step(seen[t : t + 1], state)
        np.testing.assert_array_equal(one.position[0], whole.position[t])


def test_head_and_hands_are_where_they_are_measured(estimator: ThreePoint, seen: Observation) -> None:
    """Hands also in rotations, as far as the arm reaches."""
    estimate = complete(estimator, seen)
    assert estimate.pose is not None
    position, rotation = forward_kinematics(estimate.pose)
    assert geodesic_angle(rotation[:, WHERE], seen.rotation).max() < 1e-5
    np.testing.assert_allclose(estimate.position[:, WHERE], seen.position, atol=1e-5)
    away = np.linalg.norm(position[:, WHERE] - seen.position, axis=-1)
    assert away[:, 0].max() < 1e-5
    for side, column in (("left", 1), ("right", 2)):
        shoulder, elbow, wrist = SKELETON.indices([f"{side}_{part}" for part in ("shoulder", "elbow", "wrist")])
        arm = SKELETON.bone_length[[elbow, wrist]].sum()
        reached = np.linalg.norm(seen.position[:, column] - estimate.position[:, shoulder], axis=-1) < 0.999 * arm
        assert reached.any()
        assert away[reached, column].max() < 1e-5
    assert not estimate.occluded[:, WHERE].any()
    assert estimate.occluded.sum() == estimate.occluded.size - 3 * len(seen)


@pytest.mark.parametrize("rate", [24, 72, 90, 120, 144, 240])
def test_any_rate_is_answered_at_every_frame(estimator: ThreePoint, seen: Observation, rate: int) -> None:
    """The head is where it is at every frame; the network goes on from a frame that is long enough ago, no longer."""
    seen = at_rate(seen, rate)
    shortest = 0.9 / float(estimator.model.card["fastest_rate"])
    state = estimator.start()
    for t in range(len(seen)):
        estimate, state = estimator.step(seen[t : t + 1], state)
        np.testing.assert_allclose(estimate.position[0, WHERE[0]], seen.position[t, 0], atol=1e-5)
        assert len(state.memories) <= int(np.ceil(shortest * rate)) + 1
        later = seen.time[t] + 1 / rate - np.array([memory.time for memory in state.memories])
        assert (later[1:] < shortest + 1 / rate).all()


def test_answers_in_between_are_averaged(estimator: ThreePoint) -> None:
    """Half of the way between two turns, whatever the sign of their quaternions; the head stays where it is."""
    body, head = WholeBody(SKELETON), np.array([[0.3, 1.6, -0.2]])
    turns = [np.tile(quaternion_exp(np.array([0.0, angle, 0.1])), (1, len(BODY), 1)) for angle in (0.2, 0.6)]
    answers = [
        Answer(turn, np.zeros((1, 22, 3)), np.ones((1, 22)), np.full((1, 2, 2), c))
        for turn, c in zip(turns, (0.0, 1.0), strict=True)
    ]
    for sign in (1, -1):
        before = Memory(0.0, {}, replace(answers[0], rotation=sign * turns[0])[0])
        mean = steadied(answers[1], [(before,)], head, body)
        assert geodesic_angle(mean.rotation, turns[0]) == pytest.approx(geodesic_angle(*turns) / 2, abs=1e-9)
        np.testing.assert_allclose(mean.position[:, BODY.index("head")], head, atol=1e-12)
        bone = np.linalg.norm(mean.position[0, 4] - mean.position[0, 1])
        np.testing.assert_allclose(bone, SKELETON.bone_length[4])
        assert (mean.contact == 0.5).all()
    assert steadied(answers[1], [()], head, body) is answers[1]


def test_sequences_that_take_turns_do_not_tremble(waving_clip: Clip, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the packaged network at 90 Hz: averaged answers are much smoother than each frame's own."""
    clip = resample(waving_clip, 90)
    legs = SKELETON.indices(["left_knee", "right_knee", "spine1"])

    def trembling() -> float:
        return jitter(complete(packaged_three_point(SKELETON), observe(clip.pose, clip.time)).position[:, legs], 90)

    averaged = trembling()
    monkeypatch.setattr("bodysense.estimators.three_point_many.steadied", lambda answer, *others: answer)
    assert averaged < 0.7 * trembling()


@pytest.mark.parametrize("height", [1.45, 2.05])
def test_a_larger_body_is_the_same_larger(small_three_point: Path, waving_clip: Clip, height: float) -> None:
    estimates = []
    for clip in (waving_clip, at_height(waving_clip, height)):
        method = ThreePoint(clip.pose.skeleton, load_three_point(small_three_point), ThreePointSettings(feet=None))
        estimates.append(complete(method, observe(clip.pose, clip.time)).position / clip.pose.skeleton.height)
    np.testing.assert_allclose(estimates[0], estimates[1], atol=1e-4)


@pytest.mark.parametrize("hand", [1, 2])
def test_a_hand_goes_and_comes_without_a_jump(estimator: ThreePoint, seen: Observation, hand: int) -> None:
    """The observation stands still, so that all that moves is the change from measured to guessed and back."""
    still = replace(
        seen, position=np.tile(seen.position[:1], (90, 1, 1)), rotation=np.tile(seen.rotation[:1], (90, 1, 1))
    )
    for rate in (30, 90):
        steps = np.diff(complete(estimator, lost(at_rate(still, rate), (hand,), slice(30, 60))).position, axis=0)
        place = WHERE[hand]
        change = np.linalg.norm(steps[:, place], axis=-1)
        # Critically damped with a half-life of 0.06 s: it starts from rest and is fastest a little later.
        away = np.linalg.norm(steps[29:59, place].sum(axis=0))
        assert away > 0.02
        y = 1.678347 / 0.06
        first, fastest = 1 - (1 + y / rate) * np.exp(-y / rate), y * np.exp(-1) / rate
        assert change[28:60].max() < fastest * away + 0.01
        assert change[29] < first * away + 0.01


def test_a_lost_hand_keeps_its_distance_to_a_head_that_moves_on(estimator: ThreePoint, seen: Observation) -> None:
    """Lost for two seconds while the head goes one metre: the hand goes with it."""
    shift = np.linspace(0, 1, 90)[:, None, None] * np.array([0.0, 0, 1.0])
    estimate = complete(estimator, lost(replace(seen, position=seen.position + shift), (1, 2), slice(10, 90)))
    away = np.linalg.norm(estimate.position[:, WHERE[1:]] - estimate.position[:, WHERE[:1]], axis=-1)
    assert away.max() < SKELETON.height


def test_without_hands_and_before_the_head(estimator: ThreePoint, waving_clip: Clip, seen: Observation) -> None:
    """The head alone makes a whole body; one that is missing keeps its last pose, at first that of a standing body."""
    check_whole(complete(estimator, observe(waving_clip.pose, waving_clip.time, HEAD_ONLY)))
    alone = complete(estimator, replace(seen, points=("head", "chest marker", "marker")))
    check_whole(alone)
    estimate = complete(estimator, lost(seen, (0,), slice(40, 90)))
    np.testing.assert_allclose(estimate.position[40:, WHERE[0]], np.tile(seen.position[39, 0], (50, 1)), atol=1e-5)
    never = complete(estimator, lost(seen, (0, 1, 2), slice(None)))
    check_whole(never)
    standing = SKELETON.path @ SKELETON.rest_offset + SKELETON.rest_offset[0]
    np.testing.assert_allclose(never.position[:, WHERE[0], [0, 2]], 0, atol=0.1)
    assert never.position[0, WHERE[0], 1] == pytest.approx(standing[WHERE[0], 1], abs=0.2)


def test_hands_that_cannot_be_are_none(estimator: ThreePoint, seen: Observation) -> None:
    """Ten metres off, of no length, not finite: as if it had not been tracked."""
    wanted = complete(estimator, lost(seen, (1,), slice(None)))
    position, rotation = seen.position.copy(), seen.rotation.copy()
    position[::3, 1], position[1::3, 1], position[2::3, 1] = 10.0, np.nan, 1e30
    rotation[::2, 1], rotation[1::2, 1] = 0.0, np.inf
    estimate = complete(estimator, replace(seen, position=position, rotation=rotation))
    np.testing.assert_array_equal(estimate.position, wanted.position)


def test_two_headsets_and_time_that_runs_back_are_refused(estimator: ThreePoint, seen: Observation) -> None:
    with pytest.raises(BodysenseError, match="'head' is named twice; give one device for each"):
        complete(estimator, replace(seen, points=("head", "left_wrist", "head")))
    _, state = estimator.step(seen[:2], estimator.start())
    with pytest.raises(BodysenseError, match=r"a frame at 0 s came after one at 0\.033\d* s; give frames in order"):
        estimator.step(seen[:1], state)
    with pytest.raises(BodysenseError, match="a frame at nan s"):
        complete(estimator, replace(seen, time=seen.time * np.nan))


def test_after_a_gap_it_begins_anew(estimator: ThreePoint, seen: Observation) -> None:
    """Three seconds without a frame; a short gap does not."""
    _, state = estimator.step(seen[:30], estimator.start())
    late = replace(seen, time=seen.time + 3.0)[30:60]
    after, _ = estimator.step(late, state)
    np.testing.assert_array_equal(after.position, complete(estimator, late).position)
    soon = replace(seen, time=seen.time + 0.5)[30:60]
    assert np.abs(estimator.step(soon, state)[0].position - after.position).max() > 1e-4


@settings(max_examples=60, deadline=None)
@given(
    position=npst.arrays(float, (6, 3, 3), elements=st.floats(allow_nan=True, allow_infinity=True)),
    rotation=npst.arrays(float, (6, 3, 4), elements=st.floats(-2, 2) | st.just(np.nan)),
    known=npst.arrays(bool, (6, 3, 2)),
    garbage=npst.arrays(bool, (6, 3)),
    intervals=st.lists(st.floats(1e-4, 4.0), min_size=6, max_size=6),
)
def test_whatever_comes_the_body_is_whole(
    estimator: ThreePoint,
    waving_clip: Clip,
    position: np.ndarray,
    rotation: np.ndarray,
    known: np.ndarray,
    garbage: np.ndarray,
    intervals: list[float],
) -> None:
    """Random masks, random garbage among good frames, any time step: never what is no number."""
    good = observe(waving_clip.pose[:6], waving_clip.time[:6])
    observation = Observation(
        POINTS,
        np.where(garbage[..., None], position, good.position),
        np.where(garbage[..., None], rotation, good.rotation),
        known[..., 0],
        known[..., 1],
        good.accuracy,
        np.cumsum(intervals),
    )
    check_whole(complete(estimator, observation))
    tracker = IkTracker(estimator)
    pose, _, _ = tracker.step(observation, tracker.start())
    assert np.isfinite(pose.root_position).all() and np.isfinite(pose.rotation).all()


def test_a_headset_that_is_found_late_begins_anew(estimator: ThreePoint, seen: Observation) -> None:
    """Nothing of the time before its first frame, or of a long loss, is left."""
    for hidden in (slice(0, 20), slice(10, 50)):
        state = estimator.start()
        late = lost(seen, (0,), hidden)
        for k in range(hidden.stop):
            _, state = estimator.step(late[k : k + 1], state)
        after = late[hidden.stop : hidden.stop + 5]
        found, _ = estimator.step(after, state)
        np.testing.assert_allclose(found.position, complete(estimator, after).position, atol=1e-6)


def test_a_headset_that_is_found_soon_has_not_leapt(estimator: ThreePoint, seen: Observation) -> None:
    """Where the wearer went meanwhile is no velocity, and no foot stays behind: the body is the same elsewhere."""
    went = np.where(np.arange(len(seen)) < 15, 0, 0.8)[:, None, None] * np.array([1.0, 0.0, 0.0])
    stayed, moved = (
        complete(estimator, lost(replace(seen, position=seen.position + by), (0, 1, 2), slice(10, 15))).position
        for by in (0.0, went)
    )
    np.testing.assert_allclose(moved - went, stayed, atol=1e-5)


def test_a_hand_that_is_refused_is_hidden_to_the_tracker(estimator: ThreePoint, seen: Observation) -> None:
    far = seen.position.copy()
    far[:, 1] += [0.0, 0.0, 10.0]
    estimate = complete(estimator, replace(seen, position=far))
    assert (estimate.occluded[:, WHERE] == [0, 1, 0]).all()
    tracker, poses = IkTracker(estimator), []
    for observation in (replace(seen, position=far), lost(seen, (1,), slice(None))):
        pose, _, _ = tracker.step(observation, tracker.start())
        poses.append(forward_kinematics(pose)[0][:, WHERE[1]])
    assert np.linalg.norm(poses[0] - poses[1], axis=-1).max() < 0.3


def test_time_without_end_is_refused(estimator: ThreePoint, seen: Observation) -> None:
    _, state = estimator.step(seen[:2], estimator.start())
    with pytest.raises(BodysenseError, match="a frame at inf s"):
        estimator.step(replace(seen[2:3], time=np.array([np.inf])), state)


def test_the_tracker_keeps_the_pose_and_meets_what_is_measured(estimator: ThreePoint, seen: Observation) -> None:
    """Head within 1 cm and 3°, hands within 2 cm; twist and spine are the estimator's."""
    tracker = IkTracker(estimator)
    pose, estimate, _ = tracker.step(seen, tracker.start())
    position, rotation = forward_kinematics(pose)
    away = np.linalg.norm(position[:, WHERE] - seen.position, axis=-1)
    turned = np.degrees(geodesic_angle(rotation[:, WHERE], seen.rotation))
    assert away[:, 0].max() < 0.01 and turned[:, 0].max() < 3
    assert away[:, 1:].max() < 0.02 and turned[:, 1:].max() < 3
    assert estimate.pose is not None
    reached = np.abs(forward_kinematics(estimate.pose)[0] - estimate.position).max(axis=(1, 2)) < 1e-3
    assert reached.any()
    body = SKELETON.indices(BODY)
    kept = np.degrees(geodesic_angle(pose.rotation[:, body], estimate.pose.rotation[:, body]))[reached]
    assert kept.max() < 1


def test_feet_are_held_and_none_is_under_the_floor(small_three_point: Path, waving_clip: Clip) -> None:
    """The same answers with feet left alone, and held from the first: contact is likelier than a hundredth."""
    model = load_three_point(small_three_point)
    root = waving_clip.pose.root_position - [0, 0.1, 0]
    seen = observe(replace(waving_clip.pose, root_position=root), waving_clip.time)
    feet = SKELETON.indices([f"{side}_{part}" for side in ("left", "right") for part in ("ankle", "foot", "toe")])
    always = FootLockSettings(hold=0.01, release=0.005, longest=1.0)
    free, held = (
        complete(ThreePoint(SKELETON, model, ThreePointSettings(feet=lock)), seen).position[:, feet]
        for lock in (None, always)
    )
    assert free[..., 1].min() < -0.01
    assert held[..., 1].min() > -0.005
    # A foot is held by its ankle or by its ball, and turns about it.
    slid = [np.linalg.norm(np.diff(one[..., [0, 2]], axis=0), axis=-1).sum(axis=0) for one in (free, held)]
    slid = [np.minimum(way[[0, 3]], way[[1, 4]]).sum() for way in slid]
    assert slid[1] < 0.2 * slid[0]


def test_a_skeleton_without_the_joints_is_refused(small_three_point: Path) -> None:
    joints = SKELETON.joints[:12]
    short = Skeleton(joints, (), SKELETON.parents[:12], SKELETON.rest_offset[:12])
    with pytest.raises(BodysenseError, match="the skeleton given has no neck"):
        ThreePoint(short, load_three_point(small_three_point))


def test_another_network_is_refused(small_network: Path) -> None:
    with pytest.raises(BodysenseError, match=r"not a bodysense three-point network .*`bodysense train three-point`"):
        load_three_point(small_network)


def test_the_packaged_network_is_loaded_by_name(waving_clip: Clip) -> None:
    from importlib.resources import files

    if not files("bodysense.weights").joinpath(PACKAGED).is_file():
        pytest.skip(f"{PACKAGED} is not packaged yet")
    check_whole(complete(packaged_three_point(SKELETON), observe(waving_clip.pose, waving_clip.time)))
