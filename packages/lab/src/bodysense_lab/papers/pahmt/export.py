"""Writing PAHMT's networks, each as one self-describing ONNX file that answers a window and its mirror image."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from bodysense.body.arms import ARM_JOINTS
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import normalize, quaternion_canonical
from bodysense.weights.formats import ARMS
from bodysense_lab.core.export import export, store_as_int8
from bodysense_lab.papers.pahmt.features import Window
from bodysense_lab.papers.pahmt.network import ArmNetwork
from bodysense_lab.papers.pahmt.recordings import RATE

_MOST = 63  # of each sign: 7 bits change arms by 0.19° in the mean, and their error by nothing


class OneWindow(nn.Module):
    """Network from captured key-points of one window to local rotations (B, T, 38, 4) of `ARM_JOINTS`.

    Run the network on the window and on its mirror image, and average: both hands are predicted equally well.
    """

    def __init__(self, network: ArmNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, *values: Tensor) -> Tensor:
        """The fields of `Window`, in order."""
        window = Window(*values)
        both = Window(*(torch.cat(pair) for pair in zip(window, mirrored(window), strict=True)))
        predicted, reflected = self.network.quaternions(self.network(both)).chunk(2)
        reflected = mirrored_rotations(reflected)
        alike = torch.where((predicted * reflected).sum(dim=-1, keepdim=True) < 0, -reflected, reflected)
        return quaternion_canonical(normalize(predicted + alike))


def mirrored(window: Window) -> Window:
    """Mirror a window: swap left and right, and negate the picture's x."""
    flip = torch.tensor([-1.0, 1.0, 1.0])
    return Window(
        arm=window.arm.flip(2) * flip,
        has_arm=window.has_arm.flip(2),
        torso=window.torso * torch.tensor([1.0, 1.0, -1.0, -1.0]),
        has_torso=window.has_torso,
        hand=window.hand.flip(2) * flip[:2],
        has_hand=window.has_hand.flip(2),
    )


def mirrored_rotations(rotation: Tensor) -> Tensor:
    """Rotations (..., 38, 4) of `ARM_JOINTS` of the mirror image."""
    left, right = rotation.chunk(2, dim=-2)
    return torch.cat([right, left], dim=-2) * torch.tensor([1.0, 1.0, -1.0, -1.0])


def write_arms_onnx(network: ArmNetwork, path: Path, card: dict[str, Any]) -> None:
    """Export the network with its card; large weights in 7 bits. The file appears whole or not.

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
    export(
        OneWindow(network.eval()),
        example,
        list(Window._fields),
        ["rotation"],
        ARMS.name,
        card,
        path,
        shrink=partial(store_as_int8, most=_MOST),
    )
