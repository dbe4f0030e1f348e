"""Bodies of which rotations alone are tracked."""

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS, SensorSet
from bodysense.tracking.tracker import Tracker, TrackerSettings

FRAMES, FLOOR, UP = 150, 0.4, np.array([0.0, 1.0, 0.0])  # m
BODY = ("pelvis", "spine3", "left_hip", "right_hip", "left_knee", "right_knee", "left_elbow", "right_elbow")


@pytest.mark.parametrize("joints", [BODY, ("head", "left_wrist", "right_wrist")])
def test_they_are_on_the_floor(joints: tuple[str, ...]) -> None:
    clip = packaged_performance()
    pose = Pose(clip.pose.skeleton, clip.pose.root_position[:FRAMES] + FLOOR * UP, clip.pose.rotation[:FRAMES])
    tracker = Tracker(Person(clip.pose.skeleton), settings=TrackerSettings(floor=FLOOR))
    estimate, _ = tracker.step(observe(pose, clip.time[:FRAMES], SensorSet((), joints)), tracker.start())
    lowest = estimate.points[..., 1].min(axis=-1) - FLOOR
    assert lowest.min() > -0.02 and lowest.max() < 0.05, (lowest.min(), lowest.max())
    if joints == BODY:  # what legs and trunk do says how high the head is
        head = pose.skeleton.index("head")
        assert np.abs(estimate.points[:, head, 1] - forward_kinematics(pose)[0][:, head, 1]).max() < 0.08


def test_accelerations_are_each_persons_own() -> None:
    clip, frames = packaged_performance(), 20
    starts, sensors, tracker = (0, 300), SENSOR_SETS["three_point_imu_feet"], Tracker()
    each = [observe(clip.pose[start : start + frames], clip.time[:frames], sensors) for start in starts]
    names = ("position", "rotation", "has_position", "has_rotation", "accuracy", "acceleration")
    both = replace(each[0], **{name: np.stack([getattr(one, name) for one in each]) for name in names})
    together = Tracker([Person(), Person()])
    estimate, _ = together.step(both, together.start())
    for k, one in enumerate(each):
        alone, _ = tracker.step(one, tracker.start())
        np.testing.assert_array_equal(estimate.points[k], alone.points)
