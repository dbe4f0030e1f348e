"""Short motion on disk, and the command as its users call it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from bodysense.cli import main
from bodysense.io.bvh import write_bvh
from bodysense.io.clip import Clip

Command = Callable[..., str]
Refused = Callable[..., str]


@pytest.fixture(scope="session")
def short_clip(waving_clip: Clip) -> Clip:
    """Two thirds of a second."""
    return replace(waving_clip, name="short", pose=waving_clip.pose[:20])


@pytest.fixture
def motion(tmp_path: Path, short_clip: Clip) -> Path:
    """The short clip as BVH."""
    write_bvh(tmp_path / "motion.bvh", short_clip)
    return tmp_path / "motion.bvh"


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Run a command that must succeed; returns what it printed."""
    monkeypatch.setenv("COLUMNS", "250")  # no line is broken

    def call(*arguments: object) -> str:
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert (status, captured.err) == (0, "")
        return captured.out

    return call


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """Run a command that must fail: status 2 and one line on stderr, without `bodysense: `, which is returned."""

    def call(*arguments: object) -> str:
        status = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert status == 2
        assert captured.err.startswith("bodysense: ") and captured.err.endswith("\n")
        assert captured.err.count("\n") == 1, captured.err
        return captured.err.removeprefix("bodysense: ").removesuffix("\n")

    return call
