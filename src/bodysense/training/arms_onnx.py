"""Writing a network of arms and hands as one self-describing ONNX file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from bodysense.body.arms import ARM_JOINTS
from bodysense.body.rotation import quaternion_canonical
from bodysense.errors import BodysenseError
from bodysense.estimators.arms import FORMAT
from bodysense.models.arm_transformer import ArmNetwork, Window
from bodysense.models.arm_windows import RATE
from bodysense.training.onnx_writing import export


class OneWindow(nn.Module):
    """Key-points of one window, as they are captured, to local rotations (B, T, 38, 4) of `ARM_JOINTS`."""

    def __init__(self, network: ArmNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *values: Tensor) -> Tensor:
        """The fields of `Window`, in order."""
        return quaternion_canonical(self.network.quaternions(self.network(Window(*values))))


def write_arms_onnx(network: ArmNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export the network with its card; large weights in half precision. The file appears whole or not.

    Raises BodysenseError for a network of hands alone: it has no arms to give.
    """
    config = network.config
    if config.input == "hands":
        raise BodysenseError(f"{path}: a network of hands alone is not for video; keep it as .pt, for the table")
    frames = config.frames
    example = Window(
        arm=torch.zeros(1, frames, 2, 2, 3),
        has_arm=torch.ones(1, frames, 2, dtype=torch.bool),
        torso=torch.tensor([1.0, 0, 0, 0]).expand(1, frames, 4).clone(),
        has_torso=torch.ones(1, frames, dtype=torch.bool),
        hand=torch.zeros(1, frames, 2, 21, 2),
        has_hand=torch.ones(1, frames, 2, dtype=torch.bool),
    )
    card = {
        "joints": ARM_JOINTS,
        "frames": frames,
        "rate": RATE,
        "network": asdict(config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **{name: value for name, value in card.items() if name != "identity"},
    }
    export(OneWindow(network.eval()), example, list(Window._fields), ["rotation"], FORMAT, card, path)
