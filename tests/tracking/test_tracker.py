"""The tracker: whole recordings, streams and batches agree, measured points stay, and nothing jumps."""

import pickle
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
from worn_trackers import strapped

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.retarget import retarget
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import default_skeleton
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply, quaternion_rotate
from bodysense.observing.observation import Observation
from bodysense.observing.observation import observe as make_frame
from bodysense.tracking.tracker import Tracker, TrackerSettings, step_together

SETS = ("head", "three_point", "three_point_imu_feet", "four_point", "six_point", "ten_point", "headset_camera")
FRAMES = 45
UP, AWAY = np.array([0.0, 2.0, 0.0]), np.array([3.0, 0.0, -7.0])  # m


def performance(body: int | None = None, frames: int = FRAMES):
    """The packaged performance, on its own body or on an unseen one."""
    clip = packaged_performance()
    clip = replace(clip, pose=clip.pose[:frames])
    if body is None:
        return clip
    skeleton = default_skeleton().with_offsets(sample_bodies("test", body + 1)[body])
    return replace(clip, pose=retarget(clip.pose, skeleton))


def seen(clip, name: str) -> Observation:
    return observe(clip.pose, clip.time, SENSOR_SETS[name])


def person_of(clip, known: str) -> Person:
    skeleton = clip.pose.skeleton
    if known == "height":
        return Person(height=float(stature(skeleton.rest_offset)))
    return Person(skeleton) if known == "all" else Person()


@pytest.mark.parametrize(
    ("name", "known"),
    [("three_point", "nothing"), ("three_point_imu_feet", "all"), ("ten_point", "nothing"), ("headset_camera", "all")],
)
def test_whole_equals_stream(name: str, known: str) -> None:
    clip = performance(1)
    observation, tracker = seen(clip, name), Tracker(person_of(clip, known))
    whole, _ = tracker.step(observation, tracker.start())
    state, points, rotations = tracker.start(), [], []
    for t in range(len(observation)):
        estimate, state = tracker.step(observation[t : t + 1], state)
        points.append(estimate.points)
        rotations.append(estimate.pose.rotation)
    assert np.abs(np.concatenate(points) - whole.points).max() < 1e-6
    assert np.abs(np.concatenate(rotations) - whole.pose.rotation).max() < 1e-6


def test_many_people_equal_each_alone() -> None:
    clips = [performance(k) for k in range(3)]
    people = [person_of(clip, known) for clip, known in zip(clips, ("all", "height", "nothing"), strict=True)]
    parts = [seen(clip, "three_point") for clip in clips]
    arrays = ("position", "rotation", "has_position", "has_rotation", "accuracy")
    together = replace(parts[0], **{name: np.stack([getattr(part, name) for part in parts]) for name in arrays})
    many = Tracker(people)
    batch, _ = many.step(together, many.start())
    trackers = [Tracker(person) for person in people]
    states = [tracker.start() for tracker in trackers]
    for t in range(FRAMES):
        jobs = [(tracker, part[t : t + 1], state) for tracker, part, state in zip(trackers, parts, states, strict=True)]
        stepped = step_together(jobs)
        states = [state for _, state in stepped]
        for k, (estimate, _) in enumerate(stepped):
            assert np.abs(estimate.points[0] - batch.points[k, t]).max() < 1e-5
    for k, (tracker, part) in enumerate(zip(trackers, parts, strict=True)):
        alone, _ = tracker.step(part, tracker.start())
        assert np.abs(alone.points - batch.of(k).points).max() < 1e-5
        assert np.allclose(batch.of(k).pose.skeleton.rest_offset, alone.pose.skeleton.rest_offset)


@pytest.mark.parametrize("name", SETS)
def test_head_hands_and_ankles_are_at_their_measured_positions(name: str) -> None:
    clip = performance(2)
    observation = seen(clip, name)
    tracker = Tracker(Person(clip.pose.skeleton), settings=TrackerSettings(ease=0.0))
    estimate, _ = tracker.step(observation, tracker.start())
    truth = forward_kinematics(clip.pose)[0]
    skeleton = clip.pose.skeleton
    for joint, near in (("head", 1e-3), ("left_wrist", 8e-3), ("right_ankle", 8e-3)):
        if joint in observation.points:
            known = observation.has_position[:, observation.points.index(joint)]
            place = skeleton.index(joint)
            apart = np.linalg.norm(estimate.points[:, place] - truth[:, place], axis=-1)[known]
            assert apart.max(initial=0.0) < near


