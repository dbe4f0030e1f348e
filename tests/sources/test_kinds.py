"""Every path that a user can give: its kind, or one line with what was typed, what is valid and the way on."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from bodysense.devices.video.pictures import IMAGES, VIDEOS
from bodysense.errors import BodysenseError
from bodysense.sources.kinds import TRACKED_ENDINGS, kind_of
from bodysense.takes.track import track

ENDINGS = (*TRACKED_ENDINGS, *VIDEOS, *IMAGES)
OTHERS = ("", ".", ".txt", ".xyz", ".docx", ".y4m", ".bvh.bak")
BVH = b"HIERARCHY\nROOT Hips\n"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refusal(typed: str) -> str:
    """Return the line that refuses a path."""
    with pytest.raises(BodysenseError) as error:
        kind_of(typed)
    line = str(error.value)
    assert line.startswith((typed, repr(typed))) and "\n" not in line and "''; valid" not in line
    assert re.search(r"[;?:] ?(give|copy|rename|did you mean|download|export|is it|remove)|give the file", line), line
    return line


@pytest.mark.parametrize("ending", [*ENDINGS, *OTHERS])
def test_empty_files_are_said_to_be_empty(folder: Path, ending: str) -> None:
    (folder / f"take{ending}").write_bytes(b"")
    assert "the file is empty" in refusal(f"take{ending}")


@pytest.mark.parametrize("ending", [*ENDINGS, *OTHERS])
def test_a_file_of_another_kind_is_to_be_renamed(folder: Path, ending: str) -> None:
    (folder / f"take{ending}").write_bytes(BVH)
    if ending == ".bvh":
        assert kind_of(f"take{ending}") == "motion"
        return
    line = refusal(f"take{ending}")
    new = line.rpartition("rename it: ")[2]
    (folder / f"take{ending}").rename(folder / new)
    assert kind_of(new) == "motion"


@pytest.mark.parametrize("ending", OTHERS)
def test_unknown_kinds_name_all_that_are_valid(folder: Path, ending: str) -> None:
    (folder / f"take{ending}").write_bytes(b"something else")
    line = refusal(f"take{ending}")
    assert all(valid in line for valid in (*TRACKED_ENDINGS, *VIDEOS))
    assert ("a name without an ending" in line) == (not ending.strip("."))


@pytest.mark.parametrize("ending", [*ENDINGS, *OTHERS])
def test_folders_name_a_file_of_theirs(folder: Path, ending: str) -> None:
    name = f"take{ending}"
    (folder / name).mkdir()
    (folder / name / "pictures.png").mkdir()  # no image
    assert "a folder without images; give one file, or a folder of .jpg" in refusal(name)
    (folder / name / "walk.bvh").write_bytes(BVH)
    assert f"give one of its files, such as {name}/walk.bvh, or all of them: bodysense track {name} -o" in refusal(name)
    (folder / name / "1.png").write_bytes(b"x")
    assert kind_of(name) == "video"


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ("", "an empty path"),
        ("  ", "an empty path"),
        ("missing.bvh", "no such file; give a file of "),
        ("wlak.bvh", "did you mean walk.bvh?"),
        (" walk.bvh", "did you mean walk.bvh?"),
        ("walk.bhv", "did you mean walk.bvh?"),
        ("walk.bvh/walk.bvh", "walk.bvh is a file; give"),
        ("takes/walk.bvh", "takes is no folder; give"),
        ("walk.bvh\n", "not printed"),
        ("walk\0.bvh", "not printed"),
        ("a" * 300 + ".bvh", "File name too long; give"),
        ("https://example.org/walk.bvh", "download it first"),
        ("file:///home/walk.bvh", "give its path, /home/walk.bvh"),
        ("-1", "no such file"),
    ],
)
def test_paths_of_no_file_are_refused_as_typed(folder: Path, typed: str, said: str) -> None:
    (folder / "walk.bvh").write_bytes(BVH)
    assert said in refusal(typed)


@pytest.mark.parametrize("call", [track])
def test_tracking_refuses_in_the_same_words(folder: Path, call: Callable[[str], object]) -> None:
    (folder / "take").write_bytes(b"something else")
    with pytest.raises(BodysenseError, match="take: a name without an ending; valid are motions"):
        call("take")
