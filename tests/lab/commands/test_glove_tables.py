"""`bodysense evaluate gloves-table3`, `gloves-table4` and `train gloves` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

from bodysense.body.hand import hand_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense.cli import main
from bodysense_lab.synthesis.hands import HandMotion, synthesize_hand
from bodysense_lab.two_hands import scores
from bodysense_lab.two_hands.network import JointNetwork, JointNetworkConfig, MarkerNetwork, MarkerNetworkConfig
from bodysense_lab.two_hands.train import write_glove_network


@pytest.fixture(scope="module")
def networks(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Small networks that were never trained, by the options that take them."""
    torch.manual_seed(0)
    folder = tmp_path_factory.mktemp("networks")
    made = {"markers": MarkerNetwork(MarkerNetworkConfig((8,))), "joints": JointNetwork(JointNetworkConfig((8,)))}
    for name, network in made.items():
        write_glove_network(network, folder / f"{name}.onnx", {})
    return {name: folder / f"{name}.onnx" for name in made}


@pytest.mark.parametrize(
    ("table", "option", "network", "changed", "kept"),
    [
        ("gloves-table3", "--model", "markers", "nn_1_0.1_cm", "lk_1_0.1_cm"),
        ("gloves-table4", "--joints", "joints", "nn_0_cm", "ik_cm"),
        pytest.param("gloves-table4", "--markers", "markers", "nn_1_0.1_cm", "ik_cm", marks=pytest.mark.slow),
        *(
            pytest.param("gloves-fusion", f"--{network}", network, changed, kept, marks=pytest.mark.slow)
            for network, changed, kept in (
                ("markers", "synthesised_markers_1_0.1_cm", "synthesised_imu_1_0.1_cm"),
                ("joints", "synthesised_fused_1_0.1_cm", "synthesised_imu_1_0.1_cm"),
            )
        ),
    ],
)
def test_the_network_of_an_option_is_scored(
    table: str,
    option: str,
    network: str,
    changed: str,
    kept: str,
    networks: dict[str, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def short(number: int) -> HandMotion:
        seconds = 6.2 if table == "gloves-fusion" else 1.2
        hand = hand_skeleton(default_skeleton(), "left")
        return synthesize_hand(hand, seconds, np.random.default_rng(number))

    monkeypatch.setattr(scores, "synthetic_hand", short)
    found = []
    for more in ((), (option, str(networks[network]))):
        out = tmp_path / f"{len(found)}.json"
        assert (
            main(["evaluate", table, "--quick", "--jobs", "1", *more, "--out", str(tmp_path), "--json", str(out)]) == 0
        )
        found.append(json.loads(out.read_text()))
    assert found[1][changed] > 1.1 * found[0][changed]
    assert found[1][kept] == pytest.approx(found[0][kept], abs=1e-9)


@pytest.mark.slow
def test_training_writes_into_a_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    few = ("--steps", "1", "--hand-minutes", "0.1", "--pair-minutes", "0.1", "--threads", "1")
    assert main(["train", "gloves", "-o", str(tmp_path / "out"), "--network", "joints", *few]) == 0
    assert (tmp_path / "out" / "glove_joints.onnx").is_file()
    assert main(["train", "gloves", "-o", str(tmp_path / "one.onnx"), *few]) == 2
    assert "several networks are written; give a folder" in capsys.readouterr().err
