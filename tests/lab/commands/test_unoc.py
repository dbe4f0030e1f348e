"""Commands of UNOC's tables, on one second of motion: output, files and refusals."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.cli.show import processor
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import write_bvh


@pytest.fixture
def networks(untrained: Path) -> Path:
    """Return a folder of untrained networks of the tables."""
    return untrained


def people(folder: Path, clip: Clip, frames: int) -> Path:
    """Write a few frames of two people."""
    for person, first in (("anna", 0), ("ben", 40)):
        (folder / person).mkdir(parents=True)
        write_bvh(folder / person / "a.bvh", replace(clip, pose=clip.pose[first : first + frames]))
    return folder


@pytest.fixture
def folder(tmp_path: Path, waving_clip: Clip) -> Path:
    return people(tmp_path / "motion", waving_clip, 15)


def common(tmp_path: Path, folder: Path, *more: object) -> tuple[object, ...]:
    return (
        *("--data", folder, "--split", "all", "--jobs", 1),
        *("--out", tmp_path / "tables", "--json", tmp_path / "numbers.json", *more),
    )


def check_files(tmp_path: Path, name: str, rows: int, keys: list[str]) -> dict[str, float]:
    """Check that CSV and numbers are complete and no other files exist; return the numbers."""
    with (tmp_path / "tables" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        table = list(csv.reader(file))
    assert len(table) == rows + 1 and {len(row) for row in table} == {len(table[0])}
    assert not [path for path in (tmp_path / "tables").iterdir() if path.name.startswith(".")]
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert numbers.pop("processor") == processor()
    assert all(isinstance(value, (int, float)) and np.isfinite(value) for value in numbers.values())
    missing = [key for key in keys if key not in numbers]
    assert not missing, missing
    return numbers


@pytest.mark.slow
def test_table_1(tmp_path: Path, folder: Path, run) -> None:
    printed = run("evaluate", "unoc-table1", *common(tmp_path, folder))
    assert "UNOC, published" in printed and "2 clips of 2 people" in printed
    assert "UNOC, of the published figures, is missing" in printed and "licence: MIT" in printed
    numbers = check_files(tmp_path, "unoc-table1", 20, ["all_body_hidden", "all_hand_seconds", "all_self_contact"])
    assert numbers["clips"] == 2


@pytest.mark.slow
def test_table_2(tmp_path: Path, folder: Path, networks: Path, small_network: Path, run) -> None:
    given = common(tmp_path, folder, "--networks", networks, "--model", small_network, "--stride", 4)
    printed = run("evaluate", "unoc-table2", *given)
    assert "UNOC's RMSJPE" in printed and "The GRU is the best network" in printed
    methods = ("gru", "rnn", "lstm", "tcn", "constant_velocity", "best", "tracker", "last_known")
    keys = [
        f"{method}_{part}_{share}_{measure}_cm"
        for method in methods
        for part in ("body", "finger", "all")
        for share in ("occluded", "all")
        for measure in ("rmsjpe", "mpjpe")
    ]
    check_files(tmp_path, "unoc-table2", 6 * len(methods), keys)
    # Scores are saved, so that another table does not compute them again.
    kept = sorted(path.name for path in networks.glob("gru.*.scores.json"))
    assert kept == ["gru.motion-all.scores.json"]
    assert "UNOC, Table 3" in run(
        "evaluate", "unoc-table3", *common(tmp_path, folder, "--networks", networks, "--stride", 4)
    )
    check_files(tmp_path, "unoc-table3", 36, ["window_81_body_all_rmsjpe_cm", "head_local_finger_occluded_mpjpe_cm"])


@pytest.mark.slow
def test_table_4(tmp_path: Path, folder: Path, networks: Path, run) -> None:
    printed = run("evaluate", "unoc-table4", *common(tmp_path, folder, "--networks", networks, "--stride", 5))
    assert "change, %" in printed
    keys = ["gru_parent_body_rmsjpe_cm", "no_parent_parent_all_mpjpe_cm", "no_bone_bone_body_mpjpe_cm"]
    check_files(tmp_path, "unoc-table4", 20, keys)


@pytest.mark.slow
def test_table_5(tmp_path: Path, folder: Path, networks: Path, run) -> None:
    given = ("--data", f"a={folder}", f"b={folder}", "--networks", f"a={networks}", f"b={networks}", "--stride", 9)
    rest = ("--split", "all", "--jobs", 1, "--out", tmp_path / "tables", "--json", tmp_path / "numbers.json")
    assert "tested on" in run("evaluate", "unoc-table5", *given, *rest)
    numbers = check_files(
        tmp_path, "unoc-table5", 4 + 4 + 9, ["a_to_b_body_occluded_rmsjpe_cm", "last_known_on_b_all_occluded_mpjpe_cm"]
    )
    assert numbers["a_to_b_all_occluded_rmsjpe_cm"] == numbers["b_to_a_all_occluded_rmsjpe_cm"]


@pytest.mark.slow
def test_smoothness(tmp_path: Path, folder: Path, networks: Path, small_network: Path, run, refused) -> None:
    given = common(tmp_path, folder, "--networks", networks, "--model", small_network)
    missing = common(tmp_path, folder, "--networks", networks, "--model", tmp_path / "missing.onnx")
    assert "missing.onnx: no such" in refused("evaluate", "unoc-smoothness", *missing).lower()
    assert "above 9 m/s²" in run("evaluate", "unoc-smoothness", *given)
    methods = ("truth", "gru", "gru_tracker", "mask_given", "mask_given_tracker", "best", "tracker")
    check_files(tmp_path, "unoc-smoothness", 14, [f"{method}_strong_acceleration_percent" for method in methods])


@pytest.mark.slow
def test_transitions(tmp_path: Path, waving_clip: Clip, small_network: Path, run) -> None:
    folder = people(tmp_path / "motion", waving_clip, 40)  # transitions last a second
    given = common(tmp_path, folder, "--model", small_network, "--quick")
    assert "--quick: a sample" in " ".join(run("evaluate", "transitions", *given).split())
    keys = [
        "tracker_occluded_rmsjpe_cm",
        "truth_regained_peak_jerk",
        "best_regained_jerk_area",
        "last_known_lost_peak_jerk",
    ]
    numbers = check_files(tmp_path, "transitions", 10, keys)
    assert numbers["last_known_tracker_regained_peak_jerk"] < numbers["last_known_regained_peak_jerk"]


@pytest.mark.slow
def test_table_6_and_finger_synthesis(tmp_path: Path, folder: Path, networks: Path, run) -> None:
    from bodysense_lab.papers.formats import PointNetworkTask
    from bodysense_lab.papers.unoc.network.export import write_point_network
    from bodysense_lab.papers.unoc.network.point_network import FINGERS, UPPER_BODY, PointNetwork, PointNetworkConfig

    tasks: tuple[tuple[PointNetworkTask, PointNetworkConfig], ...] = (("upper-body", UPPER_BODY), ("fingers", FINGERS))
    for task, config in tasks:
        network = PointNetwork(replace(config, hidden=8, branch=(8,)), default_skeleton())
        write_point_network(network, tmp_path / f"{task}.onnx", task, {"licence": "Apache-2.0"})
    assert "headset and two controllers" in run(
        "evaluate", "unoc-table6", *common(tmp_path, folder, "--model", tmp_path / "upper-body.onnx")
    )
    check_files(tmp_path, "unoc-table6", 16, ["ik_all_rmsjpe_cm", "network_elbows_mpjpe_cm", "network_neck_rmsjpe_cm"])
    given = (
        "--data",
        f"a={folder}",
        "--networks",
        f"a={networks}",
        "--finger-networks",
        f"a={tmp_path / 'fingers.onnx'}",
    )
    rest = ("--split", "all", "--jobs", 1, "--out", tmp_path / "tables", "--json", tmp_path / "numbers.json")
    run("evaluate", "unoc-table5", *given, *rest)
    check_files(tmp_path, "unoc-table5", 1 + 1 + 9 + 1 + 9, ["a_to_a_finger_synthesis_rmsjpe_cm"])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("unoc-table2", "--networks", "{tmp}/none"), "bodysense train unoc-tables --data DATA --out {tmp}/none"),
        (("unoc-table4", "--networks", "{tmp}"), "no network gru, no_occlusion, no_parent, no_bone, no_parent_no_bone"),
        (("unoc-smoothness", "--networks", "{tmp}"), "no network gru, mask_given"),
        (("unoc-table5", "--networks", "{tmp}"), "write NAME=PATH"),
        (("unoc-table3", "--networks", "{tmp}", "--stride", "0"), "--stride 0: give a whole number"),
        (("unoc-table1", "--out", "{tmp}/motion/anna/a.bvh/x"), "no folder can be made there"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_invalid_options_are_refused(tmp_path: Path, folder: Path, refused, arguments, message: str) -> None:
    out = () if "--out" in arguments else ("--out", tmp_path / "tables")
    given = [argument.format(tmp=tmp_path) for argument in arguments]
    text = refused("evaluate", given[0], "--data", folder, *given[1:], *out)
    assert message.format(tmp=tmp_path) in text
    assert not list((tmp_path / "tables").glob("*")) if (tmp_path / "tables").exists() else True


def test_missing_published_sets_are_refused(tmp_path: Path, refused) -> None:
    """The message has the name of the set, its source and its licence."""
    text = refused("evaluate", "transitions", "--data", f"UNOC={tmp_path / 'none'}", "--out", tmp_path / "tables")
    assert "UNOC is missing" in text and "github.com/facebookresearch/UNOC" in text and "MIT" in text
