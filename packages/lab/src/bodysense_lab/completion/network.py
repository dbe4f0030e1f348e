"""The completion network: any points of a body, on any proportions, → rotations, contacts and expected errors.

It reads any of 27 points that are tracked (the 22 joints of `BODY`, head top and toe tips, and the middle of each
hand's knuckles), each with a position, a rotation, both or neither, and the known lengths of the wearer's bones.
It works in the frame under the head (x, z from the head, the floor at y = 0, turned by the head's heading) and at one
stature: a body that is elsewhere, turned or larger gets the same answer. It states every joint's rotation from that
frame, not from its parent's, so that a bone depends on one rotation and errors do not add up along a chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.features import WIDTHS, TrackedSignal, features_of, mirror_indices, mirror_signs
from bodysense_lab.completion.points import (
    BODY_POINT_COUNT,
    CONTACT,
    HEAD_HEIGHT,
    JOINTS,
    bone_parents,
    path_from_head,
    reference_offsets,
)

SMALLEST_ERROR = 0.002  # m: no expected error is smaller
ERROR_BIAS = -3.0  # of the expected error before it is made positive


@dataclass(frozen=True)
class CompletionConfig:
    """How the network is built."""

    hidden: int = 512
    layers: int = 2  # recurrent layers
    branch: int = 512  # units of the layer that turns the joints
    judge_branch: int = 128  # units of the layer that judges contact and expected error
    dropout: float = 0.15  # of the recurrent layers' outputs, in training


class Prediction(NamedTuple):
    """The network's prediction, in the frame under the head, at the reference stature."""

    axes: Tensor  # (B, T, 22, 3, 2) first two columns of frame ← joint, not yet orthonormal
    head: Tensor  # (B, T, 3) m, where the head is if it is not tracked
    contact_logit: Tensor  # (B, T, 4) of `CONTACT`
    error: Tensor  # (B, T, 25) m, expected position error


class CompletionNetwork(nn.Module):
    """Two recurrent layers, a skip connection, and two branches: one turns the joints, one judges."""

    def __init__(self, config: CompletionConfig) -> None:
        super().__init__()
        self.config = config
        self.features = sum(WIDTHS.values())
        self.recurrent = nn.GRU(self.features, config.hidden, config.layers, batch_first=True)
        # Whole units, over all frames alike: what changes from frame to frame would tremble.
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
        """Features (B, T, F) of a signal."""
        return features_of(signal, self.usual_bones)

    def read_both(self, signal: TrackedSignal) -> Tensor:
        """Features (B, T, 2, F) of a signal and of its mirror image at the plane x = 0 of the frame under the head."""
        features = self.read(signal)
        return torch.stack([features, features[..., self.image] * self.image_sign], dim=-2)

    def begin(self, batch: int) -> Tensor:
        """The memory (layers, batch, hidden) before the first frame."""
        return self.standing_axes.new_zeros(self.config.layers, batch, self.config.hidden)

    def predict(self, features: Tensor, memory: Tensor) -> tuple[tuple[Tensor, Tensor], Tensor]:
        """Raw outputs of both branches for features (B, T, F), and the memory after them."""
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
        """Positions (B, T, 25, 3) from the head of joints turned (B, T, 22, 3, 3), with offsets (B, 25, 3)."""
        bones = rotation[..., self.bone_parents, :, :] @ rest_offset[:, None, 1:, :, None]
        return self.from_head @ bones[..., 0]


def orthonormal(axes: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) from their first two columns (..., 3, 2) (Gram-Schmidt; Zhou et al. 2019)."""
    x = nn.functional.normalize(axes[..., 0], dim=-1, eps=1e-6)
    y = axes[..., 1] - x * (x * axes[..., 1]).sum(dim=-1, keepdim=True)
    y = nn.functional.normalize(y, dim=-1, eps=1e-6)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=-1)


def turn_about_up(cosine: Tensor, sine: Tensor) -> Tensor:
    """Turns (..., 3, 3) about +Y, for column vectors of the frame or row vectors of the world; not yet unit input."""
    length = torch.sqrt(cosine * cosine + sine * sine).clamp(min=1e-6)
    c, s = cosine / length, sine / length
    zero, one = torch.zeros_like(c), torch.ones_like(c)
    rows = [[c, zero, s], [zero, one, zero], [-s, zero, c]]
    return torch.stack([torch.stack(row, dim=-1) for row in rows], dim=-2)
