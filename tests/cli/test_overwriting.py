"""An input is never overwritten, unless the user says so."""

from __future__ import annotations

import gzip
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from bodysense.cli.overwriting import check_apart, check_arguments
from bodysense.errors import BodysenseError

Command = Callable[..., str]


@pytest.mark.parametrize("link", ["same", "dots", "symbolic", "hard"])
def test_the_input_is_not_overwritten(tmp_path: Path, motion: Path, refused: Command, link: str) -> None:
    out = tmp_path / "out.bvh"
    if link == "same":
        out = motion
    elif link == "dots":
        (tmp_path / "folder").mkdir()
        out = tmp_path / "folder" / ".." / motion.name
    elif link == "symbolic":
        out.symlink_to(motion)
    else:
        os.link(motion, out)
    before = motion.read_bytes()
    output = refused("track", motion, "--device", "head", "-o", out)
    assert "both read and written; give the output another name, or add --overwrite" in output
    assert "both read and written" in refused("track", motion, "--device=head", f"--out={out}")
    assert motion.read_bytes() == before


def test_the_flag_allows_overwriting(motion: Path, run: Command) -> None:
    before = motion.read_bytes()
    run("papers", "fingers", motion, "-o", motion, "--overwrite")
    assert motion.read_bytes() != before


def test_derived_names_are_not_overwritten(tmp_path: Path, motion: Path) -> None:
    os.link(motion, tmp_path / "a_2.bvh")
    with pytest.raises(BodysenseError, match=r"a_2\.bvh: would be written over .*motion\.bvh, which is read"):
        check_apart([tmp_path / f"a_{k}.bvh" for k in (1, 2, 3)], motion)
    check_apart([tmp_path / "b_1.bvh"], motion)


def test_values_that_are_no_files_are_ignored(tmp_path: Path) -> None:
    given = ["track", "0", "0", str(tmp_path), str(tmp_path), "a\0.b", "--height", "1.7", "--height=1.7"]
    assert check_arguments(given) == given


def test_unsupported_files_are_refused_with_the_fix(tmp_path: Path, motion: Path, refused: Command) -> None:
    out = tmp_path / "out.bvh"
    (tmp_path / "a.fbx").write_bytes(b"Kaydara FBX Binary  \x00")
    assert "a.fbx: this FBX file cannot be read, or is damaged" in refused("track", tmp_path / "a.fbx", "-o", out)
    (tmp_path / "a.bvh.gz").write_bytes(gzip.compress(motion.read_bytes()))
    assert "gunzip -k a.bvh.gz" in refused("track", tmp_path / "a.bvh.gz", "-o", out)
    (tmp_path / "b.bvh").write_bytes(gzip.compress(motion.read_bytes()))
    assert "b.bvh: compressed by gzip" in refused("simulate", tmp_path / "b.bvh", "-o", tmp_path / "b.npz")
    (tmp_path / "c.bvh").write_text(motion.read_text(), encoding="utf-16")
    assert "c.bvh: UTF-16" in refused("simulate", tmp_path / "c.bvh", "-o", tmp_path / "c.npz")
    (tmp_path / "d.csv").write_text("time,a.x,a.y,a.z\n0,1,2,3")
    output = refused("track", tmp_path / "d.csv", "-o", out)
    assert "no marker of a glove and no marker set of a body among 'a'" in output and "--names" in output


def test_other_motion_files_are_read(tmp_path: Path, motion: Path, run: Command) -> None:
    import numpy as np

    run("papers", "fingers", motion, "-o", tmp_path / "a.glb")
    assert "20 frames" in run("simulate", tmp_path / "a.glb", "--device", "three_point", "-o", tmp_path / "b.npz")
    np.savez(tmp_path / "video.npz", poses=np.zeros((12, 72)), transl=np.zeros((12, 3)))
    output = run("track", tmp_path / "video.npz", "--device", "head", "--rate", "25", "-o", tmp_path / "c.bvh")
    assert "note: the feet stand at y" in output and "12 frames" in output


def test_a_person_may_be_read_and_written_in_one_command(tmp_path: Path) -> None:
    path = tmp_path / "me.json"
    path.write_text("{}")
    given = ["serve", "--person", str(path), "--save-person", str(path)]
    assert check_arguments(given) == given
    with pytest.raises(BodysenseError, match="both read and written"):
        check_arguments(["track", str(path), "--save-person", str(path)])
