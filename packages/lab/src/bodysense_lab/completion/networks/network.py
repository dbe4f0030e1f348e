"""Completion network: predicts rotations, contacts and expected errors from any points, for any proportions.

It reads 27 points (the 22 joints of `BODY`, head top, toe tips, and the middle of each hand's knuckles), each with a
position, a rotation, both or neither, and the known lengths of the wearer's bones. It works in the frame under the head
(x and z of the head, the floor at y = 0, turned by the head's heading) and at a reference stature, so its prediction is
independent of the body's place, heading and size. It predicts each joint's rotation relative to that frame, not to the
parent, so that errors do not add up along a chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import default_skeleton
from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense_lab.completion.data.points import (
    BODY_POINT_COUNT,
    CONTACT,
    HEAD_HEIGHT,
    JOINTS,
    bone_parents,
    path_from_head,
    reference_offsets,
)
from bodysense_lab.completion.networks.features import WIDTHS, TrackedSignal, features_of, mirror_indices, mirror_signs

SMALLEST_ERROR = 0.002  # m; no expected error is smaller
ERROR_BIAS = -3.0  # of the expected error, before softplus


@dataclass(frozen=True)
class CompletionConfig:
    """Size of the network."""

    hidden: int = 512
    layers: int = 2  # recurrent layers
    branch: int = 512  # units of the branch of rotations
    judge_branch: int = 128  # units of the branch of contact and expected error
    dropout: float = 0.15  # of the recurrent layers' outputs, in training


class Prediction(NamedTuple):
    """The network's prediction, in the frame under the head, at the reference stature."""

    axes: Tensor  # (B, T, 22, 3, 2) first two columns of frame ← joint, not orthonormal
    head: Tensor  # (B, T, 3) m, position of the head, used if it is not tracked
    contact_logit: Tensor  # (B, T, 4) for `CONTACT`
    error: Tensor  # (B, T, 25) m, expected position error


class CompletionNetwork(nn.Module):
    """GRU with a skip connection and two branches: rotations, and contact with expected errors."""

    def __init__(self, config: CompletionConfig) -> None:
        super().__init__()
        self.config = config
        self.features = sum(WIDTHS.values())
        self.recurrent = nn.GRU(self.features, config.hidden, config.layers, batch_first=True)
        # Drop whole units for all frames: a mask that changes between frames would make the output tremble.
        self.dropout = nn.Dropout1d(config.dropout)
        both = config.hidden + self.features
        self.turn_branch = nn.Sequential(
            nn.Linear(both, config.branch), nn.ReLU(), nn.Linear(config.branch, 6 * JOINTS + 3)
        )
        self.judge_branch = nn.Sequential(
            nn.Linear(both, config.judge_branch),
            nn.ReLU(),
            nn.Linear(config.judge_branch, len(CONTACT) + BODY_POINT_COUNT),
        )
        standing = forward_kinematics(standing_pose(default_skeleton()))[1][:JOINTS]
        constants = {
            "standing_axes": quaternion_to_matrix(standing)[..., :2],
            "from_head": path_from_head(),
            "usual_bones": reference_offsets(),
            "image_sign": mirror_signs(),
        }
        for name, values in constants.items():
            self.register_buffer(name, torch.tensor(np.asarray(values), dtype=torch.float32), persistent=False)
        self.register_buffer("bone_parents", torch.tensor(bone_parents()), persistent=False)
        self.register_buffer("image", torch.tensor(mirror_indices()), persistent=False)

    standing_axes: Tensor
    from_head: Tensor
    bone_parents: Tensor
    usual_bones: Tensor
    image: Tensor
    image_sign: Tensor

    def read(self, signal: TrackedSignal) -> Tensor:
        """Return features (B, T, F) of a signal."""
        return features_of(signal, self.usual_bones)

    def read_both(self, signal: TrackedSignal) -> Tensor:
        """Return features (B, T, 2, F) of a signal and of its mirror image at x = 0 of the frame under the head."""
        features = self.read(signal)
        return torch.stack([features, features[..., self.image] * self.image_sign], dim=-2)

    def begin(self, batch: int) -> Tensor:
        """Return the memory (layers, batch, hidden) before the first frame."""
        return self.standing_axes.new_zeros(self.config.layers, batch, self.config.hidden)

    def predict(self, features: Tensor, memory: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """Return raw outputs of both branches for features (B, T, F), and the memory after them."""
        hidden, memory = self.recurrent(features, memory)
        both = torch.cat([self.dropout(hidden.mT).mT, features.to(hidden)], dim=-1)
        return (self.turn_branch(both), self.judge_branch(both)), memory

    def prediction(self, turned: Tensor, judged: Tensor) -> Prediction:
        """Convert raw outputs to a prediction."""
        axes = turned[..., : 6 * JOINTS].unflatten(-1, (JOINTS, 3, 2)) + self.standing_axes
        contact, error = judged[..., : len(CONTACT)], judged[..., len(CONTACT) :]
        raised = turned[..., 6 * JOINTS :] + turned.new_tensor([0.0, HEAD_HEIGHT, 0.0])
        return Prediction(axes, raised, contact, nn.functional.softplus(error + ERROR_BIAS) + SMALLEST_ERROR)

    def places(self, rotation: Tensor, rest_offset: Tensor) -> Tensor:
        """Return positions (B, T, 25, 3) from the head, for rotations (B, T, 22, 3, 3) and offsets (B, 25, 3)."""
        bones = rotation[..., self.bone_parents, :, :] @ rest_offset[:, None, 1:, :, None]
        return self.from_head @ bones[..., 0]


def orthonormal(axes: Tensor) -> Tensor:
    """Return rotations (..., 3, 3) from their first two columns (..., 3, 2) (Gram-Schmidt; Zhou et al. 2019)."""
    x = nn.functional.normalize(axes[..., 0], dim=-1, eps=1e-6)
    y = axes[..., 1] - x * (x * axes[..., 1]).sum(dim=-1, keepdim=True)
    y = nn.functional.normalize(y, dim=-1, eps=1e-6)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


def turn_about_up(cosine: Tensor, sine: Tensor) -> Tensor:
    """Return rotation matrices (..., 3, 3) about +Y from cosine and sine (...), which are normalised first.

    They map column vectors of the turned frame to the world, and row vectors of the world to the turned frame.
    """
    length = torch.sqrt(cosine * cosine + sine * sine).clamp(min=1e-6)
    c, s = cosine / length, sine / length
    zero, one = torch.zeros_like(c), torch.ones_like(c)
    rows = [[c, zero, s], [zero, one, zero], [-s, zero, c]]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
