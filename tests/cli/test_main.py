"""The command as a whole: packages that are not installed, Ctrl-C, a full disk."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import bodysense as bs
from bodysense import cli
from bodysense.cli import main
from bodysense.errors import SOURCES, how_to_install, missing_package
from bodysense.io.clip import Clip

# Python without the packages that the parts of the repository bring, then the commands.
WITHOUT = """
import sys

class Missing:
    def find_spec(self, name, *rest):
        if name.partition(".")[0] in {packages}:
            raise ModuleNotFoundError(name, name=name)

sys.meta_path.insert(0, Missing())
from bodysense.cli import main
print(*(main(command.split()) for command in sys.argv[1:]))
"""


@pytest.mark.parametrize(
    ("command", "given", "threads"),
    [("track", None, "1"), ("--quiet track", None, "1"), ("track", "4", "4"), ("train", None, None), ("", None, None)],
)
def test_takes_are_done_by_one_thread(
    command: str, given: str | None, threads: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before NumPy is imported; the user's own number is kept."""
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", given or "")
    if given is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    monkeypatch.setattr(sys, "argv", ["bodysense", *command.split()])
    monkeypatch.setattr(cli, "main", lambda: 0)
    with pytest.raises(SystemExit):
        cli.entry_point()
    assert os.environ.get("OPENBLAS_NUM_THREADS") == threads


def test_numpy_is_not_imported_before_the_command_runs() -> None:
    code = "import sys, bodysense.cli; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0


def test_missing_packages_give_their_install_lines(tmp_path: Path, short_clip: Clip) -> None:
    commands = {
        "train completion --data one --run run -o a.safetensors": "packages/lab",
        "train arms --data one -o a.onnx": "packages/lab",
        "train hmd-vae --data one -o a.onnx --model 0": "packages/lab",
        "data prepare one -o one.zarr": "packages/lab",
        "serve --port 0": "packages/live",
        "papers generate -o bodies.png": ".[networks]",
        "track one/a.bvh -o a.mcap": ".[mcap]",
        "convert one/a.bvh -o a.mcap": ".[mcap]",
    }
    (tmp_path / "one").mkdir()
    bs.write(tmp_path / "one" / "a.bvh", short_clip)
    code = WITHOUT.format(packages=[name for name in SOURCES if not name.startswith("bodysense")])
    run = [sys.executable, "-c", code, *commands]
    done = subprocess.run(run, cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False)
    assert done.stdout.split() == ["2"] * len(commands), done.stderr
    for line, source in zip(done.stderr.splitlines(), commands.values(), strict=True):
        assert line.endswith(how_to_install(source))
    assert [path.name for path in tmp_path.iterdir()] == ["one"]


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"bodysense {bs.__version__}\n"


def test_an_unknown_missing_package_raises() -> None:
    with pytest.raises(ImportError, match="colour"):
        missing_package(ModuleNotFoundError("No module named 'colour'", name="colour"))


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (KeyboardInterrupt(), 130, "bodysense: stopped\n"),
        (
            OSError(errno.ENOSPC, "No space left on device", "motion.zarr"),
            2,
            "bodysense: the disk is full for motion.zarr; free some space and run the same command again\n",
        ),
    ],
)
def test_interrupts_and_full_disks_give_one_line(
    error: BaseException, status: int, message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also while it is still loading."""

    class Stopped(ModuleType):
        def __getattr__(self, name: str) -> None:
            raise error

    monkeypatch.setitem(sys.modules, "bodysense.cli.application", Stopped("application"))
    assert main(["data", "info", "."]) == status
    assert capsys.readouterr().err == message
