"""Checkpoints, whose best weights start a second stage, and files of weights."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from bodysense.errors import BodysenseError
from bodysense_lab.core.checkpoint import best_weights, read_weights_file, write_weights_file
from bodysense_lab.core.options import Schedule


def test_a_second_stage_starts_with_the_best_weights_of_the_first(tmp_path: Path) -> None:
    first, other = torch.nn.Linear(3, 2), torch.nn.Linear(4, 2)
    weights = {name: value.clone() for name, value in first.state_dict().items()}
    torch.save({"best": {"weights": weights}}, tmp_path / "one.ckpt")
    second = torch.nn.Linear(3, 2)
    second.load_state_dict(best_weights(tmp_path / "one.ckpt", second))
    assert all(torch.equal(weights[name], value) for name, value in second.state_dict().items())
    with pytest.raises(BodysenseError, match="of a network of another size"):
        best_weights(tmp_path / "one.ckpt", other)
    with pytest.raises(BodysenseError, match="no such checkpoint"):
        best_weights(tmp_path / "none.ckpt", other)
    (tmp_path / "text.ckpt").write_text("text")
    with pytest.raises(BodysenseError, match="not a readable checkpoint"):
        best_weights(tmp_path / "text.ckpt", other)


def test_weights_and_their_card_are_read_back(tmp_path: Path) -> None:
    network, card = torch.nn.Linear(3, 2), {"steps": Schedule().steps, "errors": [0.5]}
    network.config = Schedule(steps=3)  # type: ignore[assignment]
    write_weights_file(network, tmp_path / "a.pt", card)
    again, read = read_weights_file(
        tmp_path / "a.pt", lambda config: torch.nn.Linear(3, 2 * (config["steps"] == 3)), "", ""
    )
    assert read == card and torch.equal(again.weight, network.weight)
