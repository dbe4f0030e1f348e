"""One session without a network: clocks, losses, settings, placement."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from worn_trackers import strapped

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics, standing_pose
from bodysense.body.shape import stature
from bodysense.body.skeleton import default_skeleton
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensing import observe as see
from bodysense.devices.simulated.sensors import SENSOR_SETS, THREE_POINT
from bodysense.geometry.rigid import RigidTransform
from bodysense.geometry.rotation import geodesic_angle
from bodysense.io.formats.protocol import ProtocolError, SignalFrame
from bodysense.observing.observation import Observation
from bodysense.tracking.estimate import CONTACT_POINTS
from bodysense.tracking.tracker import Tracker
from bodysense_live.server.messages import (
    Calibrate,
    Notice,
    PlacementChanged,
    ProportionsChanged,
    Recentre,
    Settings,
    UpdateSettings,
)
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.body_display import BodyDisplay
from bodysense_live.sessions.estimation import step_many
from bodysense_live.sessions.session import Session

SKELETON = default_skeleton()
POINTS = ("head", "left_wrist", "right_wrist")


def frame(time: float, sequence: int = 0, height: float = 0.0, x: float = 0.0) -> SignalFrame:
    """Return a frame of head and wrists of the default body, which stands, faces +Z and waves."""
    pose = standing_pose(SKELETON)
    pose.root_position[:] += [x, height, 0]
    pose.rotation[SKELETON.index("left_elbow")] = [np.cos(0.4), 0, 0, np.sin(0.4 * np.sin(3 * time))]
    pose.rotation[SKELETON.index("left_elbow")] /= np.linalg.norm(pose.rotation[SKELETON.index("left_elbow")])
    floor = forward_kinematics(standing_pose(SKELETON))[0][:, 1].min()
    seen = observe(
        Pose(SKELETON, pose.root_position[None] - [0, floor, 0], pose.rotation[None]),
        np.zeros(1),
        THREE_POINT,
    )
    return SignalFrame(sequence, time, np.arange(3), np.full(3, 3), seen.position[0], seen.rotation[0])


def session(person: Person = Person(SKELETON), points: Sequence[str] = POINTS, **chosen: object) -> Session:
    return Session(points, person, Settings(**chosen))  # type: ignore[arg-type]


def play(one: Session, seconds: float, start: float = 0.0, rate: float = 30.0, **where: float) -> list[Answer]:
    answers = []
    for k in range(round(seconds * rate)):
        one.receive(frame(start + k / rate, k, **where), 0.0)
        answer = one.step()
        assert answer is not None
        answers.append(answer)
    return answers


def points_of(answer: Answer) -> np.ndarray:
    position, _ = forward_kinematics(answer.pose)
    return np.asarray(position)


def steps(answers: list[Answer]) -> np.ndarray:
    """Return the largest motion of any point between successive answers, m."""
    place = np.stack([points_of(answer) for answer in answers])
    return np.linalg.norm(np.diff(place, axis=0), axis=-1).max(axis=1)


def test_a_frame_is_answered_once_and_the_newest_wins() -> None:
    one = session()
    assert one.step() is None and not one.is_ready
    assert one.receive(frame(5.0, 7), 12.5) is None
    assert one.is_ready
    answer = one.step()
    assert answer is not None and (answer.frame.sequence, answer.frame.time, answer.received) == (7, 5.0, 12.5)
    assert one.step() is None
    one.receive(frame(5.1, 8), 12.6)
    assert one.receive(frame(5.2, 9), 12.7) == "replaced"
    newest = one.step()
    assert newest is not None and newest.frame.sequence == 9


def test_unix_time_gives_the_same_body() -> None:
    """No frame is dropped, the body is the same, and answers have the frame's time."""
    unix = 1.7e9
    usual, other = session(), session()
    for k in range(45):
        now = k / 90 if k < 30 else k / 90 + 1e-3
        usual.receive(frame(now, k), 0.0)
        assert other.receive(replace(frame(now, k), time=unix + now), 0.0) is None
        expected, answer = usual.step(), other.step()
        assert expected is not None and answer is not None and answer.frame.time == unix + now
        np.testing.assert_allclose(points_of(answer), points_of(expected), atol=1e-4)


