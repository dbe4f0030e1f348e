"""Completion in the shell: candidates are commands, options and values."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from bodysense.cli import main
from bodysense.devices.simulated.device import DEVICES

# Completes the last of the words that are given, as a press of the tab key does.
PRESS = """
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1))
_tyro_bodysense bodysense "${@: -1}" ""
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "bodysense"
    assert main(["--tyro-write-completion", "bash", str(path)]) == 0
    return path


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("words", "candidates"),
    [
        ("track --dev", ["--device"]),
        ("track --mi", ["--missing"]),
        ("track --device headset_c", ["headset_camera"]),
        ("track --device h", [name for name in sorted(DEVICES) if name.startswith("h")]),
        ("data i", ["info"]),
    ],
)
def test_candidates_in_bash(script: Path, words: str, candidates: list[str]) -> None:
    done = subprocess.run(
        ["bash", "-c", PRESS, "bash", str(script), "bodysense", *words.split()],
        capture_output=True,
        text=True,
        check=True,
    )
    assert sorted(done.stdout.split("\n")[:-1]) == candidates


def test_every_option_of_a_long_command_is_one_candidate(script: Path) -> None:
    done = subprocess.run(
        ["bash", "-c", PRESS, "bash", str(script), "bodysense", "track", ""], capture_output=True, text=True, check=True
    )
    lines = done.stdout.split("\n")[:-1]
    assert len(lines) > 30 and all(line.startswith("-") and " " not in line for line in lines), lines


@pytest.mark.skipif(shutil.which("zsh") is None, reason="needs zsh")
def test_the_zsh_script_is_valid(tmp_path: Path) -> None:
    path = tmp_path / "_bodysense"
    assert main(["--tyro-write-completion", "zsh", str(path)]) == 0
    subprocess.run(["zsh", "-n", str(path)], check=True)


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_help_texts_are_one_line_in_both_scripts(capsys: pytest.CaptureFixture[str], shell: str) -> None:
    assert main(["--tyro-print-completion", shell]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("COMPLETION_SPEC = ")]
    assert r"\n" not in line and "its known frames are unchanged" in line
