"""Writing UNOC's networks, each as one self-describing ONNX file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense_lab.core.export import export
from bodysense_lab.papers.formats import BODY, POINTS, PointNetworkTask
from bodysense_lab.papers.unoc.network.network import BodyNetwork, PredictorState, TrackedBody
from bodysense_lab.papers.unoc.network.point_network import PointNetwork, TrackedPoints
from bodysense_lab.papers.unoc.sequences.body_sequences import RATE


class _BodyStep(nn.Module):
    """The network with its state spelled out as separate inputs and outputs."""

    def __init__(self, model: BodyNetwork) -> None:
        super().__init__()
        self.model = model

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        count = len(TrackedBody._fields)
        completed, state = self.model(TrackedBody(*values[:count]), PredictorState(*values[count:]))
        return (*completed, *state)


def write_onnx(model: BodyNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export one streaming step of `model` with its metadata; large weights in half precision.

    `card` holds what a user should know: training data, licence, test figures, and `fastest_rate`, Hz, where the
    network was taught to step faster than at `RATE`. The file appears whole or not at all.
    """
    model = model.eval()
    points = len(model.skeleton.points)
    state = model.start(1)
    tracked = TrackedBody(
        position=torch.zeros(1, 1, points, 3),
        visible=torch.ones(1, 1, points, dtype=torch.bool),
        head_position=torch.zeros(1, 1, 3),
        head_rotation=torch.tensor([[[1.0, 0, 0, 0]]]),
        interval=torch.full((1, 1), 1 / RATE),
        bone_length=model.typical_bone[None],
        height=torch.tensor([1.7]),
    )
    inputs = [*TrackedBody._fields, *(f"state_{name}" for name in PredictorState._fields)]
    outputs = ["completed", "occluded", "error", *(f"next_{name}" for name in PredictorState._fields)]
    start = {
        f"state_{name}": {"shape": list(value.shape), "dtype": str(value.numpy().dtype)}
        | ({"values": np.round(value.flatten().numpy().astype(float), 5).tolist()} if value.any() else {})
        for name, value in zip(PredictorState._fields, state, strict=True)
    }
    card = {
        "points": model.skeleton.points,
        "rate": RATE,
        "fastest_rate": RATE,
        "state": start,
        "network": vars(model.config),
        "weights": sum(parameter.numel() for parameter in model.parameters()),
        **card,
    }
    export(_BodyStep(model), (*tracked, *state), inputs, outputs, BODY.name, card, path)


class _PointStep(nn.Module):
    """The network with its inputs spelled out."""

    def __init__(self, network: PointNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *values: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.network(TrackedPoints(*values[:-1]), values[-1])


def write_point_network(network: PointNetwork, path: Path, task: PointNetworkTask, card: dict[str, Any]) -> None:
    """Export one streaming step with its metadata; large weights in half precision. Whole or not at all."""
    network = network.eval()
    skeleton, config = network.skeleton, network.config
    memory = network.start(1)
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
    tracked = TrackedPoints(
        position=torch.zeros(1, 1, len(config.reads), 3),
        rotation=upright.expand(1, 1, len(THREE_POINTS), 4).clone(),
        rest=torch.zeros(1, len(config.places), 3),
        bone_length=torch.tensor(skeleton.bone_length[None], dtype=torch.float32),
        height=torch.tensor([skeleton.extent], dtype=torch.float32),
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
    inputs, outputs = [*TrackedPoints._fields, "state_memory"], ["placed", "error", "next_memory"]
    export(_PointStep(network), (*tracked, memory), inputs, outputs, POINTS[task].name, card, path)
