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

# Python without the packages that a part of the repository brings, then the commands.
WITHOUT = """
import sys

sys.modules.update(dict.fromkeys({packages}))
from bodysense.cli import main
print(*(main(command.split()) for command in sys.argv[1:]))
"""


def without(source: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    code = WITHOUT.format(
        packages=[name for name, brings in SOURCES.items() if brings == source and not name.startswith("bodysense")]
    )
    return subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=folder, capture_output=True, text=True, timeout=300, check=False
    )


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


@pytest.mark.parametrize(
    ("source", "commands"),
    [
        (
            "packages/lab",
            (
                "train completion --data one --run run -o a.onnx",
                "train arms --data one -o a.onnx",
                "train hmd-vae --data one -o a.onnx --model 0",
                "data prepare one -o one.zarr",
            ),
        ),
        ("packages/live", ("serve --port 0",)),
        (".[networks]", ("papers generate -o bodies.png",)),
        (".[mcap]", ("track one/a.bvh -o a.mcap", "convert one/a.bvh -o a.mcap")),
    ],
)
def test_a_missing_package_gives_the_install_line(
    source: str, commands: tuple[str, ...], tmp_path: Path, short_clip: Clip
) -> None:
    (tmp_path / "one").mkdir()
    bs.write(tmp_path / "one" / "a.bvh", short_clip)
    done = without(source, tmp_path, *commands)
    assert done.stdout.split() == ["2"] * len(commands)
    assert done.stderr.count(how_to_install(source)) == len(commands) and "Traceback" not in done.stderr
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
