"""Some points of a body from others: UNOC's model without its occlusion branch (sections 5.2 and 5.3).

Finger synthesis and the three-point upper body are two configurations of it. It reads world positions of some points
and the orientation of head and wrists, and ends at world positions: the change of frame and of size is inside, so that
training, the exported file and every run time share it. What is measured from where says `body.pose`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.resting import hand_length
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.geometry.rotation import heading, quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense_lab.papers.unoc.network.network import FINGER_SCALE, REFERENCE_HEIGHT
from bodysense_lab.papers.unoc.network.recurrent import Cell, Recurrent, branch

# Their forward vector: where the head looks, where the hand points; and their up vector: the back of the hand.
AXES = ([[0.0, 0, 1], [1, 0, 0], [-1, 0, 0]], [[0.0, 1, 0], [0, 1, 0], [0, 1, 0]])


@dataclass(frozen=True)
class PointNetworkConfig:
    """Inputs, outputs and layers of the network."""

    reads: tuple[str, ...]  # points whose position is read; head and wrists are among them
    places: tuple[str, ...]  # points that are placed
    wearer: bool = False  # also reads the head's height over the ground and the lengths of the bones to be placed
    from_wrists: bool = False  # also reads the points as each wrist sees them
    cell: Cell = "gru"
    hidden: int = 256
    branch: tuple[int, ...] = (256,)  # hidden layers that place the points
    dropout: float = 0.0  # in those layers
    judge_branch: tuple[int, ...] | None = None  # hidden layers that state the expected error; None: it is not stated
    window: int | None = None  # frames of input, or None: the state is carried over the whole sequence


class TrackedPoints(NamedTuple):
    """Tracked points of T frames of B sequences."""

    position: Tensor  # (B, T, R, 3) m, world, of the points that are read
    rotation: Tensor  # (B, T, 3, 4) wxyz, world, of head, left and right wrist
    rest: Tensor  # (B, O, 3) m, the resting offsets of the points that are placed
    bone_length: Tensor  # (B, P) m, of the wearer's skeleton
    height: Tensor  # (B,) m, of the wearer's rest pose


class Prepared(NamedTuple):
    """Inputs in the network's own frames and size."""

    features: Tensor  # (B, T, F)
    start: Tensor  # (B, O, 3) the resting offsets of the points that are placed
    known: Tensor  # (B, T, R, 3) offsets of the points that are read from the head, in its heading's axes


class PointPrediction(NamedTuple):
    """The answer in the network's own frames and size: what the losses compare."""

    offset: Tensor  # (B, T, O, 3) m, from head or wrist
    error: Tensor  # (B, T, O) m, expected position error; zero where it is not stated


