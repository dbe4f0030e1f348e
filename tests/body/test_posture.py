"""Anatomical tables: directions, symmetry, and that they name the default skeleton's joints."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.posture import posture
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.rotation import quaternion_exp


def test_every_joint_of_the_default_skeleton_but_the_root_has_a_range() -> None:
    skeleton = default_skeleton()
    table = posture(skeleton)
    free = [joint for joint, low in zip(skeleton.joints, table.low, strict=True) if (low == -np.pi).all()]
    assert free == ["pelvis"]


def test_relaxed_posture_is_within_the_ranges() -> None:
    table = posture(default_skeleton())
    assert (table.low <= table.relaxed).all()
    assert (table.relaxed <= table.high).all()
    assert (table.stiffness > 0).all()


def test_hinges_do_not_bend_backwards() -> None:
    skeleton = default_skeleton()
    table = posture(skeleton)
    assert np.degrees(table.low[skeleton.index("left_knee"), 0]) > -5
    assert np.degrees(table.high[skeleton.index("left_elbow"), 1]) < 5
    assert np.degrees(table.high[skeleton.index("left_index2"), 2]) < 20


def test_sides_mirror_each_other() -> None:
    skeleton = default_skeleton()
    table = posture(skeleton)
    mirror = skeleton.mirror[: len(skeleton.joints)]
    flip = np.array([1, -1, -1])
    bounds = np.stack([table.low, table.high])
    np.testing.assert_array_equal(table.relaxed[mirror], table.relaxed * flip)
    np.testing.assert_array_equal(np.sort(bounds[:, mirror] * flip, axis=0)[:, 1:], bounds[:, 1:])


def test_joints_without_a_row_are_free() -> None:
    table = posture(Skeleton(("root", "tail"), (), (-1, 0), np.zeros((2, 3))))
    assert (table.relaxed == 0).all()
    assert (table.stiffness == 1).all()
    assert (table.low == -np.pi).all()
    assert (table.high == np.pi).all()


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    ("joint", "point", "direction"),
    [
        ("knee", "ankle", (0, 0, -1)),  # the shin goes back
        ("elbow", "wrist", (0, 0, 1)),  # the forearm goes forward
        ("index2", "index3", (0, -1, 0)),  # fingers curl toward the palm, which is down
        ("shoulder", "elbow", (0, -1, 0)),
        ("hip", "knee", (0, 0, 1)),
    ],
)
def test_relaxed_joints_bend_in_the_right_direction(
    side: str, joint: str, point: str, direction: tuple[int, ...]
) -> None:
    skeleton = default_skeleton()
    turn = np.zeros((len(skeleton.joints), 3))
    index = skeleton.index(f"{side}_{joint}")
    turn[index] = posture(skeleton).relaxed[index]
    position, _ = forward_kinematics(Pose(skeleton, np.zeros(3), quaternion_exp(turn)))
    rest = skeleton.path @ skeleton.rest_offset
    moved = position - rest
    assert moved[skeleton.index(f"{side}_{point}")] @ np.array(direction) > 0
