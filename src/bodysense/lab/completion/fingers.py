"""The finger network: fingers of both hands from whichever of their joints and tips are tracked, and from the wrist.

Each hand is read in its wrist's frame, the right one in a mirror, by one network for both.
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
from bodysense.lab.completion.network import orthonormal, run_gru

_SKELETON = default_skeleton()
SIDES = ("left", "right")
HAND_JOINTS = np.array(
    [
        [j for j in range(len(_SKELETON.joints)) if _SKELETON.wrist_of[j] == _SKELETON.index(f"{side}_wrist")]
        for side in SIDES
    ]
)  # (2, 15)
HAND_POINTS = np.array(
    [
        [*joints, *(p for p in range(len(_SKELETON.joints), len(_SKELETON.points)) if _SKELETON.parents[p] in joints)]
        for joints in HAND_JOINTS
    ]
)  # (2, 20) joints, then tips
FINGER_JOINTS, FINGER_POINTS = HAND_JOINTS.shape[1], HAND_POINTS.shape[1]
SMALLEST_ERROR = 0.001  # m
_WIDTHS = {
    "position": 3 * FINGER_POINTS,
    "has_position": FINGER_POINTS,
    "axes": 6 * FINGER_JOINTS,
    "has_rotation": FINGER_JOINTS,
    "bones": 3 * FINGER_POINTS,
    "wrist": 3 + 6 + 3,
    "interval": 1,
}


@dataclass(frozen=True)
class FingerConfig:
    """How the network is built."""

    hidden: int = 160
    branch: int = 160


class FingerSignal(NamedTuple):
    """What was tracked of both hands, in T frames of B sequences; the hand axis is left, right."""

    position: Tensor  # (B, T, 2, 20, 3) m, from the wrist, in its frame; absent ones 0
    has_position: Tensor  # (B, T, 2, 20) bool
    rotation: Tensor  # (B, T, 2, 15, 3, 3) wrist ← joint
    has_rotation: Tensor  # (B, T, 2, 15) bool
    rest_offset: Tensor  # (B, 2, 20, 3) m
    wrist: Tensor  # (B, T, 2, 3) m, in the frame under the head, from the head
    wrist_rotation: Tensor  # (B, T, 2, 3, 3) frame under the head ← wrist
    wrist_velocity: Tensor  # (B, T, 2, 3) m/s, in that frame
    interval: Tensor  # (B, T) s


class FingerNetwork(nn.Module):
    """One recurrent layer and one branch."""

    def __init__(self, config: FingerConfig) -> None:
        super().__init__()
        self.config = config
        self.features = sum(_WIDTHS.values())
        self.recurrent = nn.GRU(self.features, config.hidden, batch_first=True)
        self.branch = nn.Sequential(
            nn.Linear(config.hidden + self.features, config.branch),
            nn.ReLU(),
            nn.Linear(config.branch, 6 * FINGER_JOINTS + FINGER_POINTS),
        )
        world = quaternion_to_matrix(forward_kinematics(standing_pose(_SKELETON))[1])
        wrist = world[_SKELETON.index("left_wrist")]
        relaxed = wrist.T @ world[HAND_JOINTS[0]]
        size = float(np.linalg.norm(_SKELETON.rest_offset[_SKELETON.index("left_middle1")]))
        mirror = np.array([[1.0, 1, 1], [-1.0, 1, 1]])
        for name, values in (
            ("relaxed", relaxed[..., :2]),
            ("usual_bones", _SKELETON.rest_offset[HAND_POINTS[0]] / size),
            ("flip", mirror),
            ("flip_axes", mirror[:, :, None] * mirror[:, None, :2]),
            ("flip_matrix", mirror[:, :, None] * mirror[:, None, :]),
        ):
            self.register_buffer(name, torch.tensor(values, dtype=torch.float32), persistent=False)
        self.middle = HAND_POINTS[0].tolist().index(_SKELETON.index("left_middle1"))

    relaxed: Tensor
    usual_bones: Tensor
    flip: Tensor
    flip_axes: Tensor
    flip_matrix: Tensor

    def relaxed_only(self) -> FingerNetwork:
        """This network with a last layer of zeros, so that fingers rest where nothing tracks them."""
        for parameter in self.branch[-1].parameters():
            nn.init.zeros_(parameter)
        return self

    def begin(self, batch: int) -> Tensor:
        """The memory (1, 2 · batch, hidden) before the first frame."""
        return self.relaxed.new_zeros(1, 2 * batch, self.config.hidden)

    def read(self, signal: FingerSignal) -> Tensor:
        """Features (B, 2, T, F)."""
        size = torch.linalg.vector_norm(signal.rest_offset[:, :, self.middle], dim=-1)  # (B, 2)
        flip = self.flip[None, None, :, None, :]
        place = signal.position * flip / size[:, None, :, None, None]
        axes = signal.rotation[..., :2] * self.flip_axes[None, None, :, None]
        bones = signal.rest_offset * self.flip[None, :, None] / size[:, :, None, None] - self.usual_bones
        wrist = torch.cat(
            [
                signal.wrist * self.flip,
                signal.wrist_velocity * self.flip,
                (signal.wrist_rotation[..., :2] * self.flip_axes).flatten(-2),
            ],
            dim=-1,
        )
        frames = signal.interval.shape
        parts = [
            torch.where(signal.has_position[..., None], place, 0.0).flatten(-2),
            signal.has_position.to(place),
            torch.where(signal.has_rotation[..., None, None], axes, 0.0).flatten(-3),
            signal.has_rotation.to(place),
            (bones * 10).flatten(-2)[:, None].expand(*frames, -1, -1),
            wrist,
            (signal.interval * 30)[..., None, None].expand(*frames, 2, 1),
        ]
        return torch.cat(parts, dim=-1).transpose(1, 2)

    def forward(self, signal: FingerSignal, memory: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Rotations wrist ← joint (B, T, 2, 15, 3, 3), expected errors (B, T, 2, 20) m, and the memory after."""
        features = self.read(signal)
        batch = features.shape[0]
        hidden, memory = run_gru(self.recurrent, features.flatten(0, 1), memory)
        said = self.branch(torch.cat([hidden, features.flatten(0, 1).to(hidden)], dim=-1)).float()
        said = said.unflatten(0, (batch, 2)).transpose(1, 2)
        axes = said[..., : 6 * FINGER_JOINTS].unflatten(-1, (FINGER_JOINTS, 3, 2)) + self.relaxed
        rotation = orthonormal(axes) * self.flip_matrix[None, None, :, None]
        error = nn.functional.softplus(said[..., 6 * FINGER_JOINTS :] - 4) + SMALLEST_ERROR
        return rotation, error, memory.float()