@pytest.mark.parametrize("name", ["head", "ten_point", "headset_camera"])
def test_the_pose_gives_the_points_and_bones_stay_rigid(name: str) -> None:
    clip = performance(3)
    tracker = Tracker(Person(clip.pose.skeleton))
    estimate, _ = tracker.step(seen(clip, name), tracker.start())
    assert np.abs(forward_kinematics(estimate.pose)[0] - estimate.points).max() < 2e-4
    parents = list(clip.pose.skeleton.parents[1:])
    length = np.linalg.norm(estimate.points[:, 1:] - estimate.points[:, parents], axis=-1)
    assert np.abs(length - clip.pose.skeleton.bone_length[1:]).max() < 2e-4


def test_no_foot_is_under_a_floor_of_any_height() -> None:
    clip = performance(4)
    observation = seen(clip, "three_point")
    raised = replace(observation, position=observation.position + UP)
    level, high = (
        tracker.step(part, tracker.start())[0]
        for part, tracker in (
            (observation, Tracker(Person(clip.pose.skeleton))),
            (raised, Tracker(Person(clip.pose.skeleton), settings=TrackerSettings(floor=2.0))),
        )
    )
    feet = clip.pose.skeleton.indices(["left_ankle", "left_foot", "left_toe", "right_ankle", "right_foot", "right_toe"])
    assert level.points[:, feet, 1].min() > -1e-3
    assert np.abs(high.points - level.points - UP).max() < 1e-3


def test_the_body_follows_its_signal() -> None:
    clip = performance(5)
    observation, turn = seen(clip, "six_point"), quaternion_exp(np.array([0.0, 2.0, 0.0]))
    moved = replace(
        observation,
        position=quaternion_rotate(turn, observation.position) + AWAY,
        rotation=quaternion_multiply(np.broadcast_to(turn, observation.rotation.shape), observation.rotation),
        time=observation.time + 1.7e9,  # a Unix time is a time like any other
    )
    tracker = Tracker(Person(clip.pose.skeleton))
    here, there = (tracker.step(part, tracker.start())[0] for part in (observation, moved))
    assert np.abs(quaternion_rotate(turn, here.points) + AWAY - there.points).max() < 2e-3


def test_sensors_may_change_at_every_frame() -> None:
    clip = performance(6)
    rng = np.random.default_rng(3)
    whole = seen(clip, "ten_point")
    keep = rng.uniform(size=whole.has_position.shape) < 0.7
    keep[:, whole.points.index("head")] = True
    flickering = replace(whole, has_position=whole.has_position & keep, has_rotation=whole.has_rotation & keep)
    tracker = Tracker(Person(clip.pose.skeleton))
    estimate, _ = tracker.step(flickering, tracker.start())
    assert np.isfinite(estimate.points).all()
    assert (estimate.confidence > 0).all()


def test_a_tracker_with_a_mount_gives_its_joint() -> None:
    clip = performance(7)
    observation = seen(clip, "four_point")
    mount = RigidTransform(np.array([0.0, 0.05, -0.12]), quaternion_exp(np.array([0.3, 2.0, -0.5])))
    strapped_on = strapped(observation, {"pelvis": mount})
    plain_person, mounted_person = Person(clip.pose.skeleton), Person(clip.pose.skeleton, mounts={"pelvis": mount})
    plain, mounted = (
        tracker.step(part, tracker.start())[0]
        for tracker, part in ((Tracker(plain_person), observation), (Tracker(mounted_person), strapped_on))
    )
    # States of the network are bytes: a difference in the last bit of an input may round one to the next byte.
    assert np.abs(plain.points - mounted.points).max() < 2e-4


