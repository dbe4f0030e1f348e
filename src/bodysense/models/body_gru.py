"""Body GRU: a recurrent network that completes body and fingers from what a headset's cameras see (UNOC, section 4.2).

The network starts at tracked world positions and the headset's pose and ends at world positions: the change of frame
(head's heading, wrist, body height) and the repetition of last known positions are inside, so that training, the
exported file and every run time share them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.rotation import quaternion_rotate
from bodysense.body.skeleton import Skeleton

REFERENCE_HEIGHT = 1.7  # m: bodies are scaled to it, so that the network meets one size
FINGER_SCALE = 10.0  # fingers move within centimetres; bring them to the range of the body


@dataclass(frozen=True)
class BodyGruConfig:
    """What the network reads and how large it is. The defaults are the shipped form; see `PAPER` for the paper's."""

    hidden: int = 512
    branch: tuple[int, ...] = (512, 512)
    window: int | None = None  # frames of input, or None: the state is carried over the whole sequence
    inputs: Literal["positions", "headset"] = (
        "headset"  # 'headset' adds the mask and the headset's orientation and motion
    )
    frame: Literal["heading", "world"] = "heading"  # axes of head-relative positions; the paper's are the world's


PAPER = BodyGruConfig(window=27, inputs="positions")  # papers.md 1.5-1.6; heading axes are the house's decision
PAPER_WORLD_AXES = BodyGruConfig(window=27, inputs="positions", frame="world")  # the paper to the letter


class Tracked(NamedTuple):
    """What was seen in T frames of B sequences."""

    position: Tensor  # (B, T, P, 3) m, world; any finite value where hidden
    visible: Tensor  # (B, T, P) bool
    head_position: Tensor  # (B, T, 3) m, world
    head_rotation: Tensor  # (B, T, 4) wxyz, world ← head
    interval: Tensor  # (B, T) s, since the frame before
    bone_length: Tensor  # (B, P) m, of the wearer's skeleton
    height: Tensor  # (B,) m, of the wearer's rest pose


class State(NamedTuple):
    """What the network remembers between frames."""

    known: Tensor  # (B, P, 3) last known positions, as offsets in the network's frame
    known_world: Tensor  # (B, P, 3) m, the same kept in the world
    seen: Tensor  # (B, P) bool, whether the point was ever seen
    head_position: Tensor  # (B, 3) m, of the frame before
    heading: Tensor  # (B, 2) cosine and sine of the frame before's heading; zeros before the first frame
    memory: Tensor  # (B, hidden), or (B, window, features) of the frames before


class Answer(NamedTuple):
    """The network's answer in its own frame: what the losses compare."""

    offset: Tensor  # (B, T, P, 3) m at the reference height; body from the head, fingers from their wrist
    hidden_logit: Tensor  # (B, T, P) occlusion logits
    error: Tensor  # (B, T, P) m at the reference height, expected position error


class Completed(NamedTuple):
    """The answer in the world."""

    position: Tensor  # (B, T, P, 3) m
    occluded: Tensor  # (B, T, P) probability
    error: Tensor  # (B, T, P) m


