"""The drawn body: occlusion, light, shadow, and files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.surface import Mesh, fit_surface
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.pictures.animation import draw_pose, write_animation
from bodysense.pictures.camera import FollowingCamera, Lens, follow_body
from bodysense.pictures.painter import BodyPainter

SMALL = Lens(width=96, height=120)


SKIN, SHIRT, HAIR = (
    np.array(color) for color in ((0.69, 0.37, 0.23), (0.024, 0.21, 0.19), (0.04, 0.021, 0.014))
)  # linear


def balls(*some: tuple[float, float, float, float, np.ndarray]) -> Mesh:
    """Loose balls (x, y, z, radius, linear colour)."""
    rings, around = 24, 32
    down, turn = np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, around, endpoint=False)
    unit = np.stack(np.broadcast_arrays(*(
        np.sin(down)[:, None] * np.cos(turn), np.cos(down)[:, None], np.sin(down)[:, None] * np.sin(turn)
    )), axis=-1).reshape(-1, 3)  # fmt: skip
    row, column = np.arange(rings - 1)[:, None] * around, np.arange(around)
    a, b = row + column, row + (column + 1) % around
    quads = np.concatenate([np.stack([a, b, b + around], -1), np.stack([a, b + around, a + around], -1)]).reshape(-1, 3)
    return Mesh(
        np.concatenate([np.array(one[:3]) + one[3] * unit for one in some]),
        np.tile(unit, (len(some), 1)),
        np.concatenate([np.tile(one[4], (len(unit), 1)) for one in some]),
        np.concatenate([quads + k * len(unit) for k in range(len(some))]),
    )


@pytest.fixture(scope="module")
def level() -> FollowingCamera:
    """A camera at (0, 1, 4) that looks along −Z over a floor at 0."""
    return FollowingCamera(
        Lens(96, 120, distance=4.0, eye=1.0, aim=1.0, view_height=2.0), np.zeros((1, 2)), 0.0, 0.0, 1.0
    )


def pixel(camera: FollowingCamera, point: np.ndarray, frame: int = 0) -> tuple[int, int]:
    """Row and column of the pixel whose ray passes nearest to points in the world."""
    toward = (point - camera.eye(frame)) @ camera.axes
    near = camera.rays() @ (toward / np.linalg.norm(toward))
    row, column = np.unravel_index(int(near.argmax()), near.shape)
    return int(row), int(column)


def hue(picture: np.ndarray, color: np.ndarray) -> np.ndarray:
    """How far sRGB pixels (..., 3) are from the hue of a linear colour, whatever their brightness."""
    light = np.where(picture <= 10, picture / 255 / 12.92, ((picture / 255 + 0.055) / 1.055) ** 2.4)
    direction = light / np.maximum(np.linalg.norm(light, axis=-1, keepdims=True), 1e-9)
    return np.linalg.norm(direction - color / np.linalg.norm(color), axis=-1)


def test_near_parts_hide_far_ones(level: FollowingCamera) -> None:
    for near, far in ((0.4, -0.4), (-0.4, 0.4)):
        mesh = balls((0, 1, near, 0.2, SKIN), (0, 1, far, 0.2, SHIRT))
        seen = BodyPainter(level).draw(mesh, level.eye(0))[60, 48].astype(float)
        assert hue(seen, SKIN if near > far else SHIRT) < 0.03


def test_shading_does_not_depend_on_nearer_balls(level: FollowingCamera) -> None:
    """A ball far behind a nearer one keeps its brightness."""
    alone = BodyPainter(level).draw(balls((0.4, 1, -1.5, 0.2, SKIN)), level.eye(0))
    both = BodyPainter(level).draw(balls((-0.3, 1, 0.4, 0.2, SHIRT), (0.4, 1, -1.5, 0.2, SKIN)), level.eye(0))
    window = np.s_[40:80, 56:78]
    assert np.ptp(alone[window].astype(int)) > 60
    np.testing.assert_allclose(both[window].astype(int), alone[window].astype(int), atol=2)


def test_a_ball_is_round_and_of_the_right_size(level: FollowingCamera) -> None:
    """Coverage against the cone that a ball fills: half angle asin(r / d)."""
    mesh = balls((0.3, 1.4, 0, 0.3, SKIN))
    empty = BodyPainter(level).draw(balls((9, 1, 0, 0.1, SKIN)), level.eye(0)).astype(int)
    drawn = np.abs(BodyPainter(level).draw(mesh, level.eye(0)).astype(int) - empty).max(axis=-1) > 12
    toward = (np.array([0.3, 1.4, 0]) - level.eye(0)) @ level.axes
    angle = np.arccos(np.clip(level.rays() @ toward / np.linalg.norm(toward), -1, 1))
    limb = np.arcsin(0.3 / np.linalg.norm(toward))
    assert drawn[angle < limb - 0.005].all()
    sky = np.arange(120)[:, None] < 50  # its shadow is on the floor below
    assert not (drawn & sky)[angle > limb + 0.005].any()


def test_the_body_is_where_its_joints_are(waving_clip: Clip) -> None:
    """Joints of arms, legs and head lie on the drawn body; it wears what it should."""
    camera = follow_body(waving_clip.pose, 30, SMALL)
    skeleton = waving_clip.pose.skeleton
    position = np.asarray(forward_kinematics(waving_clip.pose)[0])
    away = replace(waving_clip.pose, root_position=waving_clip.pose.root_position + np.array([0, 50, 0]))
    one = replace(camera, follow=camera.follow[30:31])
    (empty,) = (picture.astype(int) for picture in draw_pose(away[30:31], one))
    (picture,) = (picture.astype(int) for picture in draw_pose(waving_clip.pose[30:31], one))
    for joint in ("head", "pelvis", "spine3", "left_knee", "right_knee", "left_elbow", "right_wrist", "left_ankle"):
        at = pixel(camera, position[30, skeleton.index(joint)], 30)
        assert np.abs(picture[at] - empty[at]).max() > 15, joint
    assert hue(picture[pixel(camera, position[30, skeleton.index("spine3")], 30)].astype(float), SHIRT) < 0.05


def test_hair_hides_the_face_from_behind(waving_clip: Clip) -> None:
    """The parts of a head are painted by their depth, whichever way it faces."""
    pose, skeleton = waving_clip.pose[30:31], waving_clip.pose.skeleton
    front = follow_body(pose, 30, replace(SMALL, azimuth=0.0))
    head = np.asarray(forward_kinematics(pose)[0])[0, skeleton.indices(["head", "head_top"])].mean(axis=0)
    for camera, color in ((front, SKIN), (replace(front, turn=front.turn + np.pi), HAIR)):
        (picture,) = (picture.astype(float) for picture in draw_pose(pose, camera))
        row, column = pixel(camera, head)
        assert np.median(hue(picture[row - 2 : row + 3, column - 2 : column + 3], color)) < 0.05


def test_a_shadow_lies_under_the_feet(level: FollowingCamera) -> None:
    low = BodyPainter(level).draw(balls((0, 0.12, 0, 0.1, SKIN)), level.eye(0)).astype(int)
    high = BodyPainter(level).draw(balls((0, 1.9, 0, 0.1, SKIN)), level.eye(0)).astype(int)
    at = pixel(level, np.array([0.12, 0.0, 0.1]))
    assert low[at].mean() < high[at].mean() - 10
    aside = pixel(level, np.array([0.9, 0.0, 0.1]))
    assert abs(low[aside].mean() - high[aside].mean()) <= 1


def test_an_animation_is_written(tmp_path: Path, waving_clip: Clip) -> None:
    pose = waving_clip.pose[:7]
    write_animation(tmp_path / "a.webp", pose, follow_body(pose, 30, SMALL), 30)
    with Image.open(tmp_path / "a.webp") as image:
        assert (image.format, image.size, image.info["loop"]) == ("WEBP", (96, 120), 0)
        assert getattr(image, "n_frames", 1) == 7
        duration = []
        for frame in range(7):
            image.seek(frame)
            image.load()
            duration.append(image.info["duration"])
    assert sum(duration) == 233 and set(duration) <= {33, 34}  # 7 / 30 s
    assert [path.name for path in tmp_path.iterdir()] == ["a.webp"]
    camera = follow_body(pose, 30, SMALL)
    with pytest.raises(BodysenseError, match="a camera of 7 frames cannot show 3; frame it anew"):
        write_animation(tmp_path / "b.webp", pose[:3], camera, 30)
    assert [path.name for path in tmp_path.iterdir()] == ["a.webp"]


def test_the_camera_sees_the_face_and_moves_smoothly(waving_clip: Clip) -> None:
    pose, skeleton = waving_clip.pose, waving_clip.pose.skeleton
    camera = follow_body(pose, 30, SMALL)
    assert len(camera) == 90 and (camera.follow == camera.follow[0]).all(), (
        "a head that stays is watched from one place"
    )
    np.testing.assert_allclose(camera.axes.T @ camera.axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.axes) == pytest.approx(1)
    assert camera.axes[2, 2] > 0.7, "somebody who faces +Z is seen from there"
    assert camera.axes[0, 2] > 0, "and from their left"

    walk = pose.root_position + np.linspace(0, 3, 90)[:, None] * [1.0, 0.0, 0.0]
    moving = follow_body(Pose(skeleton, walk, pose.rotation), 30, SMALL)
    head = np.asarray(forward_kinematics(Pose(skeleton, walk, pose.rotation))[0])[:, skeleton.index("head")]
    assert np.abs(moving.follow - head[:, [0, 2]]).max() < 0.8
    assert np.abs(np.diff(moving.follow, 2, axis=0)).max() < 0.003

    moved = follow_body(Pose(skeleton, pose.root_position + np.array([5.0, 2.0, -1.0]), pose.rotation), 30, SMALL)
    np.testing.assert_allclose(moved.follow - camera.follow, np.tile([5.0, -1.0], (90, 1)), atol=1e-9)
    assert moved.floor - camera.floor == pytest.approx(2)


def test_invalid_lenses_are_refused() -> None:
    with pytest.raises(BodysenseError, match="lens: width is 0; it must be positive"):
        Lens(width=0)


@pytest.mark.slow
def test_a_picture_is_drawn_in_little_time(waving_clip: Clip) -> None:
    """The aim is 30 ms of one core; three times that is a defect."""
    import time

    camera = follow_body(waving_clip.pose, 30)
    painter, meshes = BodyPainter(camera), list(fit_surface(waving_clip.pose.skeleton).placed(waving_clip.pose[:20]))
    painter.draw(meshes[0], camera.eye(0))
    spent = []
    for frame in range(20):
        begun = time.process_time()
        painter.draw(meshes[frame], camera.eye(frame))
        spent.append(time.process_time() - begun)
    assert min(spent) < 0.09
