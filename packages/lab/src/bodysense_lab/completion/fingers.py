"""The finger network: fingers of both hands from any of their joints and tips that are tracked, and from the wrist.

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
from bodysense_lab.completion.network import orthonormal

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
FLIP = torch.tensor(
    [[1.0, 1, 1], [-1, 1, 1]]
)  # what vectors of both hands are multiplied by: the right one in a mirror
SMALLEST_ERROR = 0.001  # m
ERROR_BIAS = -4.0  # of the expected error before it is made positive
ROWS = FINGER_POINTS + 2 * FINGER_JOINTS
_BONE_SCALE, _RATE = 10.0, 30.0
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
    """Tracked points of both hands, in T frames of B sequences; the hand axis is left, right."""

    position: Tensor  # (B, T, 2, 20, 3) m, from the wrist, in its frame; absent ones 0
    has_position: Tensor  # (B, T, 2, 20) bool
    rotation: Tensor  # (B, T, 2, 15, 3, 3) wrist ← joint
    has_rotation: Tensor  # (B, T, 2, 15) bool
    rest_offset: Tensor  # (B, 2, 20, 3) m
    wrist: Tensor  # (B, T, 2, 3) m, in the frame under the head, from the head
    wrist_rotation: Tensor  # (B, T, 2, 3, 3) frame under the head ← wrist
    wrist_velocity: Tensor  # (B, T, 2, 3) m/s, in that frame
    interval: Tensor  # (B, T) s


class FingerReading(NamedTuple):
    """Inputs of the features, in N frames; the hand axis is left, right.

    Rows are vectors in the wrist's frame: places of the points from the wrist, x axes of the joints, y axes of the
    joints. Rows of the wrist are in the frame under the head: its place from the head, its velocity, its x and y axes.
    """

    rows: Tensor  # (N, 2, 50, 3)
    seen: Tensor  # (N, 2, 50) whether each row is tracked: 1 or 0
    rest_offset: Tensor  # (N, 2, 20, 3) m
    wrist: Tensor  # (N, 2, 4, 3)
    interval: Tensor  # (N, 2, 1) s


class FingerFeatures(nn.Module):
    """A reading as features, those of the right hand in a mirror, both by the size of the hand."""

    sized: Tensor
    usual_bones: Tensor
    middle: Tensor
    place: Tensor
    scale: Tensor

    def __init__(self) -> None:
        super().__init__()
        size = float(np.linalg.norm(_SKELETON.rest_offset[_SKELETON.index("left_middle1")]))
        usual = torch.tensor(_SKELETON.rest_offset[HAND_POINTS[0]] / size, dtype=torch.float32)
        columns, signs = zip(*(part for name in _WIDTHS for part in _columns(name)), strict=True)
        scale = torch.tensor(signs)
        for name, values in (
            ("sized", (torch.arange(ROWS) < FINGER_POINTS).float()[:, None]),
            ("usual_bones", usual * FLIP[:, None]),
            ("middle", torch.tensor([HAND_POINTS[0].tolist().index(_SKELETON.index("left_middle1"))])),
            ("place", torch.tensor(columns)),
            ("scale", torch.stack([scale.abs(), scale])),
        ):
            self.register_buffer(name, values, persistent=False)

    def forward(self, reading: FingerReading) -> Tensor:
        """Features (N, 2, F)."""
        middle = reading.rest_offset.index_select(2, self.middle)
        larger = 1 / torch.linalg.vector_norm(middle, dim=-1, keepdim=True).clamp(min=1e-3)
        scale = reading.seen.unsqueeze(-1) * (larger * self.sized + (1 - self.sized))
        rows = reading.rows * scale
        bones = reading.rest_offset * larger - self.usual_bones
        parts = [
            rows.reshape(-1, 2, 3 * ROWS),
            reading.seen,
            bones.reshape(-1, 2, 3 * FINGER_POINTS),
            reading.wrist.reshape(-1, 2, 12),
            reading.interval,
        ]
        return torch.cat(parts, dim=-1).index_select(-1, self.place) * self.scale


def _columns(name: str) -> list[tuple[int, float]]:
    """Where the numbers of a kind of feature are among [rows, seen, bones, wrist, interval], and their factors.

    Factors are those of a right hand: below 0 where its mirror image has the other sign.
    """
    seen, bones = 3 * ROWS, 4 * ROWS
    wrist = bones + 3 * FINGER_POINTS
    vector = [-1.0, 1.0, 1.0]

    def axes(first: int, count: int) -> list[tuple[int, float]]:
        # Joint by joint: component, axis. In a mirror the x component changes its sign, and the x axis does.
        return [
            (first + 3 * (k * count + j) + c, vector[c] * (1.0 if k else -1.0))
            for j in range(count)
            for c in range(3)
            for k in range(2)
        ]

    match name:
        case "position":
            return [(3 * point + c, vector[c]) for point in range(FINGER_POINTS) for c in range(3)]
        case "has_position":
            return [(seen + point, 1.0) for point in range(FINGER_POINTS)]
        case "axes":
            return axes(3 * FINGER_POINTS, FINGER_JOINTS)
        case "has_rotation":
            return [(seen + FINGER_POINTS + joint, 1.0) for joint in range(FINGER_JOINTS)]
        case "bones":
            return [
                (bones + 3 * point + c, _BONE_SCALE * vector[c]) for point in range(FINGER_POINTS) for c in range(3)
            ]
        case "wrist":
            return [*((wrist + 3 * row + c, vector[c]) for row in range(2) for c in range(3)), *axes(wrist + 6, 1)]
        case _:
            return [(wrist + 12, _RATE)]


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
        self.reader = FingerFeatures()
        self.register_buffer("relaxed", relaxed_axes(), persistent=False)

    relaxed: Tensor

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
        frames = signal.interval.shape
        rows = [signal.position, signal.rotation[..., 0], signal.rotation[..., 1]]
        seen = torch.cat([signal.has_position, signal.has_rotation, signal.has_rotation], dim=-1)
        wrist = [signal.wrist, signal.wrist_velocity, signal.wrist_rotation[..., 0], signal.wrist_rotation[..., 1]]
        reading = FingerReading(
            torch.cat(rows, dim=-2),
            seen.to(signal.position),
            signal.rest_offset[:, None].expand(*frames, -1, -1, -1),
            torch.stack(wrist, dim=-2),
            signal.interval[..., None, None].expand(*frames, 2, 1),
        )
        features = self.reader(FingerReading(*(part.flatten(0, 1) for part in reading)))
        return features.unflatten(0, frames).transpose(1, 2)

    def forward(self, signal: FingerSignal, memory: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Rotations wrist ← joint (B, T, 2, 15, 3, 3), expected errors (B, T, 2, 20) m, and the memory after."""
        features = self.read(signal)
        batch = features.shape[0]
        hidden, memory = self.recurrent(features.flatten(0, 1), memory)
        said = self.branch(torch.cat([hidden, features.flatten(0, 1).to(hidden)], dim=-1)).float()
        said = said.unflatten(0, (batch, 2)).transpose(1, 2)
        axes = said[..., : 6 * FINGER_JOINTS].unflatten(-1, (FINGER_JOINTS, 3, 2)) + self.relaxed
        flip = (FLIP[:, :, None] * FLIP[:, None, :]).to(axes.device)
        rotation = orthonormal(axes) * flip[None, None, :, None]
        error = nn.functional.softplus(said[..., 6 * FINGER_JOINTS :] + ERROR_BIAS) + SMALLEST_ERROR
        return rotation, error, memory.float()


def relaxed_axes() -> Tensor:
    """(15, 3, 2): x and y axes of the joints of a relaxed left hand, as columns."""
    world = quaternion_to_matrix(forward_kinematics(standing_pose(_SKELETON))[1])
    relaxed = world[_SKELETON.index("left_wrist")].T @ world[HAND_JOINTS[0]]
    return torch.tensor(relaxed[..., :2], dtype=torch.float32)
