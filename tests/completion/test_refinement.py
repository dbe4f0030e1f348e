"""Measured interior points are met, ends stay, and without any nothing is touched."""

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.body.retarget import retargeted
from bodysense.body.rotation import geodesic_angle
from bodysense.body.shape import sample_bodies, stature
from bodysense.body.skeleton import default_skeleton
from bodysense.completion.refinement import INTERIOR
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensors import SENSOR_SETS, observe
from bodysense.io.clip import Clip
from bodysense.observation import Estimate, Observation
from bodysense.tracker import Tracker, TrackerSettings, step_together

FRAMES = 12
EXACT = TrackerSettings(refine=True)


def performance(body: int, start: int = 100) -> Clip:
    clip = packaged_performance()
    skeleton = default_skeleton().with_offsets(sample_bodies("test", body + 1)[body])
    return replace(clip, pose=retargeted(clip.pose, skeleton)[start : start + FRAMES])


def completed(observation: Observation, person: Person, settings: TrackerSettings) -> Estimate:
    tracker = Tracker(person, settings=settings)
    return tracker.step(observation, tracker.start())[0]


@pytest.mark.parametrize("body", [1, 4])
def test_interior_points_are_met_and_ends_stay(body: int) -> None:
    clip = performance(body)
    observation = observe(clip.pose, clip.time, SENSOR_SETS["ten_point"])
    person = Person(clip.pose.skeleton)
    plain, exact = (completed(observation, person, settings) for settings in (TrackerSettings(), EXACT))
    truth = np.asarray(forward_kinematics(clip.pose)[0])

    def apart(estimate: Estimate, name: str) -> np.ndarray:
        k = clip.pose.skeleton.index(name)
        return np.linalg.norm(estimate.points[:, k] - truth[:, k], axis=-1)

    for name in observation.points:
        assert apart(exact, name).max() < (0.005 if name in INTERIOR else 0.001), name
    assert np.linalg.norm(exact.points - truth, axis=-1).mean() < np.linalg.norm(plain.points - truth, axis=-1).mean()
    assert np.degrees(geodesic_angle(plain.pose.rotation, exact.pose.rotation)).mean() < 4
    assert np.abs(forward_kinematics(exact.pose)[0] - exact.points).max() < 1e-4


def test_without_interior_points_nothing_changes() -> None:
    clip = performance(2)
    observation = observe(clip.pose, clip.time, SENSOR_SETS["three_point"])
    plain, exact = (completed(observation, Person(), settings) for settings in (TrackerSettings(), EXACT))
    assert np.array_equal(plain.points, exact.points)
    assert np.array_equal(plain.pose.rotation, exact.pose.rotation)


def test_ends_stay_on_bones_that_do_not_fit() -> None:
    clip = performance(3)
    observation = observe(clip.pose, clip.time, SENSOR_SETS["ten_point"])
    plain, exact = (
        completed(observation, Person(height=float(stature(clip.pose.skeleton.rest_offset)) - 0.1), settings)
        for settings in (TrackerSettings(), EXACT)
    )
    ends = clip.pose.skeleton.indices(["head", "left_wrist", "right_wrist", "left_ankle", "right_ankle"])
    assert np.linalg.norm(plain.points[:, ends] - exact.points[:, ends], axis=-1).max() < 0.003


def test_whole_equals_stream_equals_batch() -> None:
    clips = [performance(5), performance(6, start=40)]
    parts = [observe(clip.pose, clip.time, SENSOR_SETS["ten_point"])[:6] for clip in clips]
    trackers = [Tracker(Person(clip.pose.skeleton), settings=EXACT) for clip in clips]
    whole = [tracker.step(part, tracker.start())[0].points for tracker, part in zip(trackers, parts, strict=True)]
    states = [tracker.start() for tracker in trackers]
    for t in range(6):
        jobs = [(tracker, part[t : t + 1], state) for tracker, part, state in zip(trackers, parts, states, strict=True)]
        done = step_together(jobs)
        states = [state for _, state in done]
        for k, (estimate, _) in enumerate(done):
            assert np.abs(estimate.points[0] - whole[k][t]).max() < 1e-5
