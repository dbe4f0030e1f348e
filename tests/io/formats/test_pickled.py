"""Pickles of video tools: arrays are read, and no code of a file runs, whatever it names."""

from __future__ import annotations

import io
import os
import pickle
import struct
import subprocess
import tracemalloc
import zipfile
import zlib
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from bodysense import arrays
from bodysense.errors import BodysenseError
from bodysense.io.formats.pickled import read_pickled, unpickled
from bodysense.sources.open import open_source

PROTOCOLS = range(pickle.HIGHEST_PROTOCOL + 1)


class Order:
    """An object whose pickle calls a function."""

    def __init__(self, function: Callable, *arguments: object) -> None:
        self.call = (function, arguments)

    def __reduce__(self) -> tuple:
        return self.call


def result(rng: np.random.Generator) -> dict:
    return {"poses": rng.normal(size=(5, 72)), "trans": rng.normal(size=(5, 3)).astype(np.float32), "fps": 30.0}


def torch_file(path: Path, content: bytes, storages: Mapping[str, bytes]) -> Path:
    """Write a zip file as PyTorch does: a pickle, and the bytes of tensors."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", content)
        for key, data in storages.items():
            archive.writestr(f"archive/data/{key}", data)
    return path


def tensor(size: tuple[int, ...], stride: tuple[int, ...]) -> bytes:
    """Return the pickle of a tensor whose numbers are storage 0."""
    pid = b"(X\x07\x00\x00\x00storagectorch\nFloatStorage\nX\x01\x00\x00\x000X\x03\x00\x00\x00cpuK\x04tQ"
    numbers = ["(" + "".join(f"I{n}\n" for n in part) + "t" for part in (size, stride)]
    return b"\x80\x02ctorch._utils\n_rebuild_tensor_v2\n(" + pid + b"K\x00" + "".join(numbers).encode() + b"\x89NtR."


@pytest.mark.parametrize("protocol", PROTOCOLS)
@pytest.mark.parametrize("ending", [".pkl", ".pickle", ".joblib"])
def test_arrays_are_read(tmp_path: Path, protocol: int, ending: str) -> None:
    content = result(np.random.default_rng(0))
    path = tmp_path / f"result{ending}"
    path.write_bytes(pickle.dumps({"person": OrderedDict(content), "n": np.float64(2.5)}, protocol=protocol))
    found = read_pickled(path)
    assert found["n"] == 2.5 and found["person"]["fps"] == 30.0
    for name in ("poses", "trans"):
        np.testing.assert_array_equal(found["person"][name], content[name])


def test_compressed_files_of_joblib_are_read(tmp_path: Path) -> None:
    content = result(np.random.default_rng(0))
    path = tmp_path / "result.pkl"
    path.write_bytes(zlib.compress(pickle.dumps(content)))
    np.testing.assert_array_equal(read_pickled(path)["poses"], content["poses"])


def test_tensors_are_read_and_may_be_expanded(tmp_path: Path) -> None:
    numbers = np.arange(6, dtype="<f4")
    found = read_pickled(torch_file(tmp_path / "a.pt", tensor((2, 3), (3, 1)), {"0": numbers.tobytes()}))
    np.testing.assert_array_equal(found, numbers.reshape(2, 3))
    found = read_pickled(torch_file(tmp_path / "b.pt", tensor((50, 6), (0, 1)), {"0": numbers.tobytes()}))
    np.testing.assert_array_equal(found, np.broadcast_to(numbers, (50, 6)))


ORDERS = {
    "os.system": (os.system, "touch FLAG"),
    "eval": (eval, "open('FLAG', 'w')"),
    "exec": (exec, "open('FLAG', 'w')"),
    "open": (open, "FLAG", "w"),
    "getattr": (getattr, os, "system"),
    "subprocess": (subprocess.run, ["touch", "FLAG"]),
    "numpy.load": (np.load, "FLAG"),
    "numpy.fromfile": (np.fromfile, "FLAG"),
    "numpy.memmap": (np.memmap, "FLAG", "u1", "w+", 0, (4,)),
    "import": (__import__, "antigravity"),
}


def npy(data: bytes) -> bytes:
    """Return an .npy of objects whose pickle is `data`."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "|O", "fortran_order": False, "shape": ()})
    return stream.getvalue() + data


