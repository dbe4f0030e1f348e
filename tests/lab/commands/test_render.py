from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh
from bodysense_lab.rendering.take import list_takes, read_take

from ...conftest import Command, Refused


@pytest.fixture
def lively(tmp_path: Path, waving_clip: Clip) -> Path:
    write_bvh(tmp_path / "waving.bvh", waving_clip)
    return tmp_path / "waving.bvh"


@pytest.mark.slow
def test_videos_of_a_motion_are_rendered_once(lively: Path, tmp_path: Path, run: Command) -> None:
    for name in ("moderngl", "av"):
        pytest.importorskip(name)
    command = ("data", "render", lively, "-o", tmp_path / "set", "--videos", 1, "--seconds", 1, "--pixels", 64)
    assert "videos: 1, 1 s" in run(*command)
    truths = list_takes(tmp_path / "set")
    assert len(truths) == 1
    for truth in truths:
        take = read_take(truth)
        assert take.name == truth.stem and np.isfinite(take.pose.rotation).all() and len(take.time) == 30
    written = {path: path.stat().st_mtime_ns for path in (tmp_path / "set").iterdir()}
    run(*command)
    assert written == {path: path.stat().st_mtime_ns for path in (tmp_path / "set").iterdir()}


@pytest.mark.parametrize(
    "options, message",
    [
        (("--videos", 0), "--videos 0: give a whole number"),
        (("--pixels", 101), "an even height from 64 on"),
        (("--seconds", 0.1), "1 s"),
    ],
)
def test_invalid_options_are_refused(
    options: tuple[object, ...], message: str, lively: Path, tmp_path: Path, refused: Refused
) -> None:
    assert message in refused("data", "render", lively, "-o", tmp_path / "set", *options)
    assert not (tmp_path / "set").exists()


def test_a_motion_that_is_too_short_is_refused(motion: Path, tmp_path: Path, refused: Refused) -> None:
    output = refused("data", "render", motion, "-o", tmp_path / "set")
    assert re.search(r"no clip of 2 s or more with fingers", output)


def test_a_folder_without_videos_is_not_scored(tmp_path: Path, refused: Refused) -> None:
    output = refused("evaluate", "video-rendered", tmp_path, "--out", tmp_path / "tables")
    assert "no rendered videos in it; make some with `bodysense data render`" in output
