from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.body.keypoints import Camera
from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.person import PersonTrack
from bodysense.errors import BodysenseError
from bodysense.pictures.overlay import Overlay, draw_numbers, side_by_side

SKELETON = default_skeleton()
POSE = standing_pose(SKELETON)
CAMERA = Camera(np.array([0.3, 1.0, 3.0]), np.eye(3), np.array(1.2), np.array(4 / 3))


def test_bones_lie_where_the_camera_sees_them() -> None:
    black = np.zeros((240, 321, 3), np.uint8)
    picture = side_by_side(black, POSE, CAMERA)
    assert picture.shape == (240, 320 + 192, 3) and picture.dtype == np.uint8
    seen = np.asarray(forward_kinematics(POSE)[0]) - CAMERA.position
    places = 1.2 * seen[:, :2] / -seen[:, 2:]
    for name, color in (("left_elbow", (255, 176, 46)), ("right_knee", (64, 200, 255))):
        x, y = places[SKELETON.index(name)] * [240, -240] + [160, 120]
        around = picture[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3].reshape(-1, 3).astype(int)
        assert np.abs(around - color).sum(axis=1).min() < 120, name
    assert not picture[:100, :100].any()  # pixels that are not covered are unchanged


def test_the_body_on_the_right_is_centred_on_the_floor() -> None:
    beside = side_by_side(np.zeros((240, 320, 3), np.uint8), POSE, CAMERA)[:, 320:].astype(int)
    wall = beside[2, 2]
    middle = (np.abs(beside[:, 76:116] - wall).sum(axis=2) > 120).any(axis=1)
    assert middle[60:200].all() and not middle[:5].any()


def test_a_video_with_the_times_of_the_source(tmp_path: Path) -> None:
    pytest.importorskip("av")
    from bodysense.devices.video.pictures import open_video

    times = [0.0, 0.04, 0.2, 0.21]
    with Overlay(tmp_path / "a.mp4", 30.0) as overlay:
        for time in times:
            overlay.show(time, np.zeros((96, 128, 3), np.uint8), POSE, CAMERA)
    with open_video(str(tmp_path / "a.mp4")) as video:
        pictures = list(video.pictures)
    np.testing.assert_allclose([picture.time for picture in pictures], times, atol=2e-3)
    assert pictures[0].pixels.shape == (96, 128 + 76, 3)


def test_numbers_are_drawn_on_people() -> None:
    places = {1: np.array([-0.4, 0.1]), 2: np.array([0.3, -0.2])}
    people = [PersonTrack(0.0, place, np.zeros(2), 0.3, np.zeros(3), number) for number, place in places.items()]
    grey = np.full((240, 320, 3), 128, np.uint8)
    frames = draw_numbers(grey, people)
    changed = (frames != grey).any(axis=2)
    for place in places.values():
        x, y = np.round(place * [240, -240] + [160, 120]).astype(int)
        assert changed[y - 8 : y + 8, x - 8 : x + 8].all()
        changed[y - 20 : y + 20, x - 20 : x + 20] = False
    assert not changed.any() and (grey == 128).all()


def test_a_failed_video_leaves_no_file(tmp_path: Path) -> None:
    pytest.importorskip("av")
    with pytest.raises(BodysenseError, match="stop"), Overlay(tmp_path / "a.mp4", 30.0) as overlay:
        overlay.show(0.0, np.zeros((96, 128, 3), np.uint8), POSE, CAMERA)
        raise BodysenseError("stop")
    assert not list(tmp_path.iterdir())


def test_names_that_are_no_videos_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("av")
    with pytest.raises(BodysenseError, match=r"name it \.mp4"), Overlay(tmp_path / "a.xyz", 30.0):
        pass
