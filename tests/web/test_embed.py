"""The page in a frame of another page, which steers it by messages: the listing of docs/page.md, in Chromium."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh

pytestmark = pytest.mark.slow

DOCS = Path(__file__).parents[2] / "docs" / "page.md"
AROUND = (250, 200, 90)  # colour of the page around the frame, as embed.mjs paints it


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("embed")


@pytest.fixture(scope="module")
def heard(scenario: Callable[..., dict[str, Any]], site: Path, waving_clip: Clip, folder: Path) -> dict[str, Any]:
    """Messages that the embedding page received during use."""
    listing = re.search(r"^```html\n(.*?)^```", DOCS.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert listing is not None
    (folder / "around.html").write_text(listing[1], encoding="utf-8")
    write_bvh(folder / "walk.bvh", waving_clip)
    return scenario("alone/embed", site, folder / "around.html", folder / "walk.bvh", folder / "embed.png")


def test_the_listing_plays_a_motion(heard: dict[str, Any], waving_clip: Clip, folder: Path) -> None:
    assert heard["first"] == ["ready", "loaded"]
    picture = np.asarray(Image.open(folder / "embed.png").convert("RGB"), dtype=int)
    frame = picture[14:484, 14:484]
    is_around = np.abs(frame - AROUND).max(axis=-1) <= 2
    assert 0.6 < is_around.mean() < 0.98  # the page is behind, a person before it
    assert not is_around[:, 200:270].all()


def test_play_pause_and_seek_in_any_order(heard: dict[str, Any], waving_clip: Clip) -> None:
    assert heard["whilePaused"] == 0
    length = (len(waving_clip) - 1) / waving_clip.frame_rate
    assert [event["time"] for event in heard["paused"]] == pytest.approx([0.4, 0.2, 0.2, length], abs=1e-3)
    assert {event["playing"] for event in heard["paused"]} == {False}
    last, end = heard["end"]
    assert last["time"] == pytest.approx(length, abs=1e-3) and not last["playing"]
    assert end == {"bodysense": "ended"} and heard["endedTwice"] == 2


def test_other_windows_and_origins_are_not_heard(heard: dict[str, Any]) -> None:
    assert heard["byAnother"] == 0 and heard["uninvited"] == []


def test_the_newest_motion_counts_and_faults_are_one_line(heard: dict[str, Any]) -> None:
    assert "first.bvh" not in heard["loaded"]
    assert sorted(heard["loaded"]) == ["mine.bvh", "other.vrm", "second.bvh"]
    assert heard["refused"] == [
        "dance: no such command; send one of hello, play, pause, seek, load, background.",
        "nowhere.bvh cannot be fetched: it is not there, or its host allows no other page to read it.",
    ]
