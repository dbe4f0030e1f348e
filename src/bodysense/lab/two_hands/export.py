"""Writing the networks of a glove, each as one self-describing ONNX file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from bodysense.body.glove import MARKERS
from bodysense.body.hand import FREEDOMS
from bodysense.devices.gloves.networks import JOINT_FORMAT, MARKER_FORMAT
from bodysense.lab.export import export
from bodysense.lab.two_hands.network import MARKER_VALUES, SHAPE_VALUES, JointNetwork, MarkerNetwork
from bodysense.lab.two_hands.variants import MEMORY_FORMAT, TWO_HANDS_FORMAT


class _Folded(nn.Module):
    """A network with its scales in its first and last layer."""

    def __init__(self, network: MarkerNetwork | JointNetwork) -> None:
        super().__init__()
        self.network = network
        self.layers = network.folded()

    def forward(self, markers: Tensor, hand: Tensor, other: Tensor | None = None) -> Tensor:
        beside = () if other is None else (other,)
        return self.layers(self.network.raw(markers, hand, *beside))


class _OneStep(nn.Module):
    """A network with memory as one frame of it."""

    def __init__(self, network: MarkerNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, markers: Tensor, hand: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        filled, memory = self.network.step(markers[:, None], hand[:, None], memory)
        return filled[:, 0], memory


def write_glove_network(network: MarkerNetwork | JointNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export a network for any number of hands at once, with its metadata. The file appears whole or not at all.

    Its inputs are `markers` (H, 27) m, registered and at the default hand's size, `hand` (H, 87) m, and, where it reads
    them, `other` (H, 27) or `state_memory` (H, M); its outputs `filled` (H, 27) m, with `next_memory`, or `angles`
    (H, 26) rad.
    """
    network = network.eval()
    inputs, outputs, format = ["markers", "hand"], ["filled"], MARKER_FORMAT
    example = [torch.full((2, MARKER_VALUES), 0.01), torch.full((2, SHAPE_VALUES), 0.03)]
    step: nn.Module
    if isinstance(network, JointNetwork):
        step, outputs, format = _Folded(network), ["angles"], JOINT_FORMAT
        card = {"angles": [f"{row.joint} {row.angle}" for row in FREEDOMS], **card}
    elif network.config.memory:
        inputs, outputs, format = [*inputs, "state_memory"], [*outputs, "next_memory"], MEMORY_FORMAT
        example.append(network.start(2))
        step, card = _OneStep(network), {"memory": network.config.memory, **card}
    else:
        step = _Folded(network)
        if network.config.reads_other:
            inputs, format = [*inputs, "other"], TWO_HANDS_FORMAT
            example.append(torch.full((2, MARKER_VALUES), 0.01))
    card = {
        "markers": MARKERS,
        "network": asdict(network.config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **card,
    }
    hands = torch.export.Dim("hands", min=1)
    export(step, tuple(example), inputs, outputs, format, card, path, tuple({0: hands} for _ in example))
