"""Sheets of bodies: file kinds and failed writing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.pictures.sheet import draw_sheet


def test_a_sheet_is_written(tmp_path: Path, waving_clip: Clip) -> None:
    for count in (1, 7):
        draw_sheet(tmp_path / f"{count}.png", waving_clip.pose[:count])
    one, seven = (np.asarray(Image.open(tmp_path / f"{count}.png").convert("L")) for count in (1, 7))
    assert seven.shape[0] > one.shape[0] and seven.shape[1] > one.shape[1]
    dark = 100  # hair, trousers, shoes
    assert (seven < dark).sum() > 5 * (one < dark).sum()


def test_a_failed_sheet_leaves_no_file(tmp_path: Path, waving_clip: Clip) -> None:
    with pytest.raises(BodysenseError, match="does not exist; create it"):
        draw_sheet(tmp_path / "no" / "a.png", waving_clip.pose[:1])
    assert not list(tmp_path.iterdir())
