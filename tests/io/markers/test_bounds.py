"""Bounds of marker files: rates and columns that no system writes are refused before they cost anything."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.formats.recording import Recording, read_recording, write_recording
from bodysense.io.markers.files import FASTEST, MOST_COLUMNS, read_raw
from bodysense.observing.observation import Observation

TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\nDataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t"
    "OrigDataStartFrame\tOrigNumFrames\n{rate}\t{rate}\t2\t1\tm\t{rate}\t1\t2\nFrame#\tTime\tA\t\t\n\t\tX1\tY1\tZ1\n\n"
    "1\t0\t0\t1\t0\n2\t{step}\t0\t1\t0\n"
)


@pytest.mark.parametrize(("rate", "is_read"), [(0.5, True), (120, True), (10_000, True), (2e5, False), (1e9, False)])
def test_rates_are_bounded(tmp_path: Path, rate: float, is_read: bool) -> None:
    path = tmp_path / "a.trc"
    path.write_text(TRC.format(rate=rate, step=1 / rate))
    if is_read:
        assert read_raw(path).frame_rate == pytest.approx(rate)
        return
    with pytest.raises(BodysenseError, match=rf"a\.trc: .*no camera is faster than {FASTEST:g} Hz"):
        read_raw(path)


@pytest.mark.parametrize("ending", ["csv", "tsv", "trc"])
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_columns_are_bounded_before_they_are_read(tmp_path: Path, ending: str, delimiter: str) -> None:
    path = tmp_path / f"a.{ending}"
    path.write_text("# a table\n" + delimiter.join("m.pos.x" for _ in range(900_000)) + "\n")
    begun = time.process_time()
    with pytest.raises(BodysenseError, match=rf"900000 columns; at most {MOST_COLUMNS} are read"):
        read_raw(path)
    assert time.process_time() - begun < 2.0


@pytest.mark.parametrize("letters", ["", "left\x00wrist", "left_wrist\n", "\ud800", [0x7FFFFFFF], [65, 0x110000]])
def test_names_that_are_not_text_are_refused(tmp_path: Path, letters: str | list[int]) -> None:
    """A NumPy file holds any code points, also those beyond Unicode."""
    path = tmp_path / "a.npz"
    write_recording(path, Recording(Observation.from_arrays({"head": np.zeros((3, 3))}), default_skeleton()))
    with np.load(path) as archive:
        arrays: dict[str, Any] = {name: archive[name] for name in archive.files}
    codes = np.zeros(20, dtype="<u4")
    codes[: len(letters)] = [ord(letter) for letter in letters] if isinstance(letters, str) else letters
    arrays["points"] = codes.view("<U20")
    with path.open("wb") as file:
        np.savez(file, **arrays)
    with pytest.raises(BodysenseError, match=r"a\.npz: the name of a point is not text"):
        read_recording(path)
