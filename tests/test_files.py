"""Files appear whole or not at all."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import pytest

from bodysense.errors import BodysenseError
from bodysense.files import part_beside, read_text, written_beside


def test_a_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with written_beside(path) as beside:
        assert beside.parent == tmp_path and beside.suffix == ".txt" and beside != path
        beside.write_text("whole")
        assert not path.exists()
    assert path.read_text() == "whole"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, BodysenseError])
def test_a_failing_block_keeps_the_old_file(tmp_path: Path, error: type[BaseException]) -> None:
    path = tmp_path / "a.txt"
    path.write_text("before")
    with pytest.raises(error, match="no"), written_beside(path) as beside:
        beside.write_text("half")
        raise error("no")
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_unwritable_paths_are_refused(tmp_path: Path) -> None:
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


def test_a_full_disk_gives_a_message(tmp_path: Path) -> None:
    text = r"a\.txt cannot be written \(No space left on device\); choose a place that can"
    with pytest.raises(BodysenseError, match=text), written_beside(tmp_path / "a.txt") as beside:
        beside.write_text("half")
        raise OSError(28, "No space left on device")
    assert not list(tmp_path.iterdir())


def test_leftovers_of_a_killed_writer_are_removed(tmp_path: Path) -> None:
    code = (
        "import sys, os, signal\nfrom bodysense.files import part_beside, read_text, written_beside\n"
        "with written_beside(sys.argv[1]) as beside:\n"
        "    beside.write_text('half'); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.txt")], check=False)
    assert len(list(tmp_path.iterdir())) == 1  # hidden, half
    mine = part_beside(tmp_path / "c.txt")
    mine.write_text("of a process that runs")
    (tmp_path / ".somebody.else.part").write_text("x")
    with written_beside(tmp_path / "b.txt") as beside:
        beside.write_text("whole")
    assert {path.name for path in tmp_path.iterdir()} == {"b.txt", mine.name, ".somebody.else.part"}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("a,b\n1,2".encode("utf-16"), r"a\.csv: UTF-16; save it as UTF-8: iconv -f UTF-16 -t UTF-8 a\.csv"),
        ("a,b\n1,2".encode("utf-16-le"), "UTF-16; save it as UTF-8: iconv -f UTF-16LE"),
        ("a,b\n1,2".encode("utf-16-be"), "UTF-16; save it as UTF-8: iconv -f UTF-16BE"),
        (gzip.compress(b"a", mtime=0), r"compressed by gzip; unpack it: gunzip"),
        (b"PK\x03\x04" + bytes(40), "a zip file"),
        (b"\xff\xff\xff", "not text in UTF-8; export it again"),
    ],
)
def test_files_that_are_no_text_are_refused(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "a.csv").write_bytes(data)
    with pytest.raises(BodysenseError, match=message):
        read_text(tmp_path / "a.csv")


def test_a_byte_order_mark_is_dropped(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("Zoë", encoding="utf-8-sig")
    assert read_text(tmp_path / "a.csv") == "Zoë"