class PointNetwork(nn.Module):
    """Recurrent part, skip connection, fully connected layers; a second branch for the expected error."""

    def __init__(self, config: PointNetworkConfig, skeleton: Skeleton) -> None:
        super().__init__()
        self.config = config
        self.skeleton = skeleton
        reads, places = list(config.reads), list(config.places)
        targets = skeleton.indices(places)
        self.head = reads.index("head")
        self.wrists = [reads.index(name) for name in THREE_POINTS[1:]]
        is_finger = skeleton.wrist_of[targets] >= 0
        self.measured_from: list[int] = [  # head, left or right wrist, as places in THREE_POINTS
            THREE_POINTS.index(skeleton.points[wrist]) if wrist >= 0 else 0 for wrist in skeleton.wrist_of[targets]
        ]
        self.bones = bones(config, skeleton)

        reference = skeleton.with_offsets(skeleton.rest_offset * (REFERENCE_HEIGHT / skeleton.extent))
        self.hand_length = hand_length(reference)
        self.bone_points = skeleton.indices([name for name, _ in _named_bones(config, skeleton)]).tolist()
        self.hand_points = skeleton.indices(["left_middle1", "right_middle1"]).tolist()
        typical = reference.bone_length[self.bone_points]
        self.register_buffer("typical_bone", torch.tensor(typical, dtype=torch.float32), persistent=False)
        scale = torch.tensor(np.where(is_finger, FINGER_SCALE, 1.0)[:, None], dtype=torch.float32)
        self.register_buffer("scale", scale, persistent=False)
        self.register_buffer("is_finger", torch.tensor(is_finger), persistent=False)
        self.register_buffer("forward_axis", torch.tensor(AXES[0]), persistent=False)
        self.register_buffer("up_axis", torch.tensor(AXES[1]), persistent=False)

        others = len(reads) - 1
        features = 3 * others + 6 * len(THREE_POINTS)
        features += (1 + len(self.bone_points)) if config.wearer else 0
        features += 2 * 3 * others if config.from_wrists else 0
        self.features = features
        self.recurrent = Recurrent(config.cell, features, config.hidden, config.window)
        both = config.hidden + features
        self.place = branch(both, config.branch, 3 * len(places), config.dropout)
        self.judge = None if config.judge_branch is None else branch(both, config.judge_branch, len(places))

    typical_bone: Tensor
    scale: Tensor
    is_finger: Tensor
    forward_axis: Tensor
    up_axis: Tensor

    def start(self, batch: int) -> Tensor:
        """The memory before the first frame of `batch` sequences."""
        return self.recurrent.start(batch).to(self.scale.device)

    def forward(self, tracked: TrackedPoints, memory: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """World positions (B, T, O, 3) m, expected errors (B, T, O) m and the memory after.

        One call with T frames equals T calls with one.
        """
        prepared = self.prepare(tracked)
        hidden, memory = self.recurrent(prepared.features, memory)
        answer = self.answer(prepared.features, hidden, prepared.start)
        size = self.size(tracked)[:, None]
        return self.place_in_world(answer.offset * size[..., None], tracked), answer.error * size, memory

    def answer(self, features: Tensor, hidden: Tensor, start: Tensor) -> PointPrediction:
        """The branches: (B, T, F), (B, T, hidden), resting offsets (B, O, 3) → PointPrediction."""
        both = torch.cat([hidden, features], dim=-1)
        offset = start[:, None] + self.place(both).unflatten(-1, (-1, 3)) / self.scale
        if self.judge is None:
            return PointPrediction(offset, torch.zeros_like(offset[..., 0]))
        return PointPrediction(offset, torch.exp(torch.clamp(self.judge(both) - 3, -7, 1)))

    def prepare(self, tracked: TrackedPoints) -> Prepared:
        """Compute the inputs of the network from world positions and rotations."""
        away = quaternion_conjugate(heading(tracked.rotation[..., 0, :]))[..., None, :]
        size = (REFERENCE_HEIGHT / tracked.height)[:, None, None, None]
        known = size * _turned(away, tracked.position - tracked.position[..., self.head : self.head + 1, :])
        parts = [_without(known, self.head).flatten(-2)]
        turned = quaternion_multiply(away.expand_as(tracked.rotation), tracked.rotation)
        for axis in (self.forward_axis, self.up_axis):
            parts.append(_turned(turned, axis.expand(*turned.shape[:-1], 3)).flatten(-2))
        if self.config.wearer:
            height = size[..., 0] * tracked.position[..., self.head, 1:2] - 1.0
            bone = (tracked.bone_length[..., self.bone_points] * size[..., 0, 0] - self.typical_bone) * 10
            parts += [height, bone[:, None].expand(-1, height.shape[1], -1)]
        if self.config.from_wrists:
            for k, wrist in enumerate(self.wrists):
                seen = tracked.position - tracked.position[..., wrist : wrist + 1, :]
                into = quaternion_conjugate(tracked.rotation[..., k + 1 : k + 2, :])
                parts.append(size.squeeze(-1) * _without(_turned(into, seen), wrist).flatten(-2))
        start = tracked.rest / self.size(tracked)[..., None]
        return Prepared(torch.cat(parts, dim=-1), start, known)

    def size(self, tracked: TrackedPoints) -> Tensor:
        """(B, O) metres of the wearer in one of the network: of hands where fingers are, of the body elsewhere."""
        body = (tracked.height / REFERENCE_HEIGHT)[:, None]
        hand = tracked.bone_length[:, self.hand_points].mean(dim=-1, keepdim=True) / self.hand_length
        return torch.where(self.is_finger, hand, body)

    def place_in_world(self, offset: Tensor, tracked: TrackedPoints) -> Tensor:
        """Offsets (B, T, O, 3) m from head or wrist → world positions."""
        origin, turn = self.frames(tracked)
        return _turned(turn, offset) + origin

    def offsets(self, position: Tensor, tracked: TrackedPoints) -> Tensor:
        """World positions (B, T, O, 3) m in the network's own frames and size: what it should say."""
        origin, turn = self.frames(tracked)
        return _turned(quaternion_conjugate(turn), position - origin) / self.size(tracked)[:, None, :, None]

    def frames(self, tracked: TrackedPoints) -> tuple[Tensor, Tensor]:
        """World position (B, T, O, 3) and rotation (B, T, O, 4) of what each placed point is measured from."""
        turn = torch.cat([heading(tracked.rotation[..., :1, :]), tracked.rotation[..., 1:, :]], dim=-2)
        origin = tracked.position[..., [self.head, *self.wrists], :]
        return origin[..., self.measured_from, :], turn[..., self.measured_from, :]


def bones(config: PointNetworkConfig, skeleton: Skeleton) -> tuple[list[int], list[int]]:
    """Ends (child, parent) of the bones to be placed, as places among `places`, `reads` and, last, a zero.

    The zero is the wrist from which a finger is measured.
    """
    names = [*config.places, *config.reads]
    children, parents = [], []
    for child, parent in _named_bones(config, skeleton):
        from_wrist = skeleton.wrist_of[skeleton.index(child)] == skeleton.index(parent)
        children.append(names.index(child))
        parents.append(len(names) if from_wrist else names.index(parent))
    return children, parents


def _named_bones(config: PointNetworkConfig, skeleton: Skeleton) -> list[tuple[str, str]]:
    """Bones of which one end at least is placed, and the other known."""
    names = (*config.places, *config.reads)
    pairs = [
        (name, skeleton.points[parent])
        for name, parent in zip(skeleton.points, skeleton.parents, strict=True)
        if parent >= 0
    ]
    return [(c, p) for c, p in pairs if {c, p} <= set(names) and {c, p} & set(config.places)]


def _turned(rotation: Tensor, vector: Tensor) -> Tensor:
    """Vectors (..., N, 3) turned by (..., N or 1, 4)."""
    return quaternion_rotate(rotation.expand(*vector.shape[:-1], 4), vector)


def _without(points: Tensor, place: int) -> Tensor:
    """(..., N, 3) without one of the points."""
    return torch.cat([points[..., :place, :], points[..., place + 1 :, :]], dim=-2)


_FINGER = default_skeleton().wrist_of >= 0
BODY = tuple(np.array(default_skeleton().joints)[~_FINGER[: len(default_skeleton().joints)]].tolist())
HANDS = tuple(np.array(default_skeleton().points)[_FINGER].tolist())

# The paper's hand has 16 joints and 5 tips; SMPL-H's has 15 and 5, for it has no bone inside the palm.
# The shipped form. Few recordings have fingers, so it is small and has dropout.
FINGERS = PointNetworkConfig(reads=BODY, places=HANDS, from_wrists=True, hidden=64, branch=(64,), dropout=0.5)
# Section 5.3, but for the axes, which turn with the head's heading.
PAPER_FINGERS = replace(FINGERS, from_wrists=False, hidden=512, branch=(512, 512), dropout=0.0, window=27)


TRUNK = ("pelvis", "spine1", "spine2", "spine3", "neck")
ARMS = tuple(f"{side}_{part}" for part in ("collar", "shoulder", "elbow") for side in ("left", "right"))

UPPER_BODY = PointNetworkConfig(reads=THREE_POINTS, places=(*TRUNK, *ARMS), wearer=True, judge_branch=(64,))
# Section 5.2, but for the axes, which turn with the head's heading.
PAPER_UPPER_BODY = replace(UPPER_BODY, wearer=False, judge_branch=None, hidden=512, branch=(512, 512), window=27)