@settings(max_examples=5)
@given(st.integers(0, 2**32 - 1))
def test_frames_that_are_late_repeated_or_reordered_are_dropped(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sent = np.arange(40) / 72
    arrives = sent + rng.uniform(0, 0.3, 40) * (rng.random(40) < 0.3)
    keep = rng.random(40) > 0.2
    order = [k for k in np.argsort(arrives, kind="stable") if keep[k] for _ in range(1 + (rng.random() < 0.1))]
    one, newest, moments = session(), -1.0, []
    for k in order:
        dropped = one.receive(frame(float(sent[k]), int(k)), 0.0)
        assert (dropped == "late") == (sent[k] <= newest)
        newest = max(newest, float(sent[k]))
        answer = one.step()
        if answer is not None:
            assert np.isfinite(answer.frame.rotation).all()
            moments.append(answer.moment)
    assert (np.diff(moments) > 0).all()


@settings(max_examples=5)
@given(st.lists(st.floats(-1e10, 1e10), min_size=2, max_size=8))
def test_any_clock_is_accepted(times: list[float]) -> None:
    one, moments = session(), []
    for k, start in enumerate(times):
        for step in range(3):
            one.receive(frame(start + step / 60, 10 * k + step), 0.0)
            answer = one.step()
            if answer is not None:
                assert np.isfinite(answer.frame.rotation).all() and np.isfinite(answer.frame.root_position).all()
                moments.append(answer.moment)
    assert (np.diff(moments) > 0).all()
    assert one.receive(frame(times[-1] + 5.0), 0.0) is None and one.step() is not None


def test_setting_the_clock_resets_the_body() -> None:
    fresh = play(session(), 0.5, 100.0)
    one = session()
    play(one, 0.5, 5000.0)
    for there, here in zip(fresh, play(one, 0.5, 100.0), strict=True):
        np.testing.assert_allclose(here.frame.rotation, there.frame.rotation, atol=1e-5)


def test_a_mirror_swaps_the_sides() -> None:
    plain, mirrored = session(), session(mirror=True)
    for here, there in zip(play(plain, 0.3), play(mirrored, 0.3), strict=True):
        expected = points_of(here)[SKELETON.mirror] * [-1, 1, 1]
        np.testing.assert_allclose(points_of(there), expected, atol=2e-3)  # as symmetric as the skeleton


def test_recentring_moves_the_wearer_to_the_origin() -> None:
    one = session()
    play(one, 0.2, x=3.0)
    one.apply(Recentre())
    answers = play(one, 0.5, 0.2, x=3.0)
    head = points_of(answers[-1])[SKELETON.index("head")]
    np.testing.assert_allclose(head[[0, 2]], 0, atol=0.02)
    placements = [message for message in one.take_messages() if isinstance(message, PlacementChanged)]
    assert placements == [one.placement_message()]
    np.testing.assert_allclose(placements[0].offset[0], -3.0, atol=1e-6)


def test_a_seated_wearer_is_raised_to_standing() -> None:
    one = session(posture="seated")
    answers = play(one, 0.5, height=-0.5)
    up = one.placement_message().offset[1]
    assert up == pytest.approx(0.5, abs=0.02)
    standing = np.asarray(forward_kinematics(standing_pose(SKELETON))[0])[:, 1]
    head = SKELETON.index("head")
    assert points_of(answers[-1])[head, 1] == pytest.approx(standing[head] - standing.min(), abs=0.02)
    one.apply(UpdateSettings({"posture": "standing"}))
    play(one, 0.1, 0.5)
    assert one.placement_message().offset[1] == 0


def test_calibration_measures_the_height() -> None:
    one = session(Person())
    one.apply(Calibrate())
    taller = 1.1
    for k in range(120):
        here = frame(k / 30, k)
        one.receive(replace(here, position=here.position * taller), 0.0)
        one.step()
    assert one.settings.height == pytest.approx(taller * stature(SKELETON.rest_offset), abs=0.03)
    assert one.height == pytest.approx(one.settings.height, abs=0.01)  # it grew to it
    notices = [message.text for message in one.take_messages() if isinstance(message, Notice)]
    assert len(notices) == 2 and "1.8" in notices[1]
    assert one.revision == 1


def test_a_world_in_centimetres_is_doubted_once_also_if_the_tracker_is_reset() -> None:
    one = session(Person())
    here = frame(0.0)
    for k in range(60):
        one.receive(replace(here, time=k / 30, sequence=k, position=here.position * 100), 0.0)
        one.step()
        if k == 30:
            one.reset_clock()
            one.abandon()
    notices = [message.text for message in one.take_messages() if isinstance(message, Notice)]
    assert notices == one.doubts and len(notices) == 1 and "unit='cm'" in notices[0]


def test_a_right_world_is_not_doubted() -> None:
    one = session(Person())
    play(one, 2.0)
    assert not [message for message in one.take_messages() if isinstance(message, Notice)] and not one.doubts


def test_a_height_that_the_head_contradicts_is_reported_and_then_inferred() -> None:
    one = session(Person(), height=1.5)
    play(one, 1.5)
    assert not [
        message for message in one.take_messages() if isinstance(message, Notice)
    ] and one.height == pytest.approx(1.5, abs=0.01)
    play(one, 8.0, 1.5)
    notices = [message.text for message in one.take_messages() if isinstance(message, Notice)]
    assert notices == ["your head is higher than a height of 1.50 m allows; your height is inferred from now on"]
    assert one.settings.height is None and one.revision == 1
    assert one.resumable_state()[0].lengths == {} and one.height > 1.58  # it grows, slowly
    one.apply(UpdateSettings({"height": 1.7}))
    play(one, 4.0, 9.5)
    assert one.settings.height == 1.7 and not [
        message for message in one.take_messages() if isinstance(message, Notice)
    ]


def test_the_rotation_of_a_tracker_is_used_after_calibration() -> None:
    tracker = "tracker_3"
    pose = standing_pose(SKELETON)
    pose.root_position[1] -= forward_kinematics(pose)[0][:, 1].min()
    seen = see(Pose(SKELETON, pose.root_position[None], pose.rotation[None]), np.zeros(1), SENSOR_SETS["six_point"])
    mounts = {"pelvis": RigidTransform(np.array([0.0, 0.03, -0.12]), np.array([0.2, 0.9, -0.3, 0.1]))}
    strapped_points = strapped(seen, mounts)
    names = tuple(tracker if name == "pelvis" else name for name in strapped_points.points)
    one, every = session(Person(), names), np.arange(len(names))
    pelvis = names.index(tracker)

    def observed(time: float) -> Observation:
        rows = np.full(len(names), 3, dtype=np.uint8)
        one.receive(SignalFrame(0, time, every, rows, strapped_points.position[0], strapped_points.rotation[0]), 0.0)
        job = one.job()
        assert job is not None
        ((estimate, state),) = step_many([(job.pipeline, job.observation, job.state)])
        assert one.answer(job, estimate, state) is not None
        return job.observation

    before = observed(0.0)
    assert "pelvis" not in before.points or not before.has_rotation[0, before.points.index("pelvis")]
    one.apply(Calibrate())
    last = [observed(k / 30) for k in range(1, 35)][-1]
    assert last.has_rotation[0, pelvis]
    assert last.points[pelvis] == "pelvis"
    joint = (
        RigidTransform(last.position[0, pelvis], last.rotation[0, pelvis])
        @ one._pipeline.tracker.people[0].mounts["pelvis"].inverse()
    )
    assert np.linalg.norm(joint.translation - seen.position[0, pelvis]) < 0.03
    assert geodesic_angle(joint.rotation, seen.rotation[0, pelvis]) < 0.01


def test_a_headset_on_a_table_gives_no_height() -> None:
    one = session(Person())
    one.apply(Calibrate())
    play(one, 1.3, height=-0.8)
    assert one.settings.height is None
    assert (
        "people are 1.0 to 2.3 m high"
        in [message for message in one.take_messages() if isinstance(message, Notice)][-1].text
    )


def test_regions_that_are_not_driven_stand_still_and_return_without_a_jump() -> None:
    one = session()
    answers = play(one, 0.5)
    one.apply(UpdateSettings({"regions": ["head", "torso"]}))
    answers += play(one, 1.0, 0.5)
    elbow = SKELETON.index("left_elbow")
    np.testing.assert_allclose(np.abs(answers[-1].frame.rotation[elbow] @ standing_pose(SKELETON).rotation[elbow]), 1)
    one.apply(UpdateSettings({"regions": ["head", "torso", "arms", "fingers", "legs"]}))
    answers += play(one, 1.0, 1.5)
    plain = steps(play(session(), 2.5))[8:].max()
    # Half of about 0.5 m in 0.08 s, from rest and without overshoot: less than 0.12 m per frame.
    assert steps(answers)[8:].max() < plain + 0.12


def test_smoothing_delays_the_body() -> None:
    plain, smooth = play(session(), 1.5), play(session(smoothing=0.1), 1.5)
    assert steps(smooth)[20:].max() < steps(plain)[20:].max()
    assert np.abs(smooth[-1].frame.rotation - plain[-1].frame.rotation).max() > 0.01


def test_a_hidden_point_is_ignored() -> None:
    one = session(hidden=("left_wrist",))
    last = play(one, 0.3)[-1]
    assert last.frame.hidden[SKELETON.index("left_wrist")] > 0.5 > last.frame.hidden[SKELETON.index("right_wrist")]
    one.apply(UpdateSettings({"hidden": []}))
    assert play(one, 0.3, 0.3)[-1].frame.hidden[SKELETON.index("left_wrist")] < 0.5


def test_a_height_set_before_the_first_frame_applies_at_once() -> None:
    one = session(Person())
    one.apply(UpdateSettings({"height": 1.9}))
    assert one.height == pytest.approx(1.9, abs=1e-3)
    with pytest.raises(ProtocolError, match="height 9 m"):
        one.apply(UpdateSettings({"height": 9}))


def test_a_body_grows_without_a_jump_to_a_height_set_later() -> None:
    one = session(Person())
    answers = play(one, 2.0)
    plain = steps(answers[8:]).max()
    before = one.height
    one.receive(frame(2.0), 0.0)
    job = one.job()
    assert job is not None
    one.apply(UpdateSettings({"height": 1.9}))
    estimate, state = job.pipeline.step(job.observation, job.state)
    assert one.answer(job, estimate, state) is not None  # a running job is answered
    one.take_messages()
    answers = play(one, 5.0, 2.0 + 1 / 30)
    assert before < 1.8 and one.height == pytest.approx(1.9, abs=0.005)
    assert steps(answers).max() < plain + 0.02
    sent = [message for message in one.take_messages() if isinstance(message, ProportionsChanged)]
    assert 5 < len(sent) <= 51  # at most ten a second
    heights = [message.height for message in sent]
    assert heights == sorted(heights) and heights[-1] == pytest.approx(1.9, abs=0.005)
    np.testing.assert_allclose(sent[-1].rest_offset, one.skeleton.rest_offset, atol=1e-6)


def test_inferred_proportions_are_sent_and_fit_the_poses() -> None:
    """For a wearer of 1.87 m and unknown proportions, wrists of the sent body are at their measured positions."""
    one = session(Person())
    for k in range(300):
        here = frame(k / 60, k)
        here = replace(here, position=1.1 * here.position)
        one.receive(here, 0.0)
        last = one.step()
        assert last is not None
        assert np.abs(points_of(last) - last.points).max() < 0.02
    assert one.height == pytest.approx(1.1 * stature(SKELETON.rest_offset), abs=0.05)
    here = replace(frame(5.0), position=1.1 * frame(5.0).position)
    one.receive(here, 0.0)
    last = one.step()
    assert last is not None
    np.testing.assert_allclose(points_of(last), last.points, atol=0.003)
    np.testing.assert_allclose(last.points[SKELETON.indices(POINTS[1:])], here.position[1:], atol=0.005)


def test_a_nan_estimate_does_not_stop_a_session() -> None:
    one = session()
    one.receive(frame(0.0), 0.0)
    job = one.job()
    assert job is not None
    estimate, state = job.pipeline.step(job.observation, job.state)
    broken = Pose(SKELETON, np.full((1, 3), np.nan), estimate.pose.rotation)
    assert one.answer(job, replace(estimate, pose=broken), state) is None
    assert play(one, 0.1, 1.0)


def test_contacts_errors_and_hidden_joints_are_mirrored_with_the_body() -> None:
    clip = performance_of_unseen_body()
    skeleton = clip.pose.skeleton
    observation = see(clip.pose[:1], clip.time[:1], THREE_POINT)
    tracker = Tracker(Person(skeleton))
    estimate, _ = tracker.step(observation, tracker.start())
    contact = np.array([[0.1, 0.9, 0.2, 0.7]])
    estimate = replace(estimate, contact=contact, confidence=np.arange(len(skeleton.points))[None] / 10)
    sent = [
        BodyDisplay(skeleton, Settings(mirror=mirror), False).step(skeleton, observation, estimate, frame(0.0))[1]
        for mirror in (False, True)
    ]
    names = [name.replace("left", "@").replace("right", "left").replace("@", "right") for name in CONTACT_POINTS]
    order = [CONTACT_POINTS.index(name) for name in names]
    np.testing.assert_array_equal(sent[1].contact, contact[0, order])
    np.testing.assert_array_equal(sent[1].expected_error, sent[0].expected_error[skeleton.mirror])
    np.testing.assert_array_equal(sent[1].hidden, sent[0].hidden[skeleton.mirror])
