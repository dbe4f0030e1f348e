"""Finger network: predicts the fingers of both hands from the wrists and any tracked finger joints and tips.

One network reads both hands, each in the frame of its wrist. Right hands are mirrored.
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
from bodysense_lab.completion.data.points import FINGER_JOINTS, FINGER_POINTS, HAND_JOINTS, HAND_POINTS
from bodysense_lab.completion.networks.network import orthonormal

_SKELETON = default_skeleton()
_JOINTS = HAND_JOINTS[0].tolist()
_PARENTS = [_SKELETON.parents[point] for point in HAND_POINTS[0]]
_PARENT_ROWS = [1 + _JOINTS.index(above) if above in _JOINTS else 0 for above in _PARENTS]  # among [wrist, joints]
_PATH = torch.tensor(_SKELETON.path[np.ix_(HAND_POINTS[0], HAND_POINTS[0])], dtype=torch.float32)
BENDING_POINTS = [point for point, above in enumerate(_PARENT_ROWS) if above]  # points that move when the fingers bend
# (2, 3) factors of vectors of the left and the right hand: right hands are mirrored.
FLIP = torch.tensor([[1.0, 1, 1], [-1, 1, 1]])
SMALLEST_ERROR = 0.001  # m; no expected error is smaller
ERROR_BIAS = -4.0  # of the expected error, before softplus
_BONE_SCALE, _RATE = 10.0, 30.0  # factors of bone deviations and of the interval in s
# Inputs of a hand in a frame: points, joints, bones, the wrist's position, axes and velocity, the interval.
FEATURES = 4 * FINGER_POINTS + 7 * FINGER_JOINTS + 3 * FINGER_POINTS + 12 + 1


@dataclass(frozen=True)
class FingerConfig:
    """Size of the network."""

    hidden: int = 160
    branch: int = 160


class FingerSignal(NamedTuple):
    """Tracked points of both hands, in T frames of B sequences; the hand axis is left, right."""

    position: Tensor  # (B, T, 2, 20, 3) m, in the frame of the wrist; 0 if untracked
    has_position: Tensor  # (B, T, 2, 20) bool
    rotation: Tensor  # (B, T, 2, 15, 3, 3) wrist ← joint
    has_rotation: Tensor  # (B, T, 2, 15) bool
    rest_offset: Tensor  # (B, 2, 20, 3) m
    wrist: Tensor  # (B, T, 2, 3) m, in the frame under the head, relative to the head
    wrist_rotation: Tensor  # (B, T, 2, 3, 3) frame under the head ← wrist
    wrist_velocity: Tensor  # (B, T, 2, 3) m/s, in that frame
    interval: Tensor  # (B, T) s


class FingerNetwork(nn.Module):
    """GRU with one layer, and a branch that predicts rotations and expected errors."""

    def __init__(self, config: FingerConfig) -> None:
        super().__init__()
        self.config = config
        self.recurrent = nn.GRU(FEATURES, config.hidden, batch_first=True)
        self.branch = nn.Sequential(
            nn.Linear(config.hidden + FEATURES, config.branch),
            nn.ReLU(),
            nn.Linear(config.branch, 6 * FINGER_JOINTS + FINGER_POINTS),
        )
        self.middle = HAND_POINTS[0].tolist().index(_SKELETON.index("left_middle1"))
        usual = _SKELETON.rest_offset[HAND_POINTS[0]]
        usual = usual / np.linalg.norm(usual[self.middle])
        self.register_buffer("usual_bones", torch.tensor(usual, dtype=torch.float32), persistent=False)
        self.register_buffer("relaxed", relaxed_axes(), persistent=False)

    usual_bones: Tensor  # (20, 3) rest offsets of a left hand, divided by its size
    relaxed: Tensor  # (15, 3, 2) of `relaxed_axes`

    def relaxed_only(self) -> FingerNetwork:
        """Set the last layer to zero, so that untracked fingers are relaxed, and return the network."""
        for parameter in self.branch[-1].parameters():
            nn.init.zeros_(parameter)
        return self

    def begin(self, batch: int) -> Tensor:
        """Return the memory (1, 2 · batch, hidden) before the first frame."""
        return self.relaxed.new_zeros(1, 2 * batch, self.config.hidden)

    def read(self, signal: FingerSignal) -> Tensor:
        """Return features (B, 2, T, F), divided by the size of the hand. Those of the right hand are mirrored."""
        frames = signal.interval.shape
        flip = FLIP.to(signal.position)[:, None]  # of vectors (2, N, 3)
        turned = (FLIP[:, :, None] * FLIP[:, None, :2]).to(signal.position)[:, None]  # of axes (2, N, 3, 2)
        middle = signal.rest_offset[:, :, self.middle : self.middle + 1]
        larger = (1 / torch.linalg.vector_norm(middle, dim=-1, keepdim=True).clamp(min=1e-3))[:, None]
        bones = (signal.rest_offset[:, None] * larger * flip - self.usual_bones) * _BONE_SCALE
        axes = signal.rotation[..., :2] * turned * signal.has_rotation[..., None, None]
        parts = (
            signal.position * larger * flip * signal.has_position[..., None],
            signal.has_position,
            axes,
            signal.has_rotation,
            bones.expand(*frames, -1, -1, -1),
            signal.wrist * flip[:, 0],
            signal.wrist_velocity * flip[:, 0],
            signal.wrist_rotation[..., :2] * turned[:, 0],
            (signal.interval * _RATE)[..., None, None].expand(*frames, 2, 1),
        )
        rows = [part.flatten(3).to(signal.position) for part in parts]
        return torch.cat(rows, dim=-1).transpose(1, 2)

    def forward(self, signal: FingerSignal, memory: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return rotations wrist ← joint (B, T, 2, 15, 3, 3), expected errors (B, T, 2, 20) m, and the new memory."""
        features = self.read(signal)
        batch = features.shape[0]
        hidden, memory = self.recurrent(features.flatten(0, 1), memory)
        output = self.branch(torch.cat([hidden, features.flatten(0, 1).to(hidden)], dim=-1)).float()
        output = output.unflatten(0, (batch, 2)).transpose(1, 2)
        axes = output[..., : 6 * FINGER_JOINTS].unflatten(-1, (FINGER_JOINTS, 3, 2)) + self.relaxed
        flip = (FLIP[:, :, None] * FLIP[:, None, :]).to(axes.device)
        rotation = orthonormal(axes) * flip[None, None, :, None]
        error = nn.functional.softplus(output[..., 6 * FINGER_JOINTS :] + ERROR_BIAS) + SMALLEST_ERROR
        return rotation, error, memory.float()


