"""HMD-VAE: a whole body's pose from one headset and two hands by a variational autoencoder (Dittadi et al., ICCV 2021).

The likelihood (eqs. 4, 5, appendix A). A pose of a joint is P = (R, p) in SE(3). Give the Lie algebra, with elements
(w, v), the inner product |w|²/s₂² + |v|²/s₁², and move it to every P by left multiplication. The velocity of a path
P(t) seen from P is P⁻¹Ṗ = (RᵀṘ, Rᵀṗ), so its squared speed is |RᵀṘ|²/s₂² + |Rᵀṗ|²/s₁² = |RᵀṘ|²/s₂² + |ṗ|²/s₁²: the
rotation drops out of the second term because s₁²I is isotropic. The metric is that of the product SO(3) × R³; its
shortest paths are straight lines of p together with turns about one axis of R, of squared length

    d(A, B)² = |p_A − p_B|²/s₁² + angle(R_Aᵀ R_B)²/s₂².

It does not change when both poses are multiplied from the left by (Q, t): positions keep their distance and
(Q R_A)ᵀ Q R_B = R_Aᵀ R_B. Hence it is the same in any frame of the world. Multiplied from the right, the position in
the joint's own axes, Rᵀp, would move with the lever arm. −log p(x|z) is half the sum of d² over the 22 joints, up to a
constant: a Gaussian of p with deviation s₁ times a density of R that is nearly a Gaussian of its angle while s₂ ≪ π.

Where the origin is, and what that gives away, says `body_windows`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.body_joints import body_skeleton
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    geodesic_angle,
    matrix_to_quaternion,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
    sixd_to_matrix,
)
from bodysense_lab.core.checkpoint import read_weights_file
from bodysense_lab.papers.hmd_vae.body_windows import Joints
from bodysense_lab.papers.hmd_vae.options import BodyVaeConfig


class DecodedBody(NamedTuple):
    """A body in the axes of a window, its pelvis at the origin."""

    local: Tensor  # (..., 22, 4) wxyz, parent ← joint; the pelvis' is frame ← pelvis
    position: Tensor  # (..., 22, 3) m
    rotation: Tensor  # (..., 22, 4) wxyz, frame ← joint

    def facing(self, turn: Tensor) -> tuple[Tensor, Tensor]:
        """Positions from the head (B, 22, 3) m and local rotations (B, 22, 4) in the axes of the world.

        `turn` (B, 4) is world ← frame.
        """
        turn = turn[:, None]
        relative = self.position - self.position[:, BODY.index("head"), None]
        turned = quaternion_rotate(turn.expand(*relative.shape[:-1], 4), relative)
        return turned, torch.cat([quaternion_multiply(turn, self.local[:, :1]), self.local[:, 1:]], dim=1)


class Residual(nn.Module):
    """x + gate · second(relu(first(norm(x)))): pre-norm (Ba 2016), a gate that starts shut (ReZero, Bachlechner 2020).

    With `stride` 2, where `first` gives half of the frames, x is every second frame of (B, L, C), the last among them.
    """

    def __init__(self, first: nn.Module, second: nn.Module, width: int, stride: int = 1) -> None:
        super().__init__()
        self.norm, self.first, self.second, self.stride = nn.LayerNorm(width), first, second, stride
        self.gate = nn.Parameter(torch.zeros(()))

    def forward(self, x: Tensor) -> Tensor:
        """(B, L, C) or (B, C) → the same, or half of the frames."""
        kept = x if self.stride == 1 else x[:, self.stride - 1 :: self.stride]
        return kept + self.gate * self.second(torch.relu(self.first(self.norm(x))))


class OverTime(nn.Module):
    """A 1-D convolution over frames (B, L, C) whose input has one channel more: the place, −1 to 1 (Liu et al. 2018).

    With `stride` 2 it answers at every second frame, the last among them.
    """

    def __init__(self, width: int, stride: int = 1) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width + 1, width, 3, stride)
        self.before = 1 if stride == 1 else 0  # frames of zeros

    def forward(self, x: Tensor) -> Tensor:
        """(B, L, C) → (B, L / stride, C)."""
        place = torch.linspace(-1, 1, x.shape[1], dtype=x.dtype, device=x.device)[None, :, None]
        located = torch.cat([x, place.expand(x.shape[0], -1, 1)], dim=-1).transpose(1, 2)
        return self.convolution(nn.functional.pad(located, (self.before, 1))).transpose(1, 2)


def linear_block(width: int) -> Residual:
    """A residual block of two linear layers."""
    return Residual(nn.Linear(width, width), nn.Linear(width, width), width)


class Encoder(nn.Module):
    """Joints of one frame, or of `length` frames, to the mean and log variance of z (section 5.2).

    Each frame passes one linear layer. All blocks but the last are convolutions over time, which halve
    the frames while more than four remain; the last block reads these as one vector.
    """

    def __init__(self, config: BodyVaeConfig) -> None:
        super().__init__()
        count, width, frames = 12 * len(config.reads), config.sequence_width, config.frames
        if frames == 1:
            layers: list[nn.Module] = [nn.Flatten(1), nn.Linear(count, config.width)]
            layers += [linear_block(config.width) for _ in range(config.blocks)]
        else:
            layers = [nn.Linear(count, width)]
            for _ in range(config.blocks - 1):
                stride = 2 if frames > 4 and frames % 2 == 0 else 1
                layers.append(Residual(OverTime(width, stride), OverTime(width), width, stride))
                frames //= stride
            layers += [nn.Flatten(1), nn.Linear(width * frames, config.width), linear_block(config.width)]
        self.layers = nn.Sequential(*layers, nn.Linear(config.width, 2 * config.latent))

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Features (B, T, 12 P) → mean and log variance (B, d)."""
        mean, log_variance = self.layers(features).chunk(2, dim=-1)
        return mean, log_variance.clamp(-16.0, 8.0)


