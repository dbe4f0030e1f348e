"""Weights of the networks of arms and hands on disk."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from bodysense.errors import BodysenseError
from bodysense.files import written_beside
from bodysense.models.arm_transformer import ArmNetwork, ArmNetworkConfig


def write_arms(network: ArmNetwork, path: Path, card: dict[str, Any]) -> None:
    """Weights, configuration and card (plain numbers and texts) in one file, whole or not at all."""
    with written_beside(path) as beside:
        torch.save({"config": asdict(network.config), "weights": network.state_dict(), "card": card}, beside)


def read_arms(path: Path) -> tuple[ArmNetwork, dict[str, Any]]:
    """The network and card of `write_arms`. Nothing is unpickled. Raises BodysenseError for other files."""
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file; train it with `bodysense train arms`")
    try:
        saved = torch.load(path, map_location="cpu", weights_only=True)
        network = ArmNetwork(ArmNetworkConfig(**saved["config"]))
        network.load_state_dict(saved["weights"])
    except BodysenseError:
        raise
    except Exception as error:  # PyTorch raises what it likes
        raise BodysenseError(
            f"{path}: not the weights of arms ({type(error).__name__}); give the .pt of `bodysense train arms`"
        ) from None
    return network.eval(), saved["card"]