def zipped(data: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("archive/data.pkl", data)
    return stream.getvalue()


HOLDERS = {
    "result.pkl": lambda data: data,
    "result.joblib": zlib.compress,
    "result.npy": npy,
    "result.pt": zipped,
}


@pytest.mark.parametrize("name", HOLDERS)
@pytest.mark.parametrize("order", ORDERS)
def test_no_code_of_a_file_runs(tmp_path: Path, name: str, order: str) -> None:
    flag = tmp_path / "flag"
    function, *arguments = ORDERS[order]
    if order == "getattr":
        arguments = [subprocess.Popen, "__init__"]  # modules cannot be pickled
    told = [
        one.replace("FLAG", str(flag))
        if isinstance(one, str)
        else [str(flag) if part == "FLAG" else part for part in one]
        if isinstance(one, list)
        else one
        for one in arguments
    ]
    path = tmp_path / name
    for protocol in PROTOCOLS:
        for content in (Order(function, *told), {"poses": Order(function, *told)}, [{"a": [Order(function, *told)]}]):
            path.write_bytes(HOLDERS[name](pickle.dumps(content, protocol=protocol)))
            with pytest.raises(
                BodysenseError, match=rf"{name}: .*(no array and may run any code|--figure|no poses)"
            ) as error:
                open_source(path)
            assert "\n" not in str(error.value)
            assert not flag.exists()


def memo(count: int) -> bytes:
    """Return tuples of which each holds the one before twice."""
    return b"\x80\x04)\x94" + b"".join(b"h" + bytes([k]) * 1 + b"h" + bytes([k]) + b"\x86\x94" for k in range(count))


HOSTILE = {
    "old class of os": (b"(S'touch FLAG'\nios\nsystem\n.", "os.system"),
    "object of os": (b"(cos\nsystem\nS'touch FLAG'\no.", "os.system"),
    "new object of os": (b"\x80\x02cos\nsystem\nX\x01\x00\x00\x00a\x85\x81.", "os.system"),
    "name on the stack": (b"\x80\x04\x8c\x02os\x8c\x06system\x93\x8c\x01a\x85R.", "os.system"),
    "attribute of numpy": (b"\x80\x04\x8c\x05numpy\x8c\x0eos.path.exists\x93\x8c\x01a\x85R.", "numpy.os.path.exists"),
    "registered extension": (b"\x80\x02\x82\x01.", "unregistered extension"),
    "state of an object": (b"\x80\x02cnumpy\nndarray\n)R}X\x01\x00\x00\x00aK\x01sb.", "cannot be read as a pickle"),
    "state of a text": (b"\x80\x02X\x01\x00\x00\x00a}b.", "an object with a state"),
    "another file": (b"\x80\x02X\x01\x00\x00\x00aQ.", "refers to other files"),
    "a list in itself": (b"\x80\x02]q\x00h\x00a.", "more than 32 levels"),
    "depth": (b"\x80\x02" + b"]" * 100_000 + b"a" * 99_999 + b".", "more than 32 levels"),
    "doubled tuples": (memo(60) + b".", "more than 32 levels"),
    "doubled tuples as key": (b"\x80\x04}" + memo(60)[2:] + b"K\x01s.", "keys are no texts or numbers"),
    "doubled tuples as keys": (b"\x80\x04}(" + memo(60)[2:] + b"K\x01u.", "keys are no texts or numbers"),
    "doubled tuples in a set": (b"\x80\x04\x8f(" + memo(60)[2:] + b"\x90.", "it holds sets"),
    "an endless buffer": (b"\x80\x05\x96" + struct.pack("<Q", 1 << 40) + b"abc.", "of which 4 are there"),
    "endless bytes": (b"\x80\x04\x8e" + struct.pack("<Q", 1 << 40) + b"abc.", "cannot be read as a pickle"),
    "cut short": (pickle.dumps({"poses": np.zeros((4, 72))})[:100], "cannot be read as a pickle"),
    "no pickle": (b"poses: 1, 2, 3", "cannot be read as a pickle"),
    "nothing": (b"", "cannot be read as a pickle"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_hostile_pickles_are_refused_in_one_line(tmp_path: Path, what: str) -> None:
    data, message = HOSTILE[what]
    flag = tmp_path / "flag"
    with pytest.raises(BodysenseError, match=rf"a\.pkl: .*{message}") as error:
        unpickled(data.replace(b"FLAG", str(flag).encode()), Path("a.pkl"))
    assert "\n" not in str(error.value) and not flag.exists()


def test_arrays_larger_than_their_bytes_are_refused(tmp_path: Path) -> None:
    data = pickle.dumps(np.zeros((4, 72)), protocol=2)
    assert data.count(b"K\x04KH") == 1
    with pytest.raises(BodysenseError, match="an array of"):
        unpickled(data.replace(b"K\x04KH", b"K\x04K\xff"), Path("a.pkl"))
    numbers = np.arange(6, dtype="<f4").tobytes()
    for size, stride in (((100_000, 100_000), (0, 0)), ((7,), (1,)), ((3, 3), (3, 1))):
        with pytest.raises(BodysenseError, match="a tensor of"):
            read_pickled(torch_file(tmp_path / "a.pt", tensor(size, stride), {"0": numbers}))


@pytest.mark.parametrize("name", ["bomb.pkl", "bomb.pt"])
def test_bombs_are_refused_before_they_are_unpacked(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrays, "FREE", 8 << 20)
    path, zeros = tmp_path / name, bytes(1 << 26)
    if name == "bomb.pkl":
        path.write_bytes(zlib.compress(zeros))
    else:
        torch_file(path, tensor((1,), (1,)), {"0": zeros})
    del zeros
    tracemalloc.start()
    with pytest.raises(BodysenseError, match=rf"{name}: .* that unpack to [\d.]+ MiB"):
        read_pickled(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 26