class Decoder(nn.Module):
    """z (..., d) → 256 → residual blocks → 22 local rotations as 6-D → Gram-Schmidt → quaternions (..., 22, 4)."""

    def __init__(self, config: BodyVaeConfig) -> None:
        super().__init__()
        blocks = [linear_block(config.width) for _ in range(config.blocks)]
        last = nn.Linear(config.width, 6 * len(BODY))
        with torch.no_grad():  # it starts at the rest pose, not at directions near zero
            last.bias.copy_(torch.tensor([1.0, 0, 0, 0, 1, 0]).repeat(len(BODY)))
        self.layers = nn.Sequential(nn.Linear(config.latent, config.width), *blocks, last)

    def forward(self, z: Tensor) -> Tensor:
        """z (..., d) → local rotations (..., 22, 4)."""
        return matrix_to_quaternion(sixd_to_matrix(self.layers(z).unflatten(-1, (len(BODY), 6))))


class BodyVae(nn.Module):
    """Encoder and decoder. The skeleton is an argument, `rest_offset` (B, 22, 3) m: a taller user is a taller skeleton.

    Inputs of the encoder are scaled to one stature, so that the result scales with the body.
    """

    stature: Tensor

    def __init__(self, config: BodyVaeConfig) -> None:
        super().__init__()
        self.config = config
        self.skeleton = body_skeleton(default_skeleton())
        self.encoder, self.decoder = Encoder(config), Decoder(config)
        self.anchor = BODY.index(config.origin)
        offset = torch.tensor(np.array(self.skeleton.rest_offset), dtype=torch.float32)
        self.register_buffer("stature", self.height(offset), persistent=False)

    def height(self, rest_offset: Tensor) -> Tensor:
        """Height of the head over the feet in the rest pose, m: (..., 22, 3) → (...,)."""
        path = torch.tensor(self.skeleton.path, dtype=rest_offset.dtype, device=rest_offset.device)
        up = path @ rest_offset[..., 1:2]
        head, left, right = (BODY.index(name) for name in ("head", "left_foot", "right_foot"))
        return up[..., head, 0] - (up[..., left, 0] + up[..., right, 0]) / 2

    def features(self, seen: Joints, rest_offset: Tensor) -> Tensor:
        """(B, T, 12 P): position and rotation matrix of every joint, in the axes of the window."""
        position = seen.position * (self.stature / self.height(rest_offset))[:, None, None, None]
        return torch.cat([position, quaternion_to_matrix(seen.rotation).flatten(-2)], dim=-1).flatten(-2)

    def decode(self, z: Tensor, rest_offset: Tensor) -> DecodedBody:
        """The body of z (..., B, d) on rest offsets (B, 22, 3)."""
        local = self.decoder(z)
        root = torch.zeros_like(local[..., 0, :3])
        return DecodedBody(local, *forward_kinematics(Pose(self.skeleton, root, local), rest_offset))

    def posterior(self, seen: Joints, rest_offset: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log variance (B, d) of z, given joints (B, T, P) in the axes of the window."""
        return self.encoder(self.features(seen, rest_offset))

    def negative_elbo(
        self, seen: Joints, truth: Joints, rest_offset: Tensor, generator: torch.Generator | None = None
    ) -> dict[str, Tensor]:
        """The loss (eq. 7 with its sign turned) and its parts, means over the batch, in nats.

        `truth` holds the 22 joints (B, 22) of the last frame, in the axes of the window.
        """
        mean, log_variance = self.posterior(seen, rest_offset)
        shape = (self.config.samples, *mean.shape)
        noise = torch.randn(shape, dtype=mean.dtype, generator=generator).to(mean.device)
        body = self.decode(mean + torch.exp(log_variance / 2) * noise, rest_offset)
        apart = squared_distance(self.config, self.from_anchor(body.position), body.rotation, truth, self.anchor)
        likelihood = apart.sum(dim=-1).mean() / 2
        divergence = kl_divergence(mean, log_variance).mean()
        return {"loss": likelihood + self.config.beta * divergence, "likelihood": likelihood, "divergence": divergence}

    def from_anchor(self, position: Tensor) -> Tensor:
        """Positions (..., 22, 3) from the joint that the origin is at."""
        return position - position[..., self.anchor : self.anchor + 1, :]


def squared_distance(config: BodyVaeConfig, position: Tensor, rotation: Tensor, truth: Joints, anchor: int) -> Tensor:
    """d² of every joint, (..., B, 22): positions (..., B, 22, 3) from the anchor, rotations (..., B, 22, 4)."""
    wanted = truth.position - truth.position[..., anchor : anchor + 1, :]
    squared = ((position - wanted) ** 2).sum(dim=-1) / config.position_deviation**2
    return squared + (geodesic_angle(rotation, truth.rotation) / config.angle_deviation) ** 2


def kl_divergence(mean: Tensor, log_variance: Tensor) -> Tensor:
    """Return the divergence of N(mean, variance) from the prior N(0, I): (B, d) → (B,), nats."""
    return (mean**2 + torch.exp(log_variance) - 1 - log_variance).sum(dim=-1) / 2


def pretrained(config: BodyVaeConfig, whole: BodyVae) -> BodyVae:
    """A model 3 or 4 with the decoder of a trained model 0, which never moves.

    Raises BodysenseError where the decoder is of another setting.
    """
    if whole.config.model != 0:
        raise BodysenseError(f"the decoder is of model {whole.config.model}; give that of a trained model 0")
    for name in ("latent", "blocks", "width", "origin"):
        ours, theirs = getattr(config, name), getattr(whole.config, name)
        if ours != theirs:
            raise BodysenseError(f"the decoder has {name} {theirs}, not {ours}; train both with the same {name}")
    network = BodyVae(config)
    network.decoder.load_state_dict(whole.decoder.state_dict())
    network.decoder.requires_grad_(False)
    return network


def read_vae(path: Path) -> tuple[BodyVae, dict[str, Any]]:
    """The network and card of a weights file. Nothing is unpickled. Raises BodysenseError for other files."""
    return read_weights_file(
        path, lambda config: BodyVae(BodyVaeConfig(**config)), "a body VAE", "bodysense train hmd-vae"
    )
