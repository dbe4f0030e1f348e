"""Writing the three-point network as one self-describing ONNX file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.estimators.three_point_answers import FORMAT
from bodysense.models.three_point_network import CONTACT, Completed, State, ThreePointNetwork, Tracked
from bodysense.training.onnx_writing import export

MOST_WEARERS = 4096  # at a time
FASTEST_RATE = 45.0  # Hz: where frames come faster, the run time goes on from an earlier one


class _OneStep(nn.Module):
    """The network with its state spelled out as separate inputs and outputs."""

    def __init__(self, network: ThreePointNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        count = len(Tracked._fields)
        completed, state = self.network(Tracked(*values[:count]), State(*values[count:]))
        return (*completed, *state)


def write_three_point(network: ThreePointNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export one streaming step with its metadata; large weights in half precision. The file appears whole or not.

    It takes any number of wearers at a time. `card` holds what a user should know: training data, licence, figures.
    """
    network = network.cpu().eval()
    skeleton, start = default_skeleton(), network.start(1)
    example = 3  # wearers: a number that stands for any must not be one that means something
    tracked = Tracked(
        position=torch.zeros(example, 1, 3, 3),
        rotation=torch.tensor([1.0, 0.0, 0.0, 0.0]).expand(example, 1, 3, 4).clone(),
        has_position=torch.ones(example, 1, 2, dtype=torch.bool),
        has_rotation=torch.ones(example, 1, 2, dtype=torch.bool),
        interval=torch.full((example, 1), 1 / FASTEST_RATE),
        rest_offset=torch.tensor(skeleton.rest_offset[skeleton.indices(BODY)], dtype=torch.float32).expand(
            example, -1, -1
        ),
        height=torch.full((example,), skeleton.height),
    )
    card = {
        "joints": BODY,
        "contact": CONTACT,
        "fastest_rate": FASTEST_RATE,
        "state": {
            name: {"shape": list(value.shape), "dtype": str(value.numpy().dtype)}
            | ({"values": np.round(value.flatten().numpy().astype(float), 6).tolist()} if value.any() else {})
            for name, value in zip(State._fields, start, strict=True)
        },
        "network": asdict(network.config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **card,
    }
    inputs = [*Tracked._fields, *(f"state_{name}" for name in State._fields)]
    outputs = [f"body_{name}" for name in Completed._fields] + [f"next_{name}" for name in State._fields]
    wearers = torch.export.Dim("batch", min=1, max=MOST_WEARERS)
    step, values = _OneStep(network), (*tracked, *network.start(example))
    axes = (tuple({0: wearers} for _ in inputs),)
    export(step, values, inputs, outputs, FORMAT, card, path, axes)
