"""Rotations of arms and hands from key-points: AHMT, PAHMT and the CNN beside them (Liu et al., CVPR Workshops 2022).

A window of 32 frames of `ArmKeypoints` goes in, local rotations of the 38 `ARM_JOINTS` come out, for every frame. The
features are made inside (`features.py`), so that training, the exported file and the run time share them.

Where the paper is silent: kernels of three frames; four layers over time, two over joints; the regression token's 64
numbers go through one linear layer to the width of the features to which they are added.

`more_inputs` is ours: the arms in the camera's axes too, the torso's turn, where hands are and how large, and what was
found. A hand's picture alone does not tell how its wrist is bent while the person may stand in any way to the camera.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from bodysense.body.arms import arm_rotations
from bodysense.body.pose import standing_pose
from bodysense.body.rotation import (
    matrix_to_quaternion,
    matrix_to_sixd,
    quaternion_exp,
    quaternion_log,
    quaternion_to_matrix,
    sixd_to_matrix,
)
from bodysense.body.skeleton import default_skeleton
from bodysense.lab.checkpoint import read_weights_file, write_weights_file
from bodysense.lab.pahmt.directions import beside_directions, beside_palms, hinged
from bodysense.lab.pahmt.features import SeenWindow, Window, more_points, seen_in
from bodysense.lab.pahmt.options import ArmNetworkConfig

_LARGEST = 0.02  # deviation of learned places and tokens at the start


class Attention(nn.Module):
    """Self-attention and two layers, each behind a layer norm and around a shortcut (eqs. 5, 6)."""

    def __init__(self, width: int, heads: int, feed_forward: int, dropout: float) -> None:
        super().__init__()
        self.heads = heads
        self.before, self.between = nn.LayerNorm(width), nn.LayerNorm(width)
        self.ask, self.look, self.tell = nn.Linear(width, width), nn.Linear(width, 2 * width), nn.Linear(width, width)
        self.forth, self.back = nn.Linear(width, feed_forward * width), nn.Linear(feed_forward * width, width)
        self.drop = nn.Dropout(dropout)

    def forward(self, x: Tensor, answers: int | None = None) -> Tensor:
        """(N, tokens, width) → the same, or only what the first `answers` tokens become."""
        read = self.before(x)
        queries = self.ask(read[:, :answers]).unflatten(-1, (self.heads, -1)).transpose(1, 2)
        keys, values = self.look(read).unflatten(-1, (2, self.heads, -1)).permute(2, 0, 3, 1, 4)
        # Spelled out: on a processor, twice as fast as the fused form where tokens are few.
        alike = (queries * queries.shape[-1] ** -0.5) @ keys.mT
        told = torch.softmax(alike, dim=-1) @ values
        x = x[:, :answers] + self.drop(self.tell(told.transpose(1, 2).flatten(-2)))
        return x + self.drop(self.back(torch.relu(self.forth(self.between(x)))))


class ArmsOverTime(nn.Module):
    """AHMT's body: two convolutions embed a frame, learned places, attention over the frames (eqs. 4 to 6)."""

    def __init__(self, config: ArmNetworkConfig) -> None:
        super().__init__()
        width = config.width
        self.embed = nn.Sequential(
            nn.Conv1d(3 * config.tokens, width, 3, padding=1), nn.ReLU(), nn.Conv1d(width, width, 3, padding=1)
        )
        self.place = nn.Parameter(_LARGEST * torch.randn(config.frames, width))
        layer = (width, config.heads, config.feed_forward, config.dropout)
        self.layers = nn.Sequential(*(Attention(*layer) for _ in range(config.layers)))

    def forward(self, points: Tensor) -> Tensor:
        """Points (B, T, N, 3) → features (B, T, width)."""
        return self.layers(self.embed(points.flatten(-2).mT).mT + self.place)


class OverJoints(nn.Module):
    """PAHMT's second branch: every point of a frame is a token; one more becomes the answer (eqs. 8 to 11)."""

    def __init__(self, config: ArmNetworkConfig) -> None:
        super().__init__()
        width = config.spatial_width
        self.embed = nn.Linear(3, width)
        self.regress = nn.Parameter(_LARGEST * torch.randn(1, width))
        self.place = nn.Parameter(_LARGEST * torch.randn(1 + config.tokens, width))
        layer = (width, config.spatial_heads, config.feed_forward, config.dropout)
        self.layers = nn.ModuleList(Attention(*layer) for _ in range(config.spatial_layers))
        self.widen = nn.Linear(width, config.width)

    def forward(self, points: Tensor) -> Tensor:
        """Points (B, T, N, 3) → features (B, T, width)."""
        tokens = self.embed(points.flatten(0, 1))
        first = self.regress.expand(len(tokens), 1, -1)
        x = torch.cat([first, tokens], dim=1) + self.place
        for left, layer in enumerate(self.layers, start=1 - len(self.layers)):
            x = layer(x, None if left else 1)
        return self.widen(x[:, 0].unflatten(0, points.shape[:2]))


