"""`bodysense evaluate gloves-table3`, `gloves-table4` and `train gloves` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from bodysense.cli import main


@pytest.mark.slow
@pytest.mark.parametrize(("table", "key"), [("gloves-table3", "nn_4_2.0_cm"), ("gloves-table4", "nn_0_cm")])
def test_a_table_of_synthesised_hands(table: str, key: str, tmp_path: Path) -> None:
    out, figures = tmp_path / "tables", tmp_path / "figures.json"
    assert main(["evaluate", table, "--quick", "--jobs", "1", "--out", str(out), "--json", str(figures)]) == 0
    assert json.loads(figures.read_text())[key] > 0
    assert (out / f"{table}.csv").is_file() and (out / f"{table}.png").is_file()


def test_another_network_is_refused_before_anything_is_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in (["gloves-table3", "--model"], ["gloves-table4", "--joints"]):
        assert main(["evaluate", *arguments, str(tmp_path / "none.onnx"), "--out", str(tmp_path)]) == 2
        assert "none.onnx: no such model file; give the .onnx that `bodysense train gloves` wrote" in (
            capsys.readouterr().err
        )


@pytest.mark.slow
def test_training_writes_into_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    few = ("--steps", "1", "--hand-minutes", "0.1", "--pair-minutes", "0.1", "--threads", "1")
    assert main(["train", "gloves", "-o", str(tmp_path / "out"), "--network", "joints", *few]) == 0
    assert (tmp_path / "out" / "glove_joints.onnx").is_file()
    assert main(["train", "gloves", "-o", str(tmp_path / "one.onnx"), *few]) == 2
    assert "several networks are written; give a folder" in capsys.readouterr().err
