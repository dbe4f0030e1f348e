"""Builds of the core where no compiler is installed, and for other systems, by zig."""

from __future__ import annotations

import os
import re
import runpy
import shutil
import subprocess
import sys
import venv
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

import bodysense as bs
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import THREE_POINT
from bodysense.io.clip import Clip
from bodysense.io.formats.recording import Recording
from bodysense.tracking.model import PACKAGED

ROOT = Path(__file__).parents[2]
WEIGHTS = ROOT / "src" / "bodysense" / "weights" / PACKAGED
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")  # Debian's libc6-arm64-cross
NEEDS_ZIG = pytest.mark.skipif(
    find_spec("ziglang") is None, reason="needs a compiler for all systems: pip install ziglang"
)


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    """scripts/build_wheels.py."""
    return runpy.run_path(str(ROOT / "scripts" / "build_wheels.py"))


def target(script: dict[str, Any], name: str) -> Any:
    return next(one for one in script["TARGETS"] if one.name == name)


def test_a_wheel_for_another_system(script: dict[str, Any], tmp_path: Path) -> None:
    """Made of this machine's wheel: another library and tag, and a record that pip accepts."""
    native, library = tmp_path / "bodysense-0.1.0-py3-none-linux_x86_64.whl", tmp_path / "a.dll"
    library.write_bytes(b"a library")
    with ZipFile(native, "w") as wheel:
        wheel.writestr("bodysense/__init__.py", "")
        wheel.writestr("bodysense/_core.so", "this machine's")
        wheel.writestr("bodysense/_fbx.so", "this machine's")
        wheel.writestr("bodysense-0.1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nTag: py3-none-linux_x86_64\n")
        wheel.writestr("bodysense-0.1.0.dist-info/METADATA", "Metadata-Version: 2.4\nName: bodysense\nVersion: 0.1.0\n")
        wheel.writestr("bodysense-0.1.0.dist-info/RECORD", "")
    made = script["build_wheel"](
        native, {"_core": library, "_fbx": library}, target(script, "windows-x86_64"), tmp_path
    )
    assert made.name == "bodysense-0.1.0-py3-none-win_amd64.whl"
    with ZipFile(made) as wheel:
        assert wheel.read("bodysense/_core.dll") == wheel.read("bodysense/_fbx.dll") == b"a library"
        assert not [name for name in wheel.namelist() if name.endswith(".so")]
        assert wheel.read("bodysense-0.1.0.dist-info/WHEEL").decode() == "Wheel-Version: 1.0\nTag: py3-none-win_amd64\n"
        listed = {line.split(",")[0] for line in wheel.read("bodysense-0.1.0.dist-info/RECORD").decode().splitlines()}
        assert listed == set(wheel.namelist())


@pytest.mark.slow
def test_a_machine_without_a_compiler(tmp_path: Path) -> None:
    """`pip install .` with a PATH that has no compiler brings one; the core runs on the fastest kernel."""
    tools, environment = tmp_path / "tools", tmp_path / "environment"
    tools.mkdir()
    for name in ("sh", "env", "uname"):
        (tools / name).symlink_to(str(shutil.which(name)))
    venv.create(environment, with_pip=True)
    python = environment / "bin" / "python"
    bare = {name: value for name, value in os.environ.items() if name not in ("CC", "PYTHONPATH")}
    bare["PATH"] = str(tools)
    pip = [python, "-m", "pip", "install", "-q", "-c", ROOT / "constraints.txt", "--no-deps"]
    wanted = ("numpy", "array-api-compat", ROOT)
    done = subprocess.run([*pip, *wanted], env=bare, capture_output=True, text=True, check=False)
    if done.returncode and "ziglang" in done.stderr:
        pytest.skip("the package index has no ziglang")
    assert done.returncode == 0, done.stderr[-3000:]
    code = "import bodysense as bs; print(bs.Tracker().model.core.kernel)"
    found = subprocess.run([python, "-c", code], env=bare, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == bs.Tracker().model.core.kernel


@NEEDS_ZIG
@pytest.mark.slow
@pytest.mark.skipif(
    not (shutil.which("qemu-aarch64") and ARM_LIBRARIES.is_dir()), reason="needs qemu-user and libc6-arm64-cross"
)
def test_the_library_for_arm(script: dict[str, Any], waving_clip: Clip, tmp_path: Path) -> None:
    """It has all functions, and makes of a recording what this machine's makes, run in an emulator."""
    arm = target(script, "linux-arm64")
    library = script["build_library"](arm, tmp_path / "libbodysense.so")
    header = (ROOT / "core" / "include" / "bodysense.h").read_text(encoding="utf-8")
    functions = re.findall(r"\b(bs_\w+)\(", re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL))
    assert len(functions) == 17
    assert not [function for function in functions if function.encode() not in library.read_bytes()]
    seen = observe(waving_clip.pose, waving_clip.time, THREE_POINT)
    bs.write(tmp_path / "seen.jsonl", Recording(seen, waving_clip.pose.skeleton, known=False))
    zig = [*script["ZIG"], "-target", arm.zig, "-std=c11", f"-I{ROOT / 'core' / 'include'}"]
    source = ROOT / "core" / "examples" / "poses.c"
    subprocess.run([*zig, source, library, "-lm", "-o", tmp_path / "poses"], check=True)
    given = (WEIGHTS, tmp_path / "seen.jsonl", "1.7")
    command = ["qemu-aarch64", "-L", ARM_LIBRARIES, "-E", f"LD_LIBRARY_PATH={tmp_path}", tmp_path / "poses", *given]
    found = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    make = ["make", "-s", "-C", ROOT / "core", "examples", f"BUILD={tmp_path / 'here'}"]
    subprocess.run(make, check=True)
    here = subprocess.run([tmp_path / "here" / "poses", *given], capture_output=True, text=True, check=True).stdout
    rows = [np.array([[float(word) for word in line.split()] for line in text.splitlines()]) for text in (found, here)]
    assert rows[0].shape == (len(seen), 212)
    np.testing.assert_allclose(rows[0], rows[1], atol=2e-6)


@pytest.mark.skipif(find_spec("ziglang") is not None, reason="zig is installed")
def test_without_zig_a_line_says_what_to_install(tmp_path: Path) -> None:
    command = [sys.executable, ROOT / "scripts" / "build_wheels.py", "--out", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1 and "pip install ziglang" in done.stderr
