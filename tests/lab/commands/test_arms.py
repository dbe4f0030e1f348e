"""Commands for arms and hands: training, tables, benchmark."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from people.split import write_people

from bodysense.io.clip import Clip

SMALL = ("--width", 16, "--layers", 1, "--spatial-width", 8, "--spatial-layers", 1, "--epochs", 1, "--batch", 4)


@pytest.fixture
def people(tmp_path: Path, waving_clip: Clip) -> Path:
    """Write motion of one person of every split."""
    return write_people(tmp_path / "data", {"train": [waving_clip], "val": [waving_clip], "test": [waving_clip]})


@pytest.mark.slow
def test_a_network_is_timed(small_arms: Path, tmp_path: Path, run) -> None:
    run("bench", "arms", "--frames", 3, "--model", small_arms, "--json", tmp_path / "bench.json")
    numbers = json.loads((tmp_path / "bench.json").read_text())
    assert numbers["p50_ms"] > 0 and numbers["live_frame_p50_ms"] > 0


@pytest.mark.slow
def test_the_table_is_trained_and_scored(people: Path, tmp_path: Path, run) -> None:
    table, out = tmp_path / "table", tmp_path / "out"
    run("train", "arms-table", "--data", people, "-o", table, *SMALL, "--networks", "cnn-hands", "cnn", "pahmt")
    output = run(
        *("evaluate", "pahmt-table1", "--data", people, "--networks", table, "--out", out),
        *("--json", tmp_path / "table.json"),
    )
    assert "PAHMT is below" not in output and (out / "pahmt-table1.csv").is_file()
    numbers = json.loads((tmp_path / "table.json").read_text())
    assert {f"{name}_{key}" for name in ("cnn", "pahmt") for key in ("hands_m", "overall_m", "arms")} <= set(numbers)
    assert "cnn_hands_hands_cm" in numbers and "cnn_hands_arms" not in numbers
    perfect = ("--keypoints", "perfect", "--json", tmp_path / "perfect.json", "--out", out)
    output = run("evaluate", "pahmt-table1", "--data", people, "--networks", table, *perfect)
    assert "without a detector's errors" in " ".join(output.split())
    others = json.loads((tmp_path / "perfect.json").read_text())
    # Training without a detector's errors, with the same seed, gives another network.
    run("train", "arms-table", "--data", people, "-o", out, *SMALL, "--networks", "cnn", "--keypoints", "perfect")
    assert (out / "cnn.pt").read_bytes() != (table / "cnn.pt").read_bytes()
    assert others["ik_arms_deg"] == numbers["ik_arms_deg"] and others["pahmt_arms_deg"] != numbers["pahmt_arms_deg"]


def test_invalid_options_are_refused(people: Path, tmp_path: Path, refused) -> None:
    arguments = ("train", "arms", "--data", people, "-o")
    assert "the network is written as .onnx or .pt" in refused(*arguments, tmp_path / "arms.zip")
    assert "a network of hands alone is for the table only" in refused(
        *arguments, tmp_path / "a.onnx", "--input", "hands"
    )
    assert "--without-hands 1: give a share" in refused(*arguments, tmp_path / "a.pt", "--without-hands", 1)
    assert "--epochs 0: give a whole number" in refused(*arguments, tmp_path / "a.pt", "--epochs", 0)