def test_mounts_are_refined_alike_whole_streamed_and_in_batches() -> None:
    clip = performance(7)
    clips = [replace(clip, pose=clip.pose[10:]), performance(8)]
    clips = [replace(one, pose=one.pose[:30]) for one in clips]
    rng = np.random.default_rng(0)
    joints = ("pelvis", "left_ankle", "right_ankle", "spine3", "left_knee", "right_elbow")
    mounts = [{name: RigidTransform(0.05 * rng.standard_normal(3)) for name in joints} for _ in clips]
    wrong = [
        {name: RigidTransform(mount.translation + 0.03) for name, mount in by_joint.items()} for by_joint in mounts
    ]
    people = [Person(height=1.7, mounts=wrong[0]), Person(mounts=wrong[1])]
    parts = [strapped(seen(one, "ten_point"), by_joint) for one, by_joint in zip(clips, mounts, strict=True)]
    trackers = [Tracker(person) for person in people]
    states = [tracker.start() for tracker in trackers]
    streamed = []
    for t in range(30):
        jobs = [(tracker, part[t : t + 1], state) for tracker, part, state in zip(trackers, parts, states, strict=True)]
        stepped = step_together(jobs)
        states = [state for _, state in stepped]
        streamed.append([estimate.points[0] for estimate, _ in stepped])
    for k, (tracker, part) in enumerate(zip(trackers, parts, strict=True)):
        whole, state = tracker.step(part, tracker.start())
        assert np.abs(whole.points - np.array(streamed)[:, k]).max() < 1e-5
        assert (state.memory[0] == states[k].memory[0]).all()
        for joint in ("pelvis", "left_ankle", "left_knee"):
            learned = state.person().mounts[joint].translation
            assert 1e-4 < np.abs(learned - tracker.people[0].mounts[joint].translation).max() < 0.05


def test_a_long_gap_resets_motion_and_keeps_the_person() -> None:
    clip = performance(8)
    observation, tracker = seen(clip, "three_point"), Tracker()
    before, state = tracker.step(observation, tracker.start())
    for gap, anew in ((5.0, True), (0.5, False)):
        later = replace(observation, time=observation.time + observation.time[-1] + gap)
        again, after = tracker.step(later[:1], state)
        assert np.abs(again.rest_offset[0] - before.rest_offset[-1]).max() < 1e-3
        person = Person(again.pose.skeleton, bone_deviation=after.person().bone_deviation)
        fresh, _ = (known := Tracker(person, settings=TrackerSettings(infer=False))).step(later[:1], known.start())
        apart = np.abs(fresh.pose.rotation[0] - again.pose.rotation[0]).max()
        assert (apart < 1e-4) == anew


def test_memory_of_a_step_is_reused() -> None:
    """The result is bit-identical in reused memory, and a state that is not given as `out` is unchanged."""
    clip = packaged_performance()
    seen = observe(clip.pose, clip.time, SENSOR_SETS["three_point"])[:30]
    tracker = Tracker(Person(height=1.7))
    start = tracker.start()
    kept, _ = tracker.step(seen[:1], start)
    wanted = state = tracker.start()
    last, points = None, kept.points
    for k in range(len(seen)):
        fresh, wanted = tracker.step(seen[k : k + 1], wanted)
        estimate, state = last = tracker.step(seen[k : k + 1], state, out=last)
        for name in ("points", "confidence", "bound", "contact", "rest_offset", "measured"):
            np.testing.assert_array_equal(getattr(estimate, name), getattr(fresh, name))
        np.testing.assert_array_equal(estimate["left_elbow"].rotation, fresh["left_elbow"].rotation)
        assert state.to_bytes() == wanted.to_bytes()
        if k:
            assert estimate.points is not fresh.points and np.shares_memory(estimate.points, points)
        points = estimate.points
    assert start.to_bytes() == tracker.start().to_bytes() and kept.points is not points
    with pytest.raises(
        BodysenseError, match="out has memory of other frames or people than the observation's 2 frames"
    ):
        tracker.step(seen[:2], start, out=last)


@pytest.mark.parametrize("as_arrays", [False, True])
def test_frames_of_observe_equal_frames_of_arrays(as_arrays: bool) -> None:
    """The one block of a frame, its copies and separate arrays are the same numbers, also if they are changed."""
    clip, rng = packaged_performance(), np.random.default_rng(3)
    seen = observe(clip.pose, clip.time, SENSOR_SETS["three_point"])[:20]
    tracker = Tracker(Person(height=1.7))
    states = [tracker.start()] * 4
    for t in range(len(seen)):
        poses = {}
        for k, name in enumerate(seen.points):
            pair = (seen.position[t, k], seen.rotation[t, k])
            pair = pair if as_arrays else tuple(values.tolist() for values in pair)
            poses[name] = tuple(None if rng.random() < 0.2 else values for values in pair)
        frame = make_frame(float(seen.time[t]), poses)
        assert frame.block is not None
        copies = [frame, pickle.loads(pickle.dumps(frame)), deepcopy(frame)]
        for copy in copies:
            copy.position[..., 1] += 0.01
        copies.append(replace(frame))
        assert all(copy.block is None for copy in copies[1:])
        steps = [tracker.step(copy, state) for copy, state in zip(copies[1:], states[1:], strict=True)]
        steps = [tracker.step(frame, states[0]), *steps]
        states = [state for _, state in steps]
        for estimate, state in steps[1:]:
            np.testing.assert_array_equal(estimate.points, steps[0][0].points)
            assert state.to_bytes() == states[0].to_bytes()


