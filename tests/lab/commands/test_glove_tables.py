"""`bodysense evaluate gloves-table3`, `gloves-table4` and `train gloves` from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.skeleton import default_skeleton
from bodysense.cli import main
from bodysense_lab.papers.two_hands.score import scores
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion

from ...conftest import Refused


@pytest.mark.slow
@pytest.mark.parametrize(
    ("table", "option", "network", "changed", "kept"),
    [
        ("gloves-table3", "--model", "markers", "nn_1_0.1_cm", "lk_1_0.1_cm"),
        ("gloves-table4", "--joints", "joints", "nn_0_cm", "ik_cm"),
        ("gloves-table4", "--markers", "markers", "nn_1_0.1_cm", "ik_cm"),
        ("gloves-fusion", "--joints", "joints", "synthesised_fused_1_0.1_cm", "synthesised_imu_1_0.1_cm"),
    ],
)
def test_the_network_of_an_option_is_scored(
    table: str,
    option: str,
    network: str,
    changed: str,
    kept: str,
    untrained_gloves: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def short(number: int) -> HandMotion:
        seconds = 6.2 if table == "gloves-fusion" else 1.2
        hand = hand_skeleton(default_skeleton(), "left")
        return synthesize_hand(hand, seconds, np.random.default_rng(number))

    monkeypatch.setattr(scores, "synthetic_hand", short)
    found = []
    for more in ((), (option, str(untrained_gloves / f"glove_{network}.onnx"))):
        out = tmp_path / f"{len(found)}.json"
        assert (
            main(["evaluate", table, "--quick", "--jobs", "1", *more, "--out", str(tmp_path), "--json", str(out)]) == 0
        )
        found.append(json.loads(out.read_text()))
    assert found[1][changed] > 1.1 * found[0][changed]
    assert found[1][kept] == pytest.approx(found[0][kept], abs=1e-9)


def test_training_several_networks_needs_a_folder(tmp_path: Path, refused: Refused) -> None:
    assert "several networks are written; give a folder" in refused("train", "gloves", "-o", tmp_path / "one.onnx")