class Convolutions(nn.Module):
    """The CNN: temporal convolutions with shortcuts, as in Body2Hands (Ng et al. 2021), there of width 256.

    Frames are halved four times and doubled again; what comes up is added to what went down.
    """

    def __init__(self, config: ArmNetworkConfig) -> None:
        super().__init__()
        width = config.width

        def step(before: int, stride: int = 1) -> nn.Sequential:
            convolution = nn.Conv1d(before, width, 3 if stride == 1 else 4, stride, 1)
            return nn.Sequential(nn.Dropout(config.dropout), convolution, nn.LeakyReLU(0.2), nn.BatchNorm1d(width))

        self.begin = step(3 * config.tokens)
        self.down = nn.ModuleList(nn.Sequential(step(width), step(width, 2)) for _ in range(4))
        self.across = nn.ModuleList(step(width) for _ in range(4))

    def forward(self, points: Tensor) -> Tensor:
        """Points (B, T, N, 3) → features (B, T, width)."""
        x = self.begin(points.flatten(-2).mT)
        passed = []
        for down in self.down:
            passed.append(x)
            x = down(x)
        for across, above in zip(self.across, reversed(passed), strict=True):
            x = across(interpolate(x, scale_factor=2.0, mode="nearest") + above)
        return x.mT


class ArmNetwork(nn.Module):
    """Features, body by `kind`, and the regression head of three convolutions (eqs. 7, 12)."""

    def __init__(self, config: ArmNetworkConfig) -> None:
        super().__init__()
        self.config = config
        width = config.width
        self.body = Convolutions(config) if config.kind == "cnn" else ArmsOverTime(config)
        self.beside = OverJoints(config) if config.kind == "pahmt" else None
        last = nn.Conv1d(width, config.size * len(config.joints) + config.shares, 3, padding=1)
        with torch.no_grad():  # it starts near arms that hang
            standing = arm_rotations(standing_pose(default_skeleton()))[list(config.joints)]
            last.weight.mul_(0.1)
            assert last.bias is not None
            last.bias.zero_()
            standing = self.regressed(torch.tensor(standing, dtype=torch.float32)).flatten()
            last.bias[config.shares :] = standing
        self.head = nn.Sequential(
            *(nn.Conv1d(width, width, 3, padding=1), nn.ReLU()),
            *(nn.Conv1d(width, width, 3, padding=1), nn.ReLU()),
            last,
        )

    def forward(self, window: Window) -> Tensor:
        """Rotations (B, T, joints, 3 or 6) as they are regressed; `quaternions` says what they mean."""
        seen = seen_in(window)
        points = self._read(window, seen)
        features = self.body(points)
        if self.beside is not None:
            features = features + self.beside(points)
        said = self.head(features.mT).mT.float()
        shares, said = said[..., : self.config.shares], said[..., self.config.shares :]
        said = said.unflatten(-1, (len(self.config.joints), self.config.size))
        if self.config.from_directions:
            gate = torch.sigmoid(shares[..., :4]).unflatten(-1, (2, 2))
            said = beside_directions(said, gate, hinged(seen.directions))
        if self.config.from_palms:
            share = torch.softmax(shares[..., 4:].unflatten(-1, (2, 3)), dim=-1)
            said = beside_palms(said, share, seen.palms)
        return said

    def quaternions(self, said: Tensor) -> Tensor:
        """Unit quaternions (..., 4) of regressed rotations."""
        if self.config.rotation == "axis-angle":
            return quaternion_exp(said)
        return matrix_to_quaternion(sixd_to_matrix(said))

    def regressed(self, rotation: Tensor) -> Tensor:
        """Rotations (..., 4) as they are regressed, (..., 3 or 6)."""
        if self.config.rotation == "axis-angle":
            return quaternion_log(rotation)
        return matrix_to_sixd(quaternion_to_matrix(rotation))

    def points(self, window: Window) -> Tensor:
        """What the network reads, (B, T, tokens, 3)."""
        return self._read(window, seen_in(window))

    def _read(self, window: Window, seen: SeenWindow) -> Tensor:
        hands = torch.cat([seen.shape, torch.zeros_like(seen.shape[..., :1])], dim=-1).flatten(-3, -2)
        if self.config.input == "hands":
            return hands
        read = [seen.directions.flatten(-3, -2), hands]
        if self.config.more_inputs:
            read.append(more_points(window, seen))
        if self.config.from_palms:
            axes = quaternion_to_matrix(seen.palms)[..., :, :2].mT  # where a wrist's +x and +y point
            read.append(axes.reshape(*axes.shape[:2], -1, 3))
        return torch.cat(read, dim=-2)


def write_arms(network: ArmNetwork, path: Path, card: dict[str, Any]) -> None:
    """Weights, configuration and card (plain numbers and texts) in one file, whole or not at all."""
    write_weights_file(network, network.config, path, card)


def read_arms(path: Path) -> tuple[ArmNetwork, dict[str, Any]]:
    """The network and card of `write_arms`. Nothing is unpickled. Raises BodysenseError for other files."""
    return read_weights_file(
        path, lambda config: ArmNetwork(ArmNetworkConfig(**config)), "arms", "bodysense train arms"
    )
