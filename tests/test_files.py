"""Files appear whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense.files import written_beside


def test_a_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with written_beside(path) as beside:
        assert beside.parent == tmp_path and beside.suffix == ".txt" and beside != path
        beside.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, BodysenseError])
def test_a_block_that_fails_leaves_what_was_there(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("before")
    with pytest.raises(error, match="no"), written_beside(path) as beside:
        beside.write_text("half")
        raise error("no")
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    def write(path: Path) -> None:
        with written_beside(path) as beside:
            beside.write_text("x")

    with pytest.raises(
        BodysenseError, match=r"missing/a\.txt: the folder .*missing does not exist; create it or choose"
    ):
        write(tmp_path / "missing" / "a.txt")
    with pytest.raises(BodysenseError, match=r"is a folder; give the name of a file in it"):
        write(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(BodysenseError, match=r"file/a\.txt: the folder .*file does not exist"):
        write(tmp_path / "file" / "a.txt")


def test_a_full_disk_is_said_in_words(tmp_path: Path) -> None:
    text = r"a\.txt cannot be written \(No space left on device\); choose a place that can"
    with pytest.raises(BodysenseError, match=text), written_beside(tmp_path / "a.txt") as beside:
        beside.write_text("half")
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())