def test_the_rotation_of_a_point_is_that_of_the_whole_pose() -> None:
    clip = packaged_performance()
    seen = observe(clip.pose, clip.time, SENSOR_SETS["three_point"])[:10]
    tracker = Tracker()
    estimate, _ = tracker.step(seen, tracker.start())
    skeleton, world = estimate.pose.skeleton, np.asarray(quaternion_canonical(forward_kinematics(estimate.pose)[1]))
    np.testing.assert_array_equal(skeleton.rest_offset, estimate.rest_offset[-1])
    for k, name in enumerate(skeleton.points):
        rotation = estimate[name].rotation
        if k >= len(skeleton.joints):
            assert rotation is None
        else:
            np.testing.assert_array_equal(rotation, world[:, k])
    kept = pickle.loads(pickle.dumps(estimate))
    np.testing.assert_array_equal(kept.pose.skeleton.rest_offset, skeleton.rest_offset)


@pytest.mark.parametrize("name", ["three_point", "headset_camera"])
def test_a_restored_state_continues_identically(name: str) -> None:
    observation, tracker = seen(performance(9), name), Tracker([Person(height=1.7)])
    lead = ("position", "rotation", "has_position", "has_rotation", "accuracy")
    observation = replace(observation, **{part: getattr(observation, part)[None] for part in lead})
    _, state = tracker.step(observation[:20], tracker.start())
    restored = Tracker([Person(height=1.7)]).restore(state.to_bytes())
    one, other = (tracker.step(observation[20:], each)[0] for each in (state, restored))
    assert np.array_equal(one.points, other.points)
    for stored in (b"", state.to_bytes()[:-1], bytes(len(state.to_bytes())), 2 * state.to_bytes()):
        with pytest.raises(BodysenseError, match="tracker state: "):
            tracker.restore(stored)


def test_a_refused_frame_leaves_the_state_unchanged() -> None:
    observation, tracker = seen(performance(10), "three_point"), Tracker()
    _, state = tracker.step(observation[:10], tracker.start())
    stored = state.to_bytes()
    broken = replace(observation[10:20], position=observation.position[10:20].copy())
    broken.position[5, 0, 1] = np.nan
    with pytest.raises(
        BodysenseError, match=f"{broken.points[0]!r} is tracked at frame 5, but its position is not fin"
    ):
        tracker.step(broken, state)
    assert state.to_bytes() == stored


@pytest.mark.parametrize("size", [64, 0, -64])  # bytes, relative to a state of this network
def test_a_state_of_another_network_is_refused(size: int) -> None:
    observation, tracker = seen(performance(11), "head")[:1], Tracker()
    own = tracker.start()
    foreign = np.zeros(len(own.memory[0]) + size, np.uint8)
    with pytest.raises(BodysenseError, match=r"tracker: the state .* model"):
        tracker.step(observation, replace(own, memory=(foreign,)))


@pytest.mark.parametrize("accuracy", [1e-300, 1e39, 1e300])
def test_any_positive_accuracy_gives_a_finite_estimate(accuracy: float) -> None:
    observation = seen(performance(12), "ten_point")[:5]
    vague = replace(observation, accuracy=np.full_like(observation.accuracy, accuracy))
    estimate, _ = (tracker := Tracker()).step(vague, tracker.start())
    for values in (estimate.points, estimate.confidence, estimate.bound, estimate.pose.rotation):
        assert np.isfinite(values).all()


