"""Bodies side by side: untracked parts are red, times are right, and nothing else differs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.io.clip import Clip
from bodysense.pictures.camera import Lens
from bodysense.pictures.comparison import View, draw_views, write_comparison, write_moments

LENS = Lens(width=90, height=110)


@pytest.fixture(scope="module")
def views(waving_clip: Clip) -> list[View]:
    pose = waving_clip.pose[:6]
    tracked = np.ones((6, len(pose.skeleton.points)), dtype=bool)
    tracked[3:, pose.skeleton.indices(["left_knee", "right_knee"])] = False
    return [View("the wearer", pose, tracked), View("bodysense", pose)]


def reds(picture: np.ndarray) -> int:
    red, green, blue = np.moveaxis(picture.astype(int), -1, 0)
    return int(((red > 1.6 * green) & (red > 1.6 * blue)).sum())


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
