"""Rotations of arms and hands from key-points: AHMT, PAHMT and the compared CNN (Liu et al., CVPR Workshops 2022).

A window of 32 frames of `ArmKeypoints` goes in, local rotations of the 38 `ARM_JOINTS` come out, for every frame. The
features are made inside (`features.py`), so that training, the exported file and the run time share them.

Where the paper is silent: kernels of three frames; four layers over time, two over joints; the regression token's 64
numbers go through one linear layer to the width of the features to which they are added.

`more_inputs` is ours: the arms in the camera's axes too, the torso's turn, where hands are and how large, and what was
found. A hand's picture alone does not tell how its wrist is bent while the person may stand in any way to the camera.

Arms turned as their directions say, in closed form: what a network may take for an answer where it trusts them.

Two directions give all of an arm but what lies between its bones' axes: the plane of a bent elbow tells how the upper
arm is turned about itself. What they leave open, the twist of a straight arm and of the hand, collars, and what a
detector errs, is a network's to answer.
"""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

from bodysense.body.arms import SIDES, arm_rotations, arm_skeleton
from bodysense.body.pose import standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import (
    cross,
    dot,
    matrix_to_quaternion,
    matrix_to_sixd,
    normalize,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
    quaternion_to_matrix,
    shortest_arc,
    sixd_to_matrix,
)
from bodysense_lab.core.checkpoint import read_weights_file
from bodysense_lab.papers.pahmt.features import SeenWindow, Window, more_points, seen_in
from bodysense_lab.papers.pahmt.options import ArmNetworkConfig

_HINGE = ((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))  # of left and right: about it a straight elbow bends forward
_STRAIGHT = 0.3  # sine of the bend at which the plane of the arm counts as much as the way from rest
_BONES = slice(1, 3)  # upper arm and forearm among the joints of an arm: collar, they, wrist, fingers


def hinged(directions: Tensor) -> Tensor:
    """Turns (..., 2, 2, 4), torso ← bone, of left and right upper arm and forearm from their directions (..., 2, 2, 3).

    Directions are unit vectors in the torso's axes. An unknown one has length zero: such an arm hangs.
    """
    down = torch.zeros_like(directions)
    down[..., 1] = -1.0
    known = dot(directions, directions) > 0.5
    directions = torch.where(known, directions, down)
    bone = normalize(torch.tensor(_bones(), dtype=directions.dtype)).expand_as(directions)
    hinge = torch.tensor(_HINGE, dtype=directions.dtype)
    upper, forearm = directions[..., 0, :], directions[..., 1, :]
    swung = quaternion_rotate(shortest_arc(bone[..., 0, :], upper), hinge.expand_as(upper))
    axis = (cross(upper, forearm) + _STRAIGHT * swung)[..., None, :].expand_as(directions)
    now, rest = (_frame(*pair) for pair in ((directions, axis), (bone, hinge[:, None].expand_as(bone))))
    return quaternion_multiply(now, quaternion_conjugate(rest))


def blend_directions(predicted: Tensor, gate: Tensor, bones: Tensor) -> Tensor:
    """Blend the upper arms and forearms of regressed rotations (..., 38, 6) with those that directions imply.

    `gate` (..., 2, 2) is the share of the directions for the left and right upper arm and forearm. `bones` are the
    rotations that `hinged` returns.
    """
    arms = predicted.unflatten(-2, (len(SIDES), -1))
    collar = matrix_to_quaternion(sixd_to_matrix(arms[..., :1, :]))
    above = torch.cat([collar, bones[..., :1, :]], dim=-2)
    given = matrix_to_sixd(quaternion_to_matrix(quaternion_multiply(quaternion_conjugate(above), bones)))
    share = gate[..., None]
    between = share * given + (1 - share) * arms[..., _BONES, :]
    return torch.cat([arms[..., :1, :], between, arms[..., _BONES.stop :, :]], dim=-2).flatten(-3, -2)