@pytest.mark.parametrize("field", ["floor", "ease", "longest_gap", "first_interval", "longest_interval"])
def test_invalid_settings_are_refused(field: str) -> None:
    replace(TrackerSettings(), **{field: 10.0})
    refused = {"floor": [-1001.0, 1001.0], "longest_gap": [-1.0, 0.0], "ease": [-1.0, 10.1]}
    for value in (np.nan, np.inf, *refused.get(field, [-1.0, 0.0, 10.1])):
        with pytest.raises(BodysenseError, match=f"tracker settings: {field}"):
            replace(TrackerSettings(), **{field: value})


@pytest.mark.parametrize("origin", [0.0, -5.0, 1.7e9])
def test_time_must_increase(origin: float) -> None:
    observation, tracker = seen(performance(11), "head")[:1], Tracker()
    _, state = tracker.step(replace(observation, time=np.array([origin])), tracker.start())
    assert state.time() == origin and np.isnan(tracker.start().time())
    for wrong in (origin, origin - 1 / 60, np.nan, np.inf, -np.inf):
        with pytest.raises(BodysenseError, match=r"time"):
            tracker.step(replace(observation, time=np.array([wrong])), state)
    with pytest.raises(BodysenseError, match=f"a frame at {origin - 0.5:.15g} s came after one at {origin:.15g} s"):
        tracker.step(replace(observation, time=np.array([origin - 0.5])), state)


def test_invalid_input_is_refused() -> None:
    clip = performance()
    observation, tracker = seen(clip, "three_point"), Tracker()
    _, state = tracker.step(observation, tracker.start())
    with pytest.raises(BodysenseError, match="in order of time"):
        tracker.step(observation, state)
    with pytest.raises(BodysenseError, match="unknown joint 'heat'"):
        tracker.step(replace(observation, points=("heat", "left_wrist", "right_wrist")), tracker.start())
    with pytest.raises(BodysenseError, match="2 people"):
        Tracker([Person(), Person()]).step(observation, Tracker([Person(), Person()]).start())


@pytest.mark.parametrize("lost", [["left_wrist", "right_wrist"], ["left_ankle"], ["pelvis"], ["left_elbow"]])
def test_nothing_jumps_when_sensors_are_lost(lost: list[str]) -> None:
    """Points that are predicted from one frame to the next are eased: 10 m/s is never exceeded."""
    clip = performance(1)
    still = replace(clip, pose=clip.pose[np.zeros(len(clip), dtype=int)])
    observation = seen(still, "ten_point")
    gone = [observation.points.index(name) for name in lost]
    has_position, has_rotation = observation.has_position.copy(), observation.has_rotation.copy()
    has_position[15:, gone] = has_rotation[15:, gone] = False
    tracker = Tracker(Person(clip.pose.skeleton))
    estimate, _ = tracker.step(
        replace(observation, has_position=has_position, has_rotation=has_rotation), tracker.start()
    )
    path = np.linalg.norm(np.diff(estimate.points[:, :22], axis=0), axis=-1).max(axis=-1)
    assert path[14] < 0.015  # m, in the frame of the loss
    assert path[14:].max() < 0.05


def test_a_collar_that_is_no_longer_pulled_goes_back_slowly() -> None:
    """A wrist out of reach pulls its shoulder. When it is lost, the collar takes 0.25 s, whatever `ease` is."""
    clip = performance(frames=1)
    still = seen(clip, "six_point")
    pull = still.points.index("left_wrist")
    frames = 40
    position = np.repeat(still.position, frames, axis=0)
    position[:, pull] += [0.5, 0.2, 0.0]
    has_position = np.repeat(still.has_position, frames, axis=0)
    has_position[20:, pull] = False
    observation = replace(
        still,
        position=np.where(has_position[..., None], position, np.nan),
        rotation=np.repeat(still.rotation, frames, axis=0),
        has_position=has_position,
        has_rotation=np.repeat(still.has_rotation, frames, axis=0),
        accuracy=np.repeat(still.accuracy, frames, axis=0),
        time=np.arange(frames) / 60,
    )
    tracker = Tracker(Person(clip.pose.skeleton), settings=TrackerSettings(ease=1e-4))
    estimate, _ = tracker.step(observation, tracker.start())
    names = clip.pose.skeleton.points
    arm = estimate.points[:, names.index("left_shoulder")] - estimate.points[:, names.index("left_collar")]
    step = np.linalg.norm(np.diff(arm, axis=0), axis=-1)
    way = np.linalg.norm(arm[-1] - arm[19])
    assert way > 0.02 and step[19:].max() < 0.1 * way
