"""`track` and `convert` of several files and of folders: one table, a record, and files that fail."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest

from bodysense.cli import main
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import read_bvh, write_bvh
from bodysense.takes import many
from bodysense.takes.many import RECORD, FileTask, tasks_of


@pytest.fixture
def takes(tmp_path: Path, short_clip: Clip, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with three takes, one of them in a folder of its own, a damaged file and a file of another kind."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "takes"
    (folder / "more").mkdir(parents=True)
    for frames, name in ((12, "a.bvh"), (16, "more/a.bvh"), (20, "more/b.bvh")):
        write_bvh(folder / name, replace(short_clip, pose=short_clip.pose[:frames]))
    (folder / "bad.bvh").write_text("hello")
    (folder / "notes.txt").write_text("hello")
    return Path("takes")


COMMANDS = (["convert"], ["track", "--device", "three_point", "--causal"])


@pytest.mark.parametrize("command", COMMANDS, ids=lambda words: words[0])
def test_a_folder_with_a_bad_file_is_done_but_for_it(
    takes: Path, command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*command, "takes", "-o", "out", "--json", "out.json"]) == 1
    out, err = capsys.readouterr()
    assert {str(path) for path in Path("out").rglob("*.*")} == {
        *("out/a.bvh", "out/more/a.bvh", "out/more/b.bvh", f"out/{RECORD}")
    }
    assert [len(read_bvh(Path("out") / name)) for name in ("a.bvh", "more/a.bvh", "more/b.bvh")] == [12, 16, 20]
    assert err.splitlines()[-1].startswith("failed: takes/bad.bvh: is not a BVH file")
    assert "wrote 3 of 4 files to out in" in out and "1 failed" in out and ".txt (1)" in out
    values = json.loads(Path("out.json").read_text())
    assert sorted(values["outputs"]) == ["out/a.bvh", "out/more/a.bvh", "out/more/b.bvh"]
    assert [row["frames"] for row in values["files"]] == [12, 0, 16, 20]


def test_a_result_of_many_files_is_that_of_one(takes: Path) -> None:
    Path("one").mkdir()
    assert main(["convert", "takes/a.bvh", "-o", "one/a.glb"]) == 0
    assert main(["convert", "takes/a.bvh", "takes/more/b.bvh", "-o", "out", "--ending", ".glb", "--jobs", "2"]) == 0
    assert Path("out/a.glb").read_bytes() == Path("one/a.glb").read_bytes()


def times(folder: Path) -> dict[str, int]:
    return {str(path): path.stat().st_mtime_ns for path in folder.rglob("*.bvh")}


def test_a_second_run_does_only_what_is_left(takes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (takes / "bad.bvh").unlink()
    assert main(["convert", "takes", "-o", "out"]) == 0
    first = times(Path("out"))
    assert main(["convert", "takes", "-o", "out"]) == 0 and times(Path("out")) == first
    assert "wrote 0 of 3 files" in capsys.readouterr().out
    Path("out/a.bvh").unlink()  # an output is gone
    os.utime(takes / "more/b.bvh", ns=(1, 1))  # an input is another one
    with Path("out", RECORD).open("a") as record:
        record.write('{"file": "takes/m')  # a killed run
    assert main(["convert", "takes", "-o", "out"]) == 0
    second = times(Path("out"))
    assert {name for name in first if second[name] != first[name]} == {"out/a.bvh", "out/more/b.bvh"}
    assert main(["convert", "takes", "-o", "out", "--rate", "15"]) == 0  # another option
    assert all(read_bvh(Path(name)).frame_rate == 15 for name in first)


@contextmanager
def full_disk(*_: object) -> Iterator[Path]:
    raise OSError(errno.ENOSPC, "No space left on device")
    yield Path()


def test_a_full_disk_stops_the_run_with_nothing_half_written(
    takes: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    (takes / "bad.bvh").unlink()
    with monkeypatch.context() as patched:
        patched.setattr("bodysense.io.formats.bvh.written_beside", full_disk)
        assert "the disk is full for out/a.bvh; free some space" in refused("convert", "takes", "-o", "out")
    assert [path.name for path in Path("out").rglob("*.*")] == [RECORD] and not Path("out", RECORD).read_text()
    assert main(["convert", "takes", "-o", "out"]) == 0 and len(times(Path("out"))) == 3


def test_equal_names_differ_by_the_ending_of_the_input(tmp_path: Path) -> None:
    files = [(Path(name), Path(name)) for name in ("a.bvh", "a.c3d", "b.c3d")]
    assert [task.out.name for task in tasks_of(files, tmp_path, ".glb")] == ["a_bvh.glb", "a_c3d.glb", "b.glb"]


def test_no_input_is_written_over(takes: Path, refused: Callable[..., str]) -> None:
    assert "takes/a.bvh: both read and written; give -o another folder" in refused("convert", "takes", "-o", "takes")
    write = ("convert", "takes/a.bvh", "takes/more/a.bvh", "-o", "out")
    assert "takes/more/a.bvh: " in refused(*write) and "rename one" in refused(*write)


def test_tasks_of_a_dask_scheduler(takes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[int, str | None]] = []

    def here(
        work: Callable, tasks: list[FileTask], jobs: int, scheduler: str | None
    ) -> Iterator[tuple[FileTask, object]]:
        given.append((jobs, scheduler))
        return ((task, work(task)) for task in tasks)

    monkeypatch.setattr(many, "parallel_map", here)
    write = ["convert", "takes/a.bvh", "takes/more/b.bvh", "-o", "out", "--scheduler", "tcp://host:8786"]
    assert main(write) == 0 and given == [(1, "tcp://host:8786")]