class BodyGru(nn.Module):
    """GRU, skip connection, two branches of fully connected layers: positions, and occlusion with expected error."""

    def __init__(self, config: BodyGruConfig, skeleton: Skeleton) -> None:
        super().__init__()
        self.config = config
        self.skeleton = skeleton
        head = skeleton.index("head")
        origin = np.where(skeleton.wrist_of >= 0, skeleton.wrist_of, head)
        self.head = head
        self.origin: list[int] = origin.tolist()  # the point that each offset is measured from
        self.other: list[int] = [p for p in range(len(skeleton.points)) if p != head]
        self.body: list[int] = [p for p in self.other if origin[p] == head]
        self.finger: list[int] = np.flatnonzero(skeleton.wrist_of >= 0).tolist()
        reference = skeleton.scaled(REFERENCE_HEIGHT)
        position, _ = forward_kinematics(standing_pose(reference))
        scale = np.ones((len(skeleton.points), 1))
        scale[self.finger] = FINGER_SCALE
        self.register_buffer("standing", torch.tensor(position - position[origin], dtype=torch.float32))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))
        self.register_buffer("typical_bone", torch.tensor(reference.bone_length, dtype=torch.float32))

        points, other = len(skeleton.points), len(self.other)
        features = 3 * other
        if config.inputs == "headset":
            features += points + 3 * len(self.body) + len(self.body) + 6 + 1 + 3 + 1
        self.features = features
        self.gru = nn.GRU(features, config.hidden, batch_first=True)
        self.place = _branch(features + config.hidden, config.branch, 3 * other)
        self.judge = _branch(features + config.hidden, config.branch, 2 * points)

    standing: Tensor
    scale: Tensor
    typical_bone: Tensor

    def start(self, batch: int) -> State:
        """The state before the first frame of `batch` sequences."""
        points, device = len(self.skeleton.points), self.scale.device
        memory = (batch, self.config.hidden)
        if self.config.window is not None:
            memory = (batch, self.config.window, self.features)
        return State(
            known=self.standing.expand(batch, -1, -1).clone(),
            known_world=torch.zeros(batch, points, 3, device=device),
            seen=torch.zeros(batch, points, dtype=torch.bool, device=device),
            head_position=torch.zeros(batch, 3, device=device),
            heading=torch.zeros(batch, 2, device=device),
            memory=torch.zeros(memory, device=device),
        )

    def forward(self, tracked: Tracked, state: State) -> tuple[Completed, State]:
        """Complete T frames; one call with T frames equals T calls with one."""
        features, known, turn, state = self.prepare(tracked, state)
        hidden, memory = self.remember(features, state.memory)
        return self.place_in_world(self.answer(features, hidden, known), turn, tracked), state._replace(memory=memory)

    def remember(self, features: Tensor, memory: Tensor) -> tuple[Tensor, Tensor]:
        """The recurrent part: features (B, T, F) → what it makes of each frame (B, T, hidden), and the memory after."""
        if self.config.window is None:
            hidden, after = self.gru(features, memory[None])
            return hidden, after[0]
        window, frames = self.config.window, features.shape[1]
        # A fresh sequence is preceded by repetitions of its first frame.
        fresh = (memory == 0).all(dim=-1, keepdim=True)
        history = torch.cat([torch.where(fresh, features[:, :1], memory), features], dim=1)
        windows = torch.stack([history[:, t + 1 : t + 1 + window] for t in range(frames)], dim=1)
        _, last = self.gru(windows.flatten(0, 1))
        return last[0].unflatten(0, (-1, frames)), history[:, -window:]

    def answer(self, features: Tensor, hidden: Tensor, known: Tensor) -> Answer:
        """The two branches: (B, T, F), (B, T, hidden) and the last known offsets (B, T, P, 3) → Answer."""
        both = torch.cat([hidden, features], dim=-1)
        change = self.place(both).unflatten(-1, (-1, 3)) / self.scale[self.other]
        zero = torch.zeros_like(known[..., :1, :])
        change = torch.cat([change[..., : self.head, :], zero, change[..., self.head :, :]], dim=-2)
        logit, log_error = self.judge(both).chunk(2, dim=-1)
        return Answer(known + change, logit, torch.exp(torch.clamp(log_error - 3, -7, 1)))

    def place_in_world(self, answer: Answer, turn: Tensor, tracked: Tracked) -> Completed:
        """From the network's frame, at the heading (B, T, 2), to the world."""
        size = (tracked.height / REFERENCE_HEIGHT)[:, None, None]
        offset = _turn(answer.offset, turn, 1) * size[..., None]
        body = offset + tracked.head_position[..., None, :]
        position = torch.where(self.scale > 1, offset + body[..., self.origin, :], body)
        return Completed(position, torch.sigmoid(answer.hidden_logit), answer.error * size)

    def offsets(self, position: Tensor, cosine_sine: Tensor, head_position: Tensor, height: Tensor) -> Tensor:
        """World positions as offsets (B, T, P, 3) in the network's frame: body from the head, fingers from a wrist."""
        origin = position[..., self.origin, :]
        body = position - head_position[..., None, :]
        offset = torch.where(self.scale > 1, position - origin, body)
        return _turn(offset, cosine_sine, -1) * (REFERENCE_HEIGHT / height)[:, None, None, None]

    def heading(self, head_rotation: Tensor) -> Tensor:
        """Cosine and sine of the head's turn about +Y: (B, T, 4) → (B, T, 2)."""
        w, y = head_rotation[..., 0], head_rotation[..., 2]
        # Upside down (a half turn about a horizontal axis) there is no heading; that of the world serves.
        w = torch.where(w * w + y * y < 1e-9, torch.ones_like(w), w)
        length = w * w + y * y
        turn = torch.stack([(w * w - y * y) / length, 2 * w * y / length], dim=-1)
        if self.config.frame == "world":
            return torch.stack([torch.ones_like(w), torch.zeros_like(y)], dim=-1)
        return turn

    def prepare(self, tracked: Tracked, state: State) -> tuple[Tensor, Tensor, Tensor, State]:
        """Features (B, T, F), last known offsets (B, T, P, 3), heading (B, T, 2) and the state after the frames."""
        turn = self.heading(tracked.head_rotation)
        offset = self.offsets(tracked.position, turn, tracked.head_position, tracked.height)
        visible = tracked.visible & tracked.visible[..., self.origin]
        known, known_world, seen = state.known, state.known_world, state.seen
        filled, filled_world, ever = [], [], []
        for t in range(offset.shape[1]):
            now = visible[:, t, :, None]
            known = torch.where(now, offset[:, t], known)
            known_world = torch.where(now, tracked.position[:, t], known_world)
            seen = seen | visible[:, t]
            filled.append(known)
            filled_world.append(known_world)
            ever.append(seen)
        last = torch.stack(filled, dim=1)
        started = (state.heading != 0).any(dim=-1)[:, None]
        head_before = torch.where(started, state.head_position, tracked.head_position[:, 0])
        turn_before = torch.where(started, state.heading, turn[:, 0])
        parts = [(last * self.scale)[..., self.other, :].flatten(-2)]
        if self.config.inputs == "headset":
            in_world = self.offsets(torch.stack(filled_world, 1), turn, tracked.head_position, tracked.height)
            in_world = torch.where(torch.stack(ever, 1)[..., None], in_world, last)
            before = torch.cat([head_before[:, None], tracked.head_position[:, :-1]], dim=1)
            before_turn = torch.cat([turn_before[:, None], turn[:, :-1]], dim=1)
            size = (REFERENCE_HEIGHT / tracked.height)[:, None, None]
            rate = 1 / torch.clamp(tracked.interval, min=1e-3)[..., None]
            velocity = _turn((tracked.head_position - before)[..., None, :], turn, -1)[..., 0, :] * size * rate
            spin = (before_turn[..., :1] * turn[..., 1:] - before_turn[..., 1:] * turn[..., :1]) * rate
            bone = (tracked.bone_length / tracked.height[:, None] * REFERENCE_HEIGHT - self.typical_bone) * 10
            parts += [
                tracked.visible.to(last.dtype),
                in_world[..., self.body, :].flatten(-2),
                bone[:, None, self.body].expand(-1, last.shape[1], -1),
                self.tilt(tracked.head_rotation, turn),
                tracked.head_position[..., 1:2] * size,
                torch.clamp(velocity, -5, 5),
                torch.clamp(spin, -10, 10) / 3,
            ]
        after = State(known, known_world, seen, tracked.head_position[:, -1], turn[:, -1], state.memory)
        return torch.cat(parts, dim=-1), last, turn, after

    def tilt(self, head_rotation: Tensor, turn: Tensor) -> Tensor:
        """Forward and up vector of the head in the network's frame: (B, T, 6)."""
        axes = torch.eye(3, device=turn.device, dtype=turn.dtype)[[2, 1]]
        vectors = quaternion_rotate(head_rotation[..., None, :], axes.expand(*head_rotation.shape[:-1], 2, 3))
        return _turn(vectors, turn, -1).flatten(-2)


def _branch(inputs: int, widths: tuple[int, ...], outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for width in widths:
        layers += [nn.Linear(inputs, width), nn.ReLU()]
        inputs = width
    return nn.Sequential(*layers, nn.Linear(inputs, outputs))


def _turn(vector: Tensor, cosine_sine: Tensor, direction: Literal[1, -1]) -> Tensor:
    """Turn (..., N, 3) about +Y by the heading (..., 2), or back by it."""
    cosine, sine = cosine_sine[..., None, 0], direction * cosine_sine[..., None, 1]
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    return torch.stack([cosine * x + sine * z, y, cosine * z - sine * x], dim=-1)
