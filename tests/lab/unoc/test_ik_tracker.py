"""The tracker: rigid bones, smoothing that knows the time, and the same whether frames come one by one or together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bodysense as bs
from bodysense.body.pose import Pose, forward_kinematics, rest_pose, standing_pose
from bodysense.body.retarget import transfer_motion
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp, quaternion_multiply
from bodysense.io.clip import Clip
from bodysense.observing.observation import Observation, accuracy_like
from bodysense.observing.points import observed_points
from bodysense_lab.papers.ik.ik import IkSettings
from bodysense_lab.papers.unoc.ik_tracker import IkTracker, IkTrackerSettings, IkTrackerState, limited, smooth
from bodysense_lab.papers.unoc.learned import Learned, load_model

SKELETON = default_skeleton()
HEAD = SKELETON.index("head")


@dataclass(frozen=True, eq=False)
class Constant:
    """An estimator that returns the observed positions, and constant predictions for the others."""

    position: np.ndarray = field(default_factory=lambda: np.full((len(SKELETON.points), 3), np.nan))  # m
    error: np.ndarray = field(default_factory=lambda: np.full(len(SKELETON.points), 0.001))  # m
    skeleton: Skeleton = SKELETON

    def start(self) -> None:
        return None

    def step(self, observation: Observation, state: None) -> tuple[PointEstimate, None]:
        position, _, seen, _ = observed_points(observation, self.skeleton)
        place = np.where(seen[..., None], position, self.position)
        return PointEstimate(self.skeleton, place, np.zeros(seen.shape), np.tile(self.error, (len(seen), 1))), None


def observed(pose: Pose, time: np.ndarray) -> Observation:
    """Every point of poses (T, …), and the head's orientation."""
    position, rotation = forward_kinematics(pose)
    turned = np.full((*position.shape[:-1], 4), np.nan)
    turned[:, HEAD] = rotation[:, HEAD]
    everything = np.ones(position.shape[:-1], dtype=bool)
    has_rotation = np.isfinite(turned[..., 0])
    return Observation(
        SKELETON.points, position, turned, everything, has_rotation, accuracy_like(everything, 0.001), time
    )


def still(pose: Pose, frames: int) -> Pose:
    return Pose(SKELETON, np.tile(pose.root_position, (frames, 1)), np.tile(pose.rotation, (frames, 1, 1)))


def bent(angle: float) -> Pose:
    """Standing a little aside, the left elbow bent."""
    pose = standing_pose(SKELETON)
    elbow = SKELETON.index("left_elbow")
    turn = quaternion_exp(np.array([0.0, -angle, 0.0]))
    pose.rotation[elbow] = quaternion_multiply(pose.rotation[elbow], turn)
    return replace(pose, root_position=pose.root_position + np.array([0.1 * angle, 0.0, 0.0]))


def resting(pose: Pose) -> IkTrackerState:
    """The state of a tracker whose body stands still."""
    return IkTrackerState(
        estimator=None,
        time=0.0,
        root_position=pose.root_position,
        rotation=pose.rotation,
        root_velocity=np.zeros(3),
        spin=np.zeros((len(SKELETON.joints), 3)),
    )


def smoothed(state: IkTrackerState, target: Pose, intervals: list[float], half_life: float) -> IkTrackerState:
    def one(before: IkTrackerState, interval: float) -> IkTrackerState:
        root, velocity, rotation, spin = smooth(target, before, interval, half_life)
        return replace(before, root_position=root, root_velocity=velocity, rotation=rotation, spin=spin)

    return reduce(one, intervals, state)


@pytest.mark.parametrize(("half_life", "rate"), [(0.02, 72), (0.1, None), (0.5, 30)])
def test_half_of_a_jump_is_closed_after_the_half_life(half_life: float, rate: int | None) -> None:
    """Whatever the frame rate: whole frames and the rest of the time, or irregular ones."""
    start, target = bent(0.0), bent(1.0)
    if rate is None:
        shares = np.random.default_rng(0).dirichlet(np.ones(7))
        intervals = (shares * half_life).tolist()
    else:
        frames = int(half_life * rate)
        intervals = [1 / rate] * frames + [half_life - frames / rate]
    after = smoothed(resting(start), target, intervals, half_life)
    assert after.root_position is not None and after.rotation is not None
    half = (start.root_position + target.root_position) / 2
    np.testing.assert_allclose(after.root_position, half, atol=1e-12)
    elbow = SKELETON.index("left_elbow")
    assert geodesic_angle(after.rotation, start.rotation)[elbow] == pytest.approx(0.5, abs=1e-9)
    assert geodesic_angle(after.rotation, target.rotation)[elbow] == pytest.approx(0.5, abs=1e-9)
    others = np.arange(len(SKELETON.joints)) != elbow
    np.testing.assert_allclose(after.rotation[others], target.rotation[others], atol=1e-12)