def relaxed_axes() -> Tensor:
    """Return x and y axes (15, 3, 2) of the joints of a relaxed left hand, as columns."""
    world = quaternion_to_matrix(forward_kinematics(standing_pose(_SKELETON))[1])
    relaxed = world[_SKELETON.index("left_wrist")].T @ world[HAND_JOINTS[0]]
    return torch.tensor(relaxed[..., :2], dtype=torch.float32)


def with_measured(rotation: Tensor, signal: FingerSignal) -> Tensor:
    """Replace rotations (B, T, 2, 15, 3, 3) by measured ones if there are any."""
    return torch.where(signal.has_rotation[..., None, None], signal.rotation, rotation)


def finger_positions(rotation: Tensor, rest_offset: Tensor) -> Tensor:
    """Return positions (B, T, 2, 20, 3) m in the frame of the wrist.

    Args:
        rotation: (B, T, 2, 15, 3, 3) wrist ← joint.
        rest_offset: (B, 2, 20, 3) m.
    """
    wrist = torch.eye(3).to(rotation).expand(*rotation.shape[:3], 1, 3, 3)
    carrying = torch.cat([wrist, rotation], dim=3)[..., _PARENT_ROWS, :, :]
    bones = (carrying @ rest_offset[:, None, ..., None])[..., 0]
    return _PATH.to(bones) @ bones
