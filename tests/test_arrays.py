"""Sizes of arrays are checked before unpacking."""

from __future__ import annotations

import shlex
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from bodysense import arrays
from bodysense.arrays import array_shapes, conversion, read_array, read_arrays
from bodysense.errors import BodysenseError
from bodysense.io.formats.archive import MotionFile
from bodysense.sources.reading import read


def header(shape: tuple[int, ...], kind: str = "<f4") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}}}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


def bomb(path: Path, name: str, size: int, begin: bytes = b"") -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open(name, "w") as stream:
        stream.write(begin)
        block = bytes(1 << 20)
        for _ in range(size >> 20):
            stream.write(block)


@pytest.mark.parametrize("fortran", [False, True])
@pytest.mark.parametrize("kind", ["<f4", ">f8", "?", "<U5", "<i8"])
def test_arrays_equal_those_read_by_numpy(tmp_path: Path, fortran: bool, kind: str) -> None:
    values = np.arange(24).reshape(2, 3, 4).astype(kind)
    values = np.asfortranarray(values) if fortran else values
    np.savez_compressed(tmp_path / "a.npz", a=values, b=np.array(3))
    np.save(tmp_path / "a.npy", values)
    found = read_arrays(tmp_path / "a.npz", ["a", "b", "c"])
    assert set(found) == {"a", "b"} and found["b"] == 3 and found["a"].dtype == values.dtype
    np.testing.assert_array_equal(found["a"], values)
    np.testing.assert_array_equal(read_array(tmp_path / "a.npy"), values)
    assert array_shapes(tmp_path / "a.npz") == {"a": (2, 3, 4), "b": ()}


def test_an_archive_that_fills_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A thousand times its size, by the rule that stops 4 MB which become 8 GB."""
    assert max(arrays.FREE, arrays.RATIO * (4 << 20)) < 8 << 30
    monkeypatch.setattr(arrays, "FREE", 8 << 20)
    size = 16 << 20
    bomb(tmp_path / "a.npz", "poses.npy", size, header((size // 288, 72)))
    with pytest.raises(BodysenseError, match=r"a\.npz: 1\d\.\d KiB that unpack to 16 MiB; .* made to fill memory"):
        read(tmp_path / "a.npz")
    bomb(tmp_path / "b.zip", "walk.bvh", size)
    with pytest.raises(BodysenseError, match=r"b\.zip/walk\.bvh: 1\d\.?\d* KiB that unpack to 16 MiB"):
        MotionFile(tmp_path / "b.zip", "walk.bvh").read()


def test_headers_that_contradict_the_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npy").write_bytes(header((10**9, 72)) + bytes(288))
    with pytest.raises(BodysenseError, match=r"announces \(1000000000, 72\) of float32, 268 GiB, but has 288 bytes"):
        read_array(tmp_path / "a.npy")
    with zipfile.ZipFile(tmp_path / "b.npz", "w") as archive:
        archive.writestr("poses.npy", header((10**9, 72)) + bytes(288))
    with pytest.raises(BodysenseError, match=r"b\.npz: 'poses' announces"):
        read_arrays(tmp_path / "b.npz")
    (tmp_path / "c.npy").write_bytes(header((1, 72))[:60])
    with pytest.raises(BodysenseError, match="damaged header"):
        read_array(tmp_path / "c.npy")
    (tmp_path / "d.npy").write_text("hello")
    with pytest.raises(BodysenseError, match="no array of NumPy's"):
        read_array(tmp_path / "d.npy")


def test_missing_files_and_arrays_are_refused(tmp_path: Path) -> None:
    for call in (read_array, read_arrays):
        with pytest.raises(BodysenseError, match="no such file"):
            call(tmp_path / "missing.npz")
    assert array_shapes(tmp_path / "missing.npz") == {}


@pytest.mark.parametrize("name", ["a.npy", "a.npz"])
def test_the_command_that_converts_pickled_arrays_runs(tmp_path: Path, name: str) -> None:
    """A .npy file holds one pickled dictionary, a .npz file an array of objects among plain ones."""
    poses, words = np.arange(144.0).reshape(2, 72), np.array(["a", None], dtype=object)
    if name == "a.npy":
        np.save(tmp_path / name, np.array({"poses": poses, "words": words}, dtype=object), allow_pickle=True)
    else:
        np.savez(tmp_path / name, poses=poses, words=words)
    program, option, code = shlex.split(conversion(tmp_path / name).partition(": ")[2])
    assert (program, option) == ("python", "-c")
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)
    with np.load(tmp_path / "a_plain.npz") as plain:
        assert plain.files == ["poses"]
        np.testing.assert_array_equal(plain["poses"], poses)
