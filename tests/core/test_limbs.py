"""Elbows of arms whose bones are not tracked are hinges, about the axis of the wearer's skeleton."""

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.person import Person
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp, slerp
from bodysense.tracking.tracker import Tracker

from .scripted import RATE, body_of, posed, tracked

BENT = np.sin(np.radians(25) / 2)


def hinge_axes(pose: Pose, side: str) -> np.ndarray:
    """Axes (N, 3) of the local rotations of elbows that are bent by more than 25 degrees."""
    local = quaternion_canonical(np.asarray(pose.rotation)[60:, pose.skeleton.index(f"{side}_elbow")])
    size = np.linalg.norm(local[:, 1:], axis=-1)
    return local[size > BENT, 1:] / size[size > BENT, None]


@pytest.mark.parametrize("device", ["head", "three_point", "headset_camera"])
@pytest.mark.parametrize("side", ["left", "right"])
def test_elbows_bend_about_one_axis(device: str, side: str) -> None:
    axes = hinge_axes(tracked(packaged_performance().pose[:400], device).pose, side)
    mean = axes.mean(axis=0)
    assert len(axes) > 30 and np.linalg.norm(mean) > 0.998  # within 4 degrees
    assert abs(mean[0]) < 0.02  # across the bones, which are along x


def test_the_axis_is_learned() -> None:
    """Before anything is learned it is 11 degrees from the vertical."""
    axis = hinge_axes(tracked(packaged_performance().pose[:400], "three_point").pose, "left").mean(axis=0)
    assert abs(np.degrees(np.arctan2(axis[2], -axis[1])) - 11) > 8


def test_measured_bones_of_an_arm_are_as_measured() -> None:
    pose = packaged_performance().pose[:60]
    out = tracked(pose, "three_point_imu_feet").pose
    wrists = pose.skeleton.indices(["left_wrist", "right_wrist"])
    turned = [np.asarray(forward_kinematics(one)[1])[:, wrists] for one in (pose, out)]
    assert np.abs(np.sum(turned[0] * turned[1], axis=-1)).min() > 0.9999


@pytest.mark.parametrize("height", [1.55, 1.7, 1.85])
def test_a_lost_hand_that_hung_stays_low_while_the_other_reaches_up(height: float) -> None:
    skeleton = body_of(height)
    turns = {"left_shoulder": (0.0, 0.0, -78.0), "right_shoulder": (0.0, 0.0, 78.0), "head": (-25.0, 0.0, 0.0)}
    pose = posed(skeleton, turns, seconds=10)
    rotation = np.array(pose.rotation)
    for side in ("left", "right"):  # both hang from the start; the right one rises at 4 s
        rotation[:, skeleton.index(f"{side}_shoulder")] = rotation[100, skeleton.index(f"{side}_shoulder")]
    share = np.clip((np.arange(len(rotation)) / RATE - 4) / 0.8, 0, 1)[:, None]
    up = quaternion_exp(np.array([0.0, 0.0, -np.radians(70)]))
    place = skeleton.index("right_shoulder")
    rotation[:, place] = slerp(rotation[:, place], np.broadcast_to(up, rotation[:, place].shape), share[:, 0])
    pose = Pose(skeleton, pose.root_position, rotation)
    time = np.arange(len(rotation)) / RATE
    seen = observe(pose, time, SENSOR_SETS["three_point"])
    lost = seen.has_position.copy()
    lost[105:195, seen.points.index("left_wrist")] = False
    tracker = Tracker(Person(skeleton))
    points = tracker.step(replace(seen, has_position=lost, has_rotation=lost), tracker.start())[0].points
    wrist, truth = skeleton.index("left_wrist"), np.asarray(forward_kinematics(pose)[0])
    assert truth[195, skeleton.index("right_wrist"), 1] > truth[195, skeleton.index("head"), 1]
    off = np.linalg.norm(points[105:195, wrist] - truth[105:195, wrist], axis=-1)
    assert off.max() < 0.09 * height
