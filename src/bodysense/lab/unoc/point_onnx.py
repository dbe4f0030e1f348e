"""Writing a network that places points as one self-describing ONNX file, and its card."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from bodysense.lab.export import export
from bodysense.lab.unoc.episodes import RATE
from bodysense.lab.unoc.point_model import FORMAT, Task
from bodysense.lab.unoc.point_network import PointNetwork, Tracked
from bodysense.occlusion.three_point import POINTS


class _OneStep(nn.Module):
    """The network with its inputs spelled out."""

    def __init__(self, network: PointNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.network(Tracked(*values[:-1]), values[-1])


def write_point_network(network: PointNetwork, path: Path, task: Task, card: dict[str, Any]) -> None:
    """Export one streaming step with its metadata; large weights in half precision. Whole or not at all."""
    network = network.eval()
    skeleton, config = network.skeleton, network.config
    memory = network.start(1)
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
    tracked = Tracked(
        position=torch.zeros(1, 1, len(config.reads), 3),
        rotation=upright.expand(1, 1, len(POINTS), 4).clone(),
        rest=torch.zeros(1, len(config.places), 3),
        bone_length=torch.tensor(skeleton.bone_length[None], dtype=torch.float32),
        height=torch.tensor([skeleton.height], dtype=torch.float32),
    )
    card = {
        "task": task,
        "reads": config.reads,
        "places": config.places,
        "points": len(skeleton.points),
        "rate": RATE,
        "state": {"shape": list(memory.shape), "dtype": str(memory.numpy().dtype)},
        "network": asdict(config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **card,
    }
    inputs, outputs = [*Tracked._fields, "state_memory"], ["placed", "error", "next_memory"]
    export(_OneStep(network), (*tracked, memory), inputs, outputs, FORMAT, card, path)