@settings(max_examples=30)
@given(
    st.lists(st.floats(1e-4, 0.2), min_size=1, max_size=8),
    st.floats(0.005, 0.5),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2)),
)
def test_the_same_time_gives_the_same_however_it_is_split(
    intervals: list[float], half_life: float, velocity: tuple[float, float, float]
) -> None:
    """Also where the body already moves."""
    start = replace(resting(bent(0.2)), root_velocity=np.array(velocity))
    many, one = (smoothed(start, bent(1.0), steps, half_life) for steps in (intervals, [sum(intervals)]))
    for name in ("root_position", "root_velocity", "rotation", "spin"):
        np.testing.assert_allclose(getattr(many, name), getattr(one, name), atol=1e-9)


def test_the_tracker_smooths_a_jump_by_its_half_life() -> None:
    """Frames at 100 Hz: two after a jump, with a half-life of 20 ms, half of it is left."""
    settings = IkTrackerSettings(half_life=0.02, ik=IkSettings(tolerance=1e-7))
    tracker = IkTracker(Constant(), settings)
    before, after = bent(0.0), bent(0.6)
    start, _, state = tracker.step(observed(still(before, 30), np.arange(30) / 100), tracker.start())
    poses, _, _ = tracker.step(observed(still(after, 60), 0.3 + np.arange(60) / 100), state)
    begin, middle, end = start.root_position[-1], poses.root_position[1], poses.root_position[-1]
    np.testing.assert_allclose(middle, (begin + end) / 2, atol=1e-4)
    np.testing.assert_allclose(end, after.root_position, atol=1e-3)


def test_whole_motion_comes_back_when_all_is_seen(waving_clip: Clip) -> None:
    observation = observed(waving_clip.pose, waving_clip.time)
    poses, _, _ = IkTracker(Constant(), IkTrackerSettings(half_life=0.0)).step(observation, IkTrackerState(None))
    error = np.linalg.norm(forward_kinematics(poses)[0] - observation.position, axis=-1)
    assert error.max() < 2e-3


@pytest.fixture(scope="module")
def tracker(small_network: Path) -> IkTracker:
    return IkTracker(Learned(load_model(small_network), SKELETON))


def test_frames_are_calls(tracker: IkTracker, waving_clip: Clip) -> None:
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)[:25]
    whole, estimate, _ = tracker.step(observation, tracker.start())
    state = tracker.start()
    for t in range(len(observation)):
        pose, one, state = tracker.step(observation[t : t + 1], state)
        np.testing.assert_array_equal(pose.rotation[0], whole.rotation[t])
        np.testing.assert_array_equal(pose.root_position[0], whole.root_position[t])
        np.testing.assert_array_equal(one.position[0], estimate.position[t])


def test_the_state_is_an_argument(tracker: IkTracker, waving_clip: Clip) -> None:
    """A state can be used twice: the step leaves no trace in it."""
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    _, _, state = tracker.step(observation[:5], tracker.start())
    first, _, _ = tracker.step(observation[5:10], state)
    tracker.step(observation[40:60], state)
    second, _, _ = tracker.step(observation[5:10], state)
    np.testing.assert_array_equal(first.rotation, second.rotation)


def test_the_head_is_turned_as_measured(tracker: IkTracker, waving_clip: Clip) -> None:
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    poses, _, _ = replace(tracker, settings=IkTrackerSettings(half_life=0.0)).step(observation, tracker.start())
    turned = forward_kinematics(poses)[1][:, HEAD]
    angle = np.degrees(geodesic_angle(turned, observation.rotation[:, HEAD]))
    assert angle.max() < 8, angle.max()  # the points of a network that was never trained pull elsewhere


@pytest.mark.parametrize(("first", "second"), [(1.0, 1.0), (1.0, 0.5), (1.0, np.nan)])
def test_time_that_does_not_increase_is_refused(first: float, second: float) -> None:
    tracker = IkTracker(Constant())
    pose = still(standing_pose(SKELETON), 1)
    _, _, state = tracker.step(observed(pose, np.array([first])), tracker.start())
    with pytest.raises(BodysenseError, match=rf"frame at {second:g} s came after one at {first:g} s; give frames in"):
        tracker.step(observed(pose, np.array([second])), state)
    with pytest.raises(BodysenseError, match="tracker: a frame at nan s; give frames in order of time, in seconds"):
        tracker.step(observed(pose, np.array([np.nan])), tracker.start())


