"""Writing HMD-VAE's networks, each as one self-describing ONNX file: a step with the body in the world."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical
from bodysense_lab.core.export import export, store_as_int8
from bodysense_lab.papers.formats import BODY_VAE
from bodysense_lab.papers.hmd_vae.body_windows import Joints, frame_of, seen_from
from bodysense_lab.papers.hmd_vae.frames import RATE
from bodysense_lab.papers.hmd_vae.network import BodyVae

INPUTS = ("position", "rotation", "trust", "noise", "rest_offset")
OUTPUTS = ("root_position", "local_rotation", "joint_position")


class InWorld(nn.Module):
    """One body in the world, its head where the measured one is.

    z = trust · mean + (trust · deviation + 1 − trust) · noise: with numbers from N(0, I) as noise a sample, at trust 1
    of the posterior of the signal, at 0 of the prior; with zeros the mean.
    """

    def __init__(self, network: BodyVae) -> None:
        super().__init__()
        self.network = network
        self.head = network.config.reads.index("head")

    def forward(
        self, position: Tensor, rotation: Tensor, trust: Tensor, noise: Tensor, rest_offset: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """World joints (B, T, P, 3) m and (B, T, P, 4), trust (B, 1), noise (B, d), rest offsets (B, 22, 3) m.

        Returns root positions (B, 3), local rotations (B, 22, 4), the pelvis' of the world, and positions (B, 22, 3).
        """
        frame = frame_of("head", position[:, :, self.head], rotation[:, :, self.head])
        mean, log_variance = self.network.posterior(seen_from(frame, Joints(position, rotation)), rest_offset)
        deviation = trust * torch.exp(log_variance / 2) + (1 - trust)
        body = self.network.decode(trust * mean + deviation * noise, rest_offset)
        relative, local = body.facing(frame.facing)
        world = relative + position[:, -1, self.head, None]
        return world[:, 0], quaternion_canonical(local), world


def write_vae_onnx(network: BodyVae, path: Path, card: dict[str, Any]) -> None:
    """Export encoder and decoder with their card; large weights in bytes. The file appears whole or not.

    Raises BodysenseError for a network whose origin is the pelvis: no device tracks that.
    """
    config = network.config
    if config.origin != "head":
        raise BodysenseError(
            f"{path}: a network with origin {config.origin!r} needs to know where the {config.origin} is, which no "
            "headset does; keep it as .pt for the tables, or train with --origin head"
        )
    network = network.eval()
    shape = (1, config.frames, len(config.reads))
    upright = torch.tensor([1.0, 0.0, 0.0, 0.0])
    example = (
        torch.zeros(*shape, 3),
        upright.expand(*shape, 4).clone(),
        torch.ones(1, 1),
        torch.zeros(1, config.latent),
        torch.tensor(np.array(network.skeleton.rest_offset[None]), dtype=torch.float32),
    )
    known = {name: value for name, value in card.items() if name not in ("identity", "validation_position_cm")}
    if "validation_position_cm" in card:
        known["validation"] = {"position_cm": card["validation_position_cm"]}
    card = {
        "reads": config.reads,
        "frames": config.frames,
        "latent": config.latent,
        "rate": RATE,
        "network": asdict(config),
        "weights": sum(parameter.numel() for parameter in network.parameters()),
        **known,
    }
    export(InWorld(network), example, list(INPUTS), list(OUTPUTS), BODY_VAE.name, card, path, shrink=store_as_int8)
