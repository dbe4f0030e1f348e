"""Sessions give the same bodies as the offline tracker, alone and among many, with changing sensors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.hands.glove import glove_points
from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.io.formats.protocol import SignalFrame, wire_accuracy
from bodysense.observing.observation import Observation
from bodysense.tracking.tracker import Tracker, TrackerSettings
from bodysense_live.server.messages import Settings
from bodysense_live.sessions.answer import Answer
from bodysense_live.sessions.estimation import step_many
from bodysense_live.sessions.session import Session

SKELETON = default_skeleton()


def seen(name: str, start: int, frames: int) -> Observation:
    """Return observations of the packaged performance by a set of sensors, with the precision of the protocol."""
    clip = packaged_performance()
    pose = replace(
        clip.pose,
        root_position=clip.pose.root_position[start : start + frames],
        rotation=clip.pose.rotation[start : start + frames],
    )
    whole = observe(pose, np.arange(frames) / 60, SENSOR_SETS[name])
    return replace(
        whole,
        position=whole.position.astype(np.float32).astype(float),
        rotation=whole.rotation.astype(np.float32).astype(float),
        accuracy=1e-4 * wire_accuracy(whole.accuracy).astype(float),
    )


def as_read(observation: Observation) -> Observation:
    """Normalise quaternions, as the server does."""
    length = np.linalg.norm(observation.rotation, axis=-1, keepdims=True)
    return replace(observation, rotation=observation.rotation / length)


def frame_of(observation: Observation, t: int) -> SignalFrame:
    has = observation.has_position[t] + 2 * observation.has_rotation[t]
    here = np.flatnonzero(has)
    return SignalFrame(
        t,
        float(observation.time[t]),
        here.astype(np.uint8),
        has[here].astype(np.uint8),
        np.nan_to_num(observation.position[t, here]).astype(np.float32),
        np.nan_to_num(observation.rotation[t, here]).astype(np.float32),
        wire_accuracy(observation.accuracy[t, here]),
    )


def answered(one: Session, observation: Observation) -> list[Answer]:
    found = []
    for t in range(len(observation)):
        assert one.receive(frame_of(observation, t), 0.0) is None
        answer = one.step()
        assert answer is not None
        found.append(answer)
    return found


@pytest.mark.parametrize(
    ("name", "person"), [("head", Person()), ("three_point", Person(height=1.6)), ("six_point", Person(SKELETON))]
)
def test_live_equals_offline(name: str, person: Person) -> None:
    observation = seen(name, 100, 150)
    tracker = Tracker(person)
    expected, _ = tracker.step(as_read(observation), tracker.start())
    answers = answered(Session(observation.points, person), observation)
    assert isinstance(expected.pose.root_position, np.ndarray)
    for t, answer in enumerate(answers):
        np.testing.assert_allclose(answer.points, expected.points[t], atol=1e-6)
        np.testing.assert_allclose(answer.frame.root_position, expected.pose.root_position[t], atol=1e-6)
        np.testing.assert_allclose(answer.frame.rotation, expected.pose.rotation[t], atol=1e-6)
        np.testing.assert_allclose(answer.frame.expected_error, expected.confidence[t], atol=1e-6)
        np.testing.assert_allclose(answer.frame.contact, expected.contact[t], atol=1e-6)
        np.testing.assert_array_equal(answer.frame.hidden, ~expected.measured[t])


def test_a_session_is_independent_of_fifteen_others() -> None:
    names = ["three_point", "head", "six_point", "three_point_imu_feet"] * 4
    people = [Person(height=1.6 + 0.02 * k) if k % 2 else Person() for k in range(16)]
    signals = [seen(name, 20 * k, 40) for k, name in enumerate(names)]
    many = [
        Session(signal.points, person, Settings(hold_feet=k != 5, floor=0.1 * (k == 6)))
        for k, (signal, person) in enumerate(zip(signals, people, strict=True))
    ]
    together: list[list[Answer]] = [[] for _ in many]
    for t in range(40):
        jobs = []
        for one, signal in zip(many, signals, strict=True):
            one.receive(frame_of(signal, t), 0.0)
            job = one.job()
            assert job is not None
            jobs.append(job)
        done = step_many([(job.pipeline, job.observation, job.state) for job in jobs])
        for one, job, result, answers in zip(many, jobs, done, together, strict=True):
            answer = one.answer(job, *result)
            assert answer is not None
            answers.append(answer)
    for k in (0, 5, 6, 11):
        alone = answered(Session(signals[k].points, people[k], many[k].settings), signals[k])
        for here, there in zip(alone, together[k], strict=True):
            np.testing.assert_allclose(here.points, there.points, atol=1e-5)
            np.testing.assert_allclose(here.frame.rotation, there.frame.rotation, atol=1e-5)


def test_a_sensor_is_followed_without_a_jump_when_it_is_found_or_lost() -> None:
    """With a hip tracker in the middle third the pelvis is measured there, and the head is exact throughout."""
    observation = seen("four_point", 0, 180)
    hip = observation.points.index("pelvis")
    for mask in (observation.has_position, observation.has_rotation):
        mask[:60, hip] = mask[120:, hip] = False
    answers = answered(Session(observation.points), observation)
    pelvis, head = SKELETON.index("pelvis"), SKELETON.index("head")
    positions = np.stack([answer.points for answer in answers])
    hidden = np.array([answer.frame.hidden[pelvis] for answer in answers])
    np.testing.assert_array_equal(hidden, [1.0] * 60 + [0.0] * 60 + [1.0] * 60)
    np.testing.assert_allclose(positions[:, head], observation.position[:, observation.points.index("head")], atol=2e-3)
    away = np.linalg.norm(positions[:, pelvis] - observation.position[:, hip], axis=-1)
    assert away[90:120].max() < 0.02
    assert np.linalg.norm(np.diff(positions[120:123, pelvis], axis=0), axis=-1).max() < 0.1


def test_markers_of_gloves_become_hands() -> None:
    from bodysense.devices.simulated import glove

    clip = packaged_performance()
    pose = replace(clip.pose, root_position=clip.pose.root_position[:60], rotation=clip.pose.rotation[:60])
    observation = glove.observe(pose, np.arange(60) / 60)
    session = Session((*glove_points("left"), *glove_points("right")), Person(SKELETON))
    last = answered(session, observation)[-1]
    places = SKELETON.indices(["left_wrist", "right_wrist", "left_index_tip", "right_index_tip"])
    truth = np.asarray(forward_kinematics(pose)[0])[-1]
    np.testing.assert_allclose(last.points[places], truth[places], atol=0.02)
    assert (last.frame.hidden[places] == 0).all()


def test_a_signal_without_points_gives_a_body() -> None:
    empty = np.zeros(0)
    one = Session(())
    one.receive(
        SignalFrame(0, 0.0, empty.astype(np.uint8), empty.astype(np.uint8), np.zeros((0, 3)), np.zeros((0, 4))), 0
    )
    answer = one.step()
    assert answer is not None and np.isfinite(answer.points).all() and (answer.frame.hidden == 1).all()


def test_settings_reach_the_tracker() -> None:
    one = Session(("head",), settings=Settings(floor=0.2, hold_feet=False))
    assert one.job() is None
    one.receive(frame_of(seen("head", 0, 1), 0), 0.0)
    job = one.job()
    assert job is not None and job.pipeline.tracker.settings == TrackerSettings(floor=0.2, hold_feet=False)