def test_a_long_gap_resets_the_state() -> None:
    """After more than a second without frames nothing of the old motion is left; after less, it is."""
    tracker = IkTracker(Constant())
    before, after = still(bent(0.0), 2), still(bent(0.9), 1)
    _, _, state = tracker.step(observed(before, np.array([0.0, 0.03])), tracker.start())
    fresh, _, _ = tracker.step(observed(after, np.array([0.0])), tracker.start())
    late, _, afterwards = tracker.step(observed(after, np.array([2.0])), state)
    soon, _, _ = tracker.step(observed(after, np.array([0.06])), state)
    np.testing.assert_array_equal(late.rotation, fresh.rotation)
    np.testing.assert_array_equal(late.root_position, fresh.root_position)
    assert afterwards.root_velocity is not None and not afterwards.root_velocity.any()
    assert np.abs(soon.root_position - fresh.root_position).max() > 0.005


def test_impossible_settings_are_refused() -> None:
    with pytest.raises(BodysenseError, match=r"half_life is -0\.1; it must be 0 or more"):
        IkTrackerSettings(half_life=-0.1)


def test_more_certain_points_pull_more() -> None:
    """The elbow is predicted 10 cm beyond the arm's length. The points with the smaller expected error move less."""
    standing, _ = forward_kinematics(rest_pose(SKELETON))
    elbow = SKELETON.index("left_elbow")
    predicted = standing.copy()
    predicted[elbow] += [0.1, 0.0, 0.0]

    def reached(sure: Sequence[str], seen: Sequence[str] = ()) -> float:
        error = np.full(len(standing), 0.1)
        error[SKELETON.indices(sure)] = 0.001
        tracked = np.isin(SKELETON.points, seen)[None]
        position, rotation = np.where(tracked[..., None], predicted, np.nan), np.full((1, len(standing), 4), np.nan)
        accuracy = accuracy_like(tracked, 0.001)
        observation = Observation(
            SKELETON.points, position, rotation, tracked, np.zeros_like(tracked), accuracy, np.zeros(1)
        )
        poses, _, _ = IkTracker(Constant(predicted, error)).step(observation, IkTrackerState(None))
        return forward_kinematics(poses)[0][0, elbow, 0] - standing[elbow, 0]

    assert reached(["left_elbow"]) > 0.03
    assert reached(["left_shoulder", "left_wrist"]) < 0.01
    assert reached(SKELETON.points, seen=["left_elbow"]) > 2 * reached(SKELETON.points), "measured, it leads"


def test_a_body_turns_at_a_bounded_speed_with_one_share() -> None:
    """A flipped pelvis drags no limb: every joint and the root do the same share of their change."""
    start, flipped = standing_pose(SKELETON), bent(0.5)
    flipped.rotation[0] = quaternion_multiply(quaternion_exp(np.array([0.0, 3.0, 0.0])), flipped.rotation[0])
    root, rotation, share = limited(resting(start), flipped.root_position, flipped.rotation, 1 / 30)
    whole, turned = (geodesic_angle(one, start.rotation) for one in (flipped.rotation, rotation))
    assert share == pytest.approx(20 / 30 / 3.0, rel=1e-6)
    np.testing.assert_allclose(turned, share * whole, atol=1e-6)
    np.testing.assert_allclose(root - start.root_position, share * (flipped.root_position - start.root_position))
    _, slow, whole_share = limited(resting(start), flipped.root_position, flipped.rotation, 0.2)
    assert whole_share == 1 and slow is flipped.rotation


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_a_body_that_sits_down_never_folds_over(seed: int) -> None:
    """No joint turns round when the legs of an unseen body come into view while it sits down."""
    performance = bs.demo.packaged_performance()
    skeleton = replace(performance.pose.skeleton, rest_offset=sample_bodies("test", 3, seed=5)[seed])
    clip = replace(performance, pose=transfer_motion(performance.pose, skeleton)[230:300])
    tracker, seen = IkTracker(Learned(load_model(), skeleton)), bs.simulate(clip, "headset_camera", noise=seed)
    rotation = np.asarray(tracker.step(seen, tracker.start())[0].rotation)
    turn, interval = geodesic_angle(rotation[1:], rotation[:-1]), np.diff(seen.time)[:, None]
    assert (turn <= 20 * interval + 1e-6).all()
    assert np.degrees(geodesic_angle(rotation[:, 0], np.asarray(clip.pose.rotation)[:, 0])).max() < 90
