"""Pictures: of the right kind, of the right length, with the hidden points in red, and whole or not there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.body.pose import forward_kinematics
from bodysense.data.clip import Clip
from bodysense.errors import BodysenseError
from bodysense.export.picture import HIDDEN, RESULT, Panel, draw_animation, draw_strip


def panels(clip: Clip, hidden: bool = True) -> list[Panel]:
    position = np.asarray(forward_kinematics(clip.pose)[0])
    mask = np.full(position.shape[:2], hidden)
    return [Panel("truth", position), Panel("seen", position, mask), Panel("result", position, color=RESULT)]


def share_of(color: str, picture: np.ndarray) -> float:
    """Share of an RGB picture (H, W, 3) that has about this colour."""
    rgb = np.array([int(color[k : k + 2], 16) for k in (1, 3, 5)])
    return float((np.abs(picture.astype(int) - rgb).max(axis=-1) < 12).mean())


def test_a_strip(tmp_path: Path, waving_clip: Clip) -> None:
    path = tmp_path / "strip.png"
    shares = []
    for hidden in (True, False):
        draw_strip(path, waving_clip.pose.skeleton, panels(waving_clip, hidden), waving_clip.time)
        with Image.open(path) as image:
            assert image.format == "PNG" and min(image.size) > 400
            picture = np.asarray(image.convert("RGB"))
        shares.append((share_of(HIDDEN, picture), share_of(RESULT, picture)))
    assert shares[0][0] > 0.001 and shares[1][0] < 0.2 * shares[0][0], "red is what is hidden"
    assert min(share for _, share in shares) > 0.001
    assert [found.name for found in tmp_path.iterdir()] == ["strip.png"]


@pytest.mark.parametrize(("frames", "rate", "pictures"), [(90, 5.0, 15), (31, 5.0, 6), (1, 5.0, 1), (2, 5.0, 1)])
def test_an_animation(tmp_path: Path, waving_clip: Clip, frames: int, rate: float, pictures: int) -> None:
    """It lasts as long as the motion, at the rate asked for; a single frame is a picture too."""
    path = tmp_path / "a.gif"
    position = np.asarray(forward_kinematics(waving_clip.pose[:frames])[0])
    still = np.tile(np.arange(frames)[:, None, None], (1, 1, 3)) * [0.01, 0.0, 0.0]  # no two pictures are the same
    draw_animation(path, waving_clip.pose.skeleton, [Panel("a", position + still)], waving_clip.time[:frames], rate)
    with Image.open(path) as image:
        assert image.format == "GIF"
        assert abs(getattr(image, "n_frames", 1) - pictures) <= 1
        assert image.info.get("duration", 200) == 200
    assert [found.name for found in tmp_path.iterdir()] == ["a.gif"]


def test_a_place_that_is_none(tmp_path: Path, waving_clip: Clip) -> None:
    clip = waving_clip
    for draw in (draw_strip, draw_animation):
        with pytest.raises(BodysenseError, match=r"the folder .*missing does not exist; create it"):
            draw(tmp_path / "missing" / "a.png", clip.pose.skeleton, panels(clip), clip.time)
    assert not list(tmp_path.iterdir())
