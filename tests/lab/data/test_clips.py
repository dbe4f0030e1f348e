"""Clips of a folder: numbers, evenly spread samples, and errors."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets import sources
from bodysense.io.datasets.sources import Source
from bodysense.io.formats.bvh import write_bvh
from bodysense.io.reading_options import ReadingOptions
from bodysense_lab.data.clips import count_clips, open_clips


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, waving_clip: Clip) -> Path:
    path = tmp_path_factory.mktemp("clips")
    for k in range(7):
        write_bvh(path / f"p{k}_walk.bvh", replace(waving_clip, pose=waving_clip.pose[k : k + 3]))
    return path


def test_clips_are_counted_by_split(folder: Path) -> None:
    assert count_clips(folder, "all") == 7 == len(list(open_clips(folder)))
    with pytest.raises(BodysenseError, match="no such folder"):
        count_clips(folder / "none")


def test_samples_are_spread_evenly(folder: Path) -> None:
    order = [clip.person for clip in open_clips(folder)]
    for at_most in (1, 3, 20):
        some = [clip.person for clip in open_clips(folder, at_most=at_most)]
        assert len(some) == min(at_most, 7) and some == sorted(set(some))
        gaps = [order.index(b) - order.index(a) for a, b in pairwise(some)]
        assert max(gaps, default=0) - min(gaps, default=0) <= 1


def test_errors_about_missing_options_name_data_prepare(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def lying(source: Source, options: ReadingOptions) -> None:
        raise BodysenseError(f"{source.path}: it never stands upright; say which axis is up, as --up y")

    monkeypatch.setattr(sources, "read_source", lying)
    with pytest.raises(BodysenseError, match=r"--up y; if a command has no --up, .*data prepare .* -o STORE.zarr --up"):
        next(open_clips(folder))
