"""Weights of the networks of arms and hands on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bodysense.lab.pahmt.network import ArmNetwork, ArmNetworkConfig
from bodysense.lab.weights_file import read_weights_file, write_weights_file


def write_arms(network: ArmNetwork, path: Path, card: dict[str, Any]) -> None:
    """Weights, configuration and card (plain numbers and texts) in one file, whole or not at all."""
    write_weights_file(network, network.config, path, card)


def read_arms(path: Path) -> tuple[ArmNetwork, dict[str, Any]]:
    """The network and card of `write_arms`. Nothing is unpickled. Raises BodysenseError for other files."""
    return read_weights_file(
        path, lambda config: ArmNetwork(ArmNetworkConfig(**config)), "arms", "bodysense train arms"
    )
