"""`bench video`: processor time of a picture, in total and by part."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bodysense.devices.video import landmarker_files
from bodysense.io.clip import Clip
from bodysense_lab.commands.bench.video import video


@pytest.mark.slow
def test_bench_video(
    filmed: tuple[np.ndarray, Clip], landmarkers: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    (tmp_path / "film").mkdir()
    for k, picture in enumerate(filmed[0]):
        Image.fromarray(picture).save(tmp_path / "film" / f"{k:02d}.png")
    monkeypatch.setattr(landmarker_files, "landmarker_folder", lambda: landmarkers)
    video(tmp_path / "film", tmp_path / "a.json")
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert (numbers["pictures"], numbers["width"], numbers["height"]) == (8, 320, 320)
    assert 0 < numbers["people_1_landmarks_ms"] < numbers["whole_ms"]
    assert numbers["body_ms"] == pytest.approx(numbers["whole_ms"] - numbers["people_1_landmarks_ms"])
