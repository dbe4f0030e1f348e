"""Elbows of arms whose bones are not tracked are hinges, about the axis of the wearer's skeleton."""

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.demo import packaged_performance
from bodysense.geometry.rotation import quaternion_canonical

from .scripted import tracked

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
