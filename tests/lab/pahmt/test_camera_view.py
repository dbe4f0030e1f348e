"""Simulated cameras: their places, and the key-points of arms in their pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bodysense.body.arms import HAND_POINTS
from bodysense.body.keypoints import ArmKeypoints, Camera
from bodysense.body.pose import rest_pose, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import geodesic_angle, quaternion_exp
from bodysense.io.clip import Clip
from bodysense_lab.papers.pahmt.camera_view import FRONT, VIEW_POINTS, CameraRange, sample_cameras, view, view_points


def filmed(clip: Clip, seed: int) -> tuple[np.ndarray, Camera, ArmKeypoints]:
    points = view_points(clip.pose)[None]
    camera = sample_cameras(points[:, 0], np.random.default_rng(seed))
    return points, camera, view(points, clip.time, camera)


@pytest.mark.parametrize("seed", range(2))
def test_a_picture_is_that_of_a_pinhole(waving_clip: Clip, seed: int) -> None:
    """An independent projection: the 3 × 4 matrix of a camera that looks along its own +z, y down."""
    points, camera, seen = filmed(waving_clip, seed)
    to_camera = np.diag([1.0, -1, -1]) @ camera.axes[0].T
    extrinsic = np.concatenate([to_camera, -to_camera @ camera.position[0][:, None]], axis=1)
    height = 480.0
    intrinsic = np.array([[camera.focal[0] * height, 0, 320], [0, camera.focal[0] * height, 240], [0, 0, 1]])
    hands = points[0][:, :, len(VIEW_POINTS) - len(HAND_POINTS) :]
    homogeneous = np.concatenate([hands, np.ones((*hands.shape[:-1], 1))], axis=-1) @ (intrinsic @ extrinsic).T
    pixel = homogeneous[..., :2] / homogeneous[..., 2:]
    wanted = (pixel - [320, 240]) * [1, -1] / height
    found = seen.has_hand[0]
    assert found.any()
    np.testing.assert_allclose(seen.hand[0][found], wanted[found], atol=1e-9)


def test_cameras_stand_in_the_given_range(waving_clip: Clip) -> None:
    where = CameraRange(distance=(1.0, 3.0), heading=(-30.0, 40.0), height=(-0.2, 0.4), roll=(0.0, 0.0))
    points = np.repeat(view_points(waving_clip.pose)[:1], 200, axis=0)
    camera = sample_cameras(points, np.random.default_rng(0), where)
    shoulders = points[:, :, VIEW_POINTS.index("shoulder")]
    away = camera.position - shoulders.mean(axis=1)
    level = np.linalg.norm(away[:, [0, 2]], axis=-1)
    across = shoulders[:, 0] - shoulders[:, 1]
    ahead = np.cross(across, [0.0, 1, 0])
    angle = np.degrees(np.arctan2(np.cross(ahead, away)[:, 1], (ahead * away)[:, [0, 2]].sum(axis=-1)))
    assert level.min() >= 1.0 and level.max() <= 3.0 and level.std() > 0.3
    assert -30 - 1e-6 <= angle.min() < -20 and 30 < angle.max() <= 40 + 1e-6
    assert away[:, 1].min() >= -0.2 and away[:, 1].max() <= 0.4
    np.testing.assert_allclose(camera.axes @ camera.axes.swapaxes(-1, -2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(camera.axes), 1, atol=1e-12)
    np.testing.assert_allclose(camera.axes[:, 1, 0], 0, atol=1e-12)  # no roll: its x is level


def test_in_front_of_it_left_is_at_the_right() -> None:
    points = view_points(rest_pose(default_skeleton()))[None, None]
    seen = view(points, np.zeros(1), sample_cameras(points[:, 0], np.random.default_rng(0), FRONT))
    assert seen.has_hand.all() and seen.has_arm.all() and seen.has_torso.all()
    assert seen.hand[0, 0, 0, :, 0].min() > 0 > seen.hand[0, 0, 1, :, 0].max()
    assert seen.arm[0, 0, 0, 0, 0] > 0.9 and seen.arm[0, 0, 1, 0, 0] < -0.9
    assert np.degrees(geodesic_angle(seen.torso[0, 0], np.array([1.0, 0, 0, 0]))) < 15


def test_points_behind_the_trunk_or_outside_are_not_found() -> None:
    pose = standing_pose(default_skeleton())
    elbow, shoulder = (default_skeleton().index(f"left_{name}") for name in ("elbow", "shoulder"))
    pose.rotation[shoulder] = quaternion_exp(np.array([0.0, 0.6, -1.2]))
    pose.rotation[elbow] = quaternion_exp(np.array([0.0, 2.2, 0.0]))
    points = view_points(pose)[None, None]
    wrist = points[0, 0, 0, VIEW_POINTS.index("wrist")]
    behind = wrist[2] < points[0, 0, :, VIEW_POINTS.index("hip"), 2].mean() - 0.05
    seen = view(points, np.zeros(1), sample_cameras(points[:, 0], np.random.default_rng(0), FRONT))
    assert behind and not seen.has_hand[0, 0, 0] and seen.has_hand[0, 0, 1], wrist
    near = replace(FRONT, distance=(0.3, 0.3))
    cut = view(points, np.zeros(1), sample_cameras(points[:, 0], np.random.default_rng(0), near))
    assert not cut.has_hand.any() and not cut.has_arm[0, 0, 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"distance": (3.0, 1.0)}, "camera distance from 3 to 1: give the smaller number first"),
        ({"distance": (0.0, 1.0)}, "cameras need a positive distance"),
        ({"field_of_view": (40.0, 190.0)}, "field of view of 0 to 180"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, tuple[float, float]], message: str) -> None:
    with pytest.raises(BodysenseError, match=message):
        CameraRange(**change)
