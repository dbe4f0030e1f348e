"""Bodies side by side: untracked parts are red, times are right, and nothing else differs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.pictures.camera import Lens
from bodysense.pictures.comparison import View, draw_rows, draw_views, write_comparison, write_moments, write_picture

LENS = Lens(width=90, height=110)


@pytest.fixture(scope="module")
def views(waving_clip: Clip) -> list[View]:
    pose = waving_clip.pose[:6]
    tracked = np.ones((6, len(pose.skeleton.points)), dtype=bool)
    tracked[3:, pose.skeleton.indices(["left_knee", "right_knee"])] = False
    return [View("the wearer", pose, tracked), View("bodysense", pose)]


def reds(picture: np.ndarray) -> int:
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return int(((red > 1.9 * green) & (red > 1.9 * blue)).sum())


def test_untracked_parts_are_red(views: list[View]) -> None:
    pictures = list(draw_views(views, 30.0, lens=LENS))
    assert len(pictures) == 6 and all(picture.shape[1] == 180 for picture in pictures)
    left, right = pictures[5][:, :90], pictures[5][:, 90:]
    assert reds(left) > 50 and reds(right) < 5 and reds(pictures[0]) < 5
    whole = draw_views([replace(views[0], tracked=None), views[1]], 30.0, [0], LENS)
    np.testing.assert_array_equal(next(whole), pictures[0])


def test_files_are_written(views: list[View], tmp_path: Path) -> None:
    write_comparison(tmp_path / "a.webp", views, 10.0, LENS)
    with Image.open(tmp_path / "a.webp") as animation:
        frames = [animation.seek(k) or (animation.load(), animation.info["duration"])[1] for k in range(6)]
        assert animation.size[0] == 180 and frames == [100] * 6
    write_moments(tmp_path / "a.png", views, 10.0, 4, LENS)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (360, 2 * animation.size[1])


def test_positions_are_drawn_as_a_stick_figure(views: list[View]) -> None:
    position = np.asarray(forward_kinematics(views[0].pose)[0])
    stick = replace(views[0], position=position)
    body, figure = (next(draw_views([one], 30.0, [5], LENS)) for one in (views[0], stick))
    ground = next(draw_views([replace(stick, position=position + np.array([50.0, 0, 0]))], 30.0, [5], LENS))
    covered = [int((one != ground).any(axis=-1).sum()) for one in (body, figure)]
    assert 50 < covered[1] < 0.7 * covered[0], "bones are thinner than limbs"
    assert reds(figure) > 10, "legs are not tracked"
    assert reds(next(draw_views([stick], 30.0, [0], LENS))) == 0


def test_rows_are_moments_from_the_front_of_the_first_body(views: list[View], tmp_path: Path) -> None:
    picture = draw_rows(views, 30.0, [0, 5], LENS)
    band = len(picture) - 2 * LENS.height
    assert picture.shape == (2 * LENS.height + band, 2 * LENS.width, 3) and 0 < band < LENS.height
    assert reds(picture[band : band + LENS.height]) < 5 < reds(picture[band + LENS.height :])
    write_picture(tmp_path / "a.webp", picture)
    with Image.open(tmp_path / "a.webp") as image:
        assert image.size == (picture.shape[1], picture.shape[0])
    with pytest.raises(BodysenseError, match=r"a\.gif: a picture is written as \.png or \.webp"):
        write_picture(tmp_path / "a.gif", picture)
