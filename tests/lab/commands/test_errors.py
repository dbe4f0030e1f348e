"""Refusals of the laboratory's commands: a line with the wrong value, and no file."""

from __future__ import annotations

from pathlib import Path

import pytest

from ...conftest import Refused


def files(folder: Path) -> list[str]:
    """Return the names of all files in a folder."""
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


@pytest.mark.parametrize(
    "command",
    [
        ("evaluate", "unoc-table2", "--data", "{folder}", "--jobs", "1"),
        ("data", "prepare", "{folder}", "-o", "{folder}/out.zarr"),
    ],
)
def test_empty_folders_are_refused(tmp_path: Path, refused: Refused, command: tuple[str, ...]) -> None:
    line = refused(*(word.format(folder=tmp_path) for word in command))
    assert tmp_path.name in line and "no .bvh or .npz file" in line
    assert not files(tmp_path)


@pytest.mark.parametrize(
    "command",
    [
        ("train", "body-gru", "--data", "{none}", "-o", "{out}.onnx"),
        ("evaluate", "unoc-table2", "--data", "{none}", "--json", "{out}.json"),
    ],
)
def test_missing_folders_are_refused_before_the_work(
    tmp_path: Path, refused: Refused, command: tuple[str, ...]
) -> None:
    """They are refused even if the data folder is empty."""
    out, none = tmp_path / "missing" / "out", tmp_path / "none"
    none.mkdir()
    line = refused(*(word.format(out=out, none=none) for word in command))
    assert str(out) in line and f"the folder {out.parent} does not exist; create it" in line
    assert not files(tmp_path)


TRACK = ("papers", "track", "{motion}", "-o", "{folder}/out.bvh", "--networks", "{none}", "--method")
TAKES = ("evaluate", "completion", "--data", "{folder}", "--takes")


@pytest.mark.parametrize(
    "command",
    [
        *((*TRACK, method) for method in ("unoc", "hmd_vae", "pahmt", "two_hands", "completion")),
        *((*TAKES, option, "{none}") for option in ("--model", "--backward-model", "--joining-model")),
        *(
            ("evaluate", "gloves-limits", "--data", "{folder}", option, "{none}")
            for option in ("--markers", "--joints")
        ),
        ("evaluate", "video-rendered", "{folder}", "--model", "{none}"),
        ("evaluate", "pahmt-table1", "--data", "{folder}", "--networks", "{folder}", "--model", "{none}"),
        ("evaluate", "unoc-table5", "--data", "{folder}", "--networks", "a={folder}", "--finger-networks", "a={none}"),
        ("bench", "arms", "--model", "{none}"),
    ],
    ids=" ".join,
)
def test_missing_networks_are_refused_before_the_work(
    tmp_path: Path, motion: Path, refused: Refused, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    """They are refused even if the data folder is empty."""
    (folder := tmp_path / "empty").mkdir()
    monkeypatch.chdir(folder)
    missing = tmp_path / "missing.onnx"
    line = refused(*(word.format(motion=motion, folder=folder, none=missing) for word in command))
    assert str(missing) in line and "no such" in line
    assert not files(folder)


def test_networks_with_other_endings_are_refused(tmp_path: Path, refused: Refused) -> None:
    line = refused("train", "body-gru", "--data", tmp_path, "-o", tmp_path / "a.pt")
    assert "written as .onnx; give a name with this ending" in line
    assert not files(tmp_path)