def blend_palms(predicted: Tensor, share: Tensor, palms: Tensor) -> Tensor:
    """Blend the wrists of regressed rotations (..., 38, 6) with those that the pictures of palms imply.

    `share` (..., 2, 3) holds, for the left and right hand, the weights of the regressed wrist and of both solutions
    of the palm. `palms` (..., 2, 2, 4) are the rotations torso ← wrist that `palm.palm_turns` returns.
    """
    arms = predicted.unflatten(-2, (len(SIDES), -1))
    collar, upper, lower = matrix_to_quaternion(sixd_to_matrix(arms[..., : _BONES.stop, :])).unbind(dim=-2)
    forearm = quaternion_multiply(quaternion_multiply(collar, upper), lower)
    above = quaternion_conjugate(forearm)[..., None, :].expand(palms.shape)
    given = matrix_to_sixd(quaternion_to_matrix(quaternion_multiply(above, palms)))
    wrist, fingers = arms[..., _BONES.stop, None, :], arms[..., _BONES.stop + 1 :, :]
    between = (share[..., None] * torch.cat([wrist, given], dim=-2)).sum(dim=-2, keepdim=True)
    return torch.cat([arms[..., : _BONES.stop, :], between, fingers], dim=-2).flatten(-3, -2)


@lru_cache(maxsize=1)
def _bones() -> np.ndarray:
    """Upper arms and forearms (2, 2, 3) of the default body at rest, m."""
    skeleton = arm_skeleton(default_skeleton())
    ends = [[f"{side}_{end}" for end in ("elbow", "wrist")] for side in SIDES]
    return skeleton.rest_offset[[skeleton.indices(two) for two in ends]]


def _frame(along: Tensor, axis: Tensor) -> Tensor:
    """Turns (..., 4) of frames whose x is `along` and whose y is as near to `axis` as it can."""
    y = normalize(axis - dot(axis, along) * along)
    return matrix_to_quaternion(torch.stack([along, y, cross(along, y)], dim=-1))


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
        attended = torch.softmax(alike, dim=-1) @ values
        x = x[:, :answers] + self.drop(self.tell(attended.transpose(1, 2).flatten(-2)))
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

    Frames are halved four times and doubled again, with shortcuts between equal sizes.
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
        """Regress rotations (B, T, joints, 3 or 6); `quaternions` converts them."""
        seen = seen_in(window)
        points = self._read(window, seen)
        features = self.body(points)
        if self.beside is not None:
            features = features + self.beside(points)
        predicted = self.head(features.mT).mT.float()
        shares, predicted = predicted[..., : self.config.shares], predicted[..., self.config.shares :]
        predicted = predicted.unflatten(-1, (len(self.config.joints), self.config.size))
        if self.config.from_directions:
            gate = torch.sigmoid(shares[..., :4]).unflatten(-1, (2, 2))
            predicted = blend_directions(predicted, gate, hinged(seen.directions))
        if self.config.from_palms:
            share = torch.softmax(shares[..., 4:].unflatten(-1, (2, 3)), dim=-1)
            predicted = blend_palms(predicted, share, seen.palms)
        return predicted

    def quaternions(self, predicted: Tensor) -> Tensor:
        """Unit quaternions (..., 4) of regressed rotations."""
        if self.config.rotation == "axis-angle":
            return quaternion_exp(predicted)
        return matrix_to_quaternion(sixd_to_matrix(predicted))

    def regressed(self, rotation: Tensor) -> Tensor:
        """Convert rotations (..., 4) to the regressed form (..., 3 or 6)."""
        if self.config.rotation == "axis-angle":
            return quaternion_log(rotation)
        return matrix_to_sixd(quaternion_to_matrix(rotation))

    def points(self, window: Window) -> Tensor:
        """Return the points that the network reads, (B, T, tokens, 3)."""
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


def read_arms(path: Path) -> tuple[ArmNetwork, dict[str, Any]]:
    """The network and card of a weights file. Nothing is unpickled. Raises BodysenseError for other files."""
    return read_weights_file(
        path, lambda config: ArmNetwork(ArmNetworkConfig(**config)), "arms", "bodysense train arms"
    )
