"""The body network: completes body and fingers from what a headset's cameras see (UNOC, section 4.2).

The network starts at tracked world positions and the headset's pose and ends at world positions: the change of frame
(head's heading, wrist, body height) and the repetition of last known positions are inside, so that training, the
exported file and every run time share them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.pose import forward_kinematics, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense_lab.core.checkpoint import read_weights_file
from bodysense_lab.papers.unoc.network.recurrent import Cell, Recurrent, branch

REFERENCE_HEIGHT = 1.7  # m: bodies are scaled to it, so that the network meets one size
FINGER_SCALE = 10.0  # fingers move within centimetres; bring them to the range of the body
FIRST_INTERVAL = 1 / 30  # s: the time step of a frame that has none before it
UNJUDGED = 0.05  # m: expected error of networks that do not predict it

# fmt: off
# From the products of a head's rotation, ww, wx, wy, wz, xw …: cosine and sine of its heading, both times the third,
# then its forward and its up vector in the world.
_OF_HEAD = np.array([
    [1, 0, 0, 0,  0, 0, 0, 0,  0, 0, -1, 0,  0, 0, 0, 0],
    [0, 0, 2, 0,  0, 0, 0, 0,  0, 0, 0, 0,  0, 0, 0, 0],
    [1, 0, 0, 0,  0, 0, 0, 0,  0, 0, 1, 0,  0, 0, 0, 0],
    [0, 0, 2, 0,  0, 0, 0, 2,  0, 0, 0, 0,  0, 0, 0, 0],
    [0, -2, 0, 0,  0, 0, 0, 0,  0, 0, 0, 2,  0, 0, 0, 0],
    [1, 0, 0, 0,  0, -1, 0, 0,  0, 0, -1, 0,  0, 0, 0, 1],
    [0, 0, 0, -2,  0, 0, 2, 0,  0, 0, 0, 0,  0, 0, 0, 0],
    [1, 0, 0, 0,  0, -1, 0, 0,  0, 0, 1, 0,  0, 0, 0, -1],
    [0, 2, 0, 0,  0, 0, 0, 0,  0, 0, 0, 2,  0, 0, 0, 0],
], dtype=np.float32).T
# Cosine and sine of a heading → the matrix, row by row, that takes row vectors from the world into its frame.
_TURN = np.array([[1, 0, 0, 0, 0, 0, 0, 0, 1], [0, 0, 1, 0, 0, 0, -1, 0, 0]], dtype=np.float32)
_UPRIGHT = np.array([0, 0, 0, 0, 1, 0, 0, 0, 0], dtype=np.float32)
# fmt: on


@dataclass(frozen=True)
class BodyNetworkConfig:
    """Inputs and layers of the network. The defaults are the shipped form; `PAPER` is the paper's."""

    cell: Cell = "gru"
    hidden: int = 512
    branch: tuple[int, ...] = (256, 256)  # hidden layers that place the points
    finger_branch: tuple[int, ...] | None = (128,)  # fingers have layers of their own; None: they share the body's
    finger_dropout: float = 0.3  # in the fingers' own layers, for few recordings have fingers
    judge_branch: tuple[int, ...] = (128,)  # hidden layers that judge the points
    window: int | None = None  # frames of input, or None: the state is carried over the whole sequence
    inputs: Literal["positions", "positions_and_mask", "headset"] = (
        "headset"  # 'headset' adds the mask, the headset's orientation and motion, and the time step
    )
    frame: Literal["heading", "world"] = "heading"  # axes of head-relative positions; the paper's are the world's
    finger_origin: Literal["wrist", "head"] = "wrist"  # what finger positions are measured from
    skip: bool = True  # whether the branches read the input too
    judges: tuple[Literal["occlusion", "error"], ...] = ("occlusion", "error")  # what the second branch predicts


# Section 4.2 of the paper, but for the axes, which turn with the head's heading.
PAPER = BodyNetworkConfig(
    branch=(512, 512),
    finger_branch=None,
    judge_branch=(512, 512),
    window=27,
    inputs="positions",
    judges=("occlusion",),
)


class TrackedBody(NamedTuple):
    """Tracked points of T frames of B sequences."""

    position: Tensor  # (B, T, P, 3) m, world; any finite value where hidden; the head's is head_position
    visible: Tensor  # (B, T, P) bool
    head_position: Tensor  # (B, T, 3) m, world
    head_rotation: Tensor  # (B, T, 4) wxyz, world ← head
    interval: Tensor  # (B, T) s, since the frame before
    bone_length: Tensor  # (B, P) m, of the wearer's skeleton
    height: Tensor  # (B,) m, of the wearer's rest pose


class PredictorState(NamedTuple):
    """State of the network between frames."""

    known: Tensor  # (B, P, 3) last known positions, as offsets in the network's frame
    known_world: Tensor  # (B, P, 3) m, the same kept in the world
    seen: Tensor  # (B, P) bool, whether the point was ever seen
    head_position: Tensor  # (B, 3) m, of the frame before
    heading: Tensor  # (B, 2) cosine and sine of the frame before's heading; zeros before the first frame
    memory: Tensor  # of the recurrent part


class BodyPrediction(NamedTuple):
    """Prediction in the network's own frame, as the losses compare it."""

    offset: Tensor  # (B, T, P, 3) m at the reference height; from the head or, fingers, from their wrist
    hidden_logit: Tensor  # (B, T, P) occlusion logits
    error: Tensor  # (B, T, P) m at the reference height, expected position error


class WorldPrediction(NamedTuple):
    """Prediction in the world."""

    position: Tensor  # (B, T, P, 3) m
    occluded: Tensor  # (B, T, P) probability
    error: Tensor  # (B, T, P) m


class BodyNetwork(nn.Module):
    """Recurrent part, skip connection, two branches of fully connected layers: positions, and judgement of them."""

    def __init__(self, config: BodyNetworkConfig, skeleton: Skeleton) -> None:
        super().__init__()
        self.config = config
        self.skeleton = skeleton
        head = skeleton.index("head")
        at_wrist = (skeleton.wrist_of >= 0) & (config.finger_origin == "wrist")
        origin = np.where(at_wrist, skeleton.wrist_of, head)
        self.head = head
        self.origin: list[int] = origin.tolist()  # the point that each offset is measured from
        self.finger: list[int] = np.flatnonzero(skeleton.wrist_of >= 0).tolist()
        self.other: list[int] = [p for p in range(len(skeleton.points)) if p != head]
        self.body: list[int] = [p for p in self.other if p not in self.finger]
        reference = skeleton.with_offsets(skeleton.rest_offset * (REFERENCE_HEIGHT / skeleton.extent))
        position, _ = forward_kinematics(standing_pose(reference))
        scale = np.where(at_wrist, FINGER_SCALE, 1.0)[:, None]
        self.register_buffer("standing", torch.tensor(position - position[origin], dtype=torch.float32))
        self.register_buffer("scale", torch.tensor(scale, dtype=torch.float32))
        self.register_buffer("typical_bone", torch.tensor(reference.bone_length, dtype=torch.float32))
        for name, constant in (("of_head", _OF_HEAD), ("turn", _TURN), ("upright", _UPRIGHT)):
            self.register_buffer(name, torch.from_numpy(constant), persistent=False)
        for name, places in (("origins", self.origin), ("others", self.other), ("bodies", self.body)):
            self.register_buffer(name, torch.tensor(places), persistent=False)

        points, other = len(skeleton.points), len(self.other)
        features = 3 * other
        if config.inputs != "positions":
            features += points
        if config.inputs == "headset":
            features += 3 * len(self.body) + len(self.body) + 6 + 1 + 3 + 1 + 1
        self.features = features
        self.recurrent = Recurrent(config.cell, features, config.hidden, config.window)
        both = config.hidden + (features if config.skip else 0)
        own, dropout = config.finger_branch, config.finger_dropout
        self.place = branch(both, config.branch, 3 * (other if own is None else len(self.body)))
        self.place_fingers = None if own is None else branch(both, own, 3 * len(self.finger), dropout)
        self.judge = branch(both, config.judge_branch, points * len(config.judges)) if config.judges else None
        # Index of each point in the outputs of the branches. The head, which is known, is last.
        order = [*(self.other if own is None else [*self.body, *self.finger]), head]
        self.register_buffer("places", torch.tensor(np.argsort(order)), persistent=False)

    standing: Tensor
    scale: Tensor
    typical_bone: Tensor
    of_head: Tensor
    turn: Tensor
    upright: Tensor
    origins: Tensor
    others: Tensor
    bodies: Tensor
    places: Tensor

    def start(self, batch: int) -> PredictorState:
        """The state before the first frame of `batch` sequences."""
        points, device = len(self.skeleton.points), self.scale.device
        return PredictorState(
            known=self.standing.expand(batch, -1, -1).clone(),
            known_world=torch.zeros(batch, points, 3, device=device),
            seen=torch.zeros(batch, points, dtype=torch.bool, device=device),
            head_position=torch.zeros(batch, 3, device=device),
            heading=torch.zeros(batch, 2, device=device),
            memory=self.recurrent.start(batch).to(device),
        )

    def forward(self, tracked: TrackedBody, state: PredictorState) -> tuple[WorldPrediction, PredictorState]:
        """Complete T frames; one call with T frames equals T calls with one."""
        features, known, into, state = self.prepare(tracked, state)
        hidden, memory = self.recurrent(features, state.memory)
        return self.place_in_world(self.answer(features, hidden, known), into, tracked), state._replace(memory=memory)

    def answer(self, features: Tensor, hidden: Tensor, known: Tensor) -> BodyPrediction:
        """The two branches: (B, T, F), (B, T, hidden) and the last known offsets (B, T, P, 3) → BodyPrediction."""
        both = torch.cat([hidden, features], dim=-1) if self.config.skip else hidden
        frames, both = both.shape[:-1], both.flatten(0, -2)  # as matrices, layers fuse in the exported file
        own = [] if self.place_fingers is None else [self.place_fingers(both)]
        predicted = torch.cat([self.place(both), *own, torch.zeros_like(both[:, :3])], dim=-1).unflatten(-1, (-1, 3))
        change = predicted.index_select(-2, self.places).unflatten(0, frames) / self.scale
        logit, error = torch.zeros_like(known[..., 0]), torch.full_like(known[..., 0], UNJUDGED)
        if self.judge is not None:
            judged = self.judge(both).unflatten(0, frames).split(len(self.skeleton.points), dim=-1)
            for what, value in zip(self.config.judges, judged, strict=True):
                if what == "occlusion":
                    logit = value
                else:
                    error = torch.exp(torch.clamp(value - 3, -7, 1))
        # Without the skip connection nothing of the input goes past the recurrent part.
        start = known if self.config.skip else self.standing
        return BodyPrediction(start + change, logit, error)

    def place_in_world(self, answer: BodyPrediction, into: Tensor, tracked: TrackedBody) -> WorldPrediction:
        """From the network's frame, `into` which (B, T, 3, 3) row vectors turn from the world, to the world."""
        size = (tracked.height / REFERENCE_HEIGHT)[:, None, None]
        offset = answer.offset @ (into.mT * size[..., None])
        # The head's own offset is zero.
        position = offset + offset.index_select(-2, self.origins) + tracked.head_position[..., None, :]
        return WorldPrediction(position, torch.sigmoid(answer.hidden_logit), answer.error * size)

    def offsets(self, position: Tensor, into: Tensor, height: Tensor) -> Tensor:
        """World positions as offsets (B, T, P, 3) in the network's frame: body from the head, fingers from a wrist."""
        scaled = into * (REFERENCE_HEIGHT / height)[:, None, None, None]
        return (position - position.index_select(-2, self.origins)) @ scaled

    def facing(self, head_rotation: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Where a head that is turned by (B, T, 4) faces.

        Returns the heading's cosine and sine (B, T, 2), the matrix (B, T, 3, 3) that turns row vectors from the world
        into the heading's frame, and the head's forward and up vector (B, T, 2, 3) in that frame.
        """
        products = (head_rotation[..., :, None] * head_rotation[..., None, :]).flatten(-2) @ self.of_head
        length = products[..., 2:3]
        # Upside down (a half turn about a horizontal axis) there is no heading; that of the world serves.
        ahead = self.turn.new_tensor([1.0, 0.0])
        heading = torch.where(length < 1e-9, ahead, products[..., :2] / length)
        if self.config.frame == "world":
            heading = ahead.expand_as(heading)
        into = (heading @ self.turn + self.upright).unflatten(-1, (3, 3))
        return heading, into, products[..., 3:].unflatten(-1, (2, 3)) @ into

    def prepare(self, tracked: TrackedBody, state: PredictorState) -> tuple[Tensor, Tensor, Tensor, PredictorState]:
        """Features (B, T, F), last known offsets (B, T, P, 3), the turn into the frame (B, T, 3, 3), the next state."""
        heading, into, tilt = self.facing(tracked.head_rotation)
        offset = self.offsets(tracked.position, into, tracked.height)
        visible = tracked.visible & tracked.visible.index_select(-1, self.origins)
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
        parts = [(last * self.scale).index_select(-2, self.others).flatten(-2)]
        if self.config.inputs != "positions":
            parts.append(tracked.visible.to(last.dtype))
        if self.config.inputs == "headset":
            in_world = self.offsets(torch.stack(filled_world, dim=1), into, tracked.height)
            in_world = torch.where(torch.stack(ever, dim=1)[..., None], in_world, last)
            parts.append(in_world.index_select(-2, self.bodies).flatten(-2))
            parts += self._headset(tracked, state, heading, into, tilt)
        after = PredictorState(known, known_world, seen, tracked.head_position[:, -1], heading[:, -1], state.memory)
        return torch.cat(parts, dim=-1), last, into, after

    def _headset(
        self, tracked: TrackedBody, state: PredictorState, heading: Tensor, into: Tensor, tilt: Tensor
    ) -> list[Tensor]:
        """Bone lengths, the head's tilt and height, how it moves and turns, and the time step."""
        started = (state.heading * state.heading).sum(dim=-1, keepdim=True) > 0.5
        head_before = torch.where(started, state.head_position, tracked.head_position[:, 0])
        heading_before = torch.where(started, state.heading, heading[:, 0])
        before = torch.cat([head_before[:, None], tracked.head_position[:, :-1]], dim=1)
        before_heading = torch.cat([heading_before[:, None], heading[:, :-1]], dim=1)
        size = REFERENCE_HEIGHT / tracked.height[:, None]
        rate = 1 / torch.clamp(tracked.interval, min=1e-3)[..., None]
        velocity = ((tracked.head_position - before)[..., None, :] @ into)[..., 0, :] * (size[..., None] * rate)
        spin = (before_heading[..., :1] * heading[..., 1:] - before_heading[..., 1:] * heading[..., :1]) * rate
        bone = ((tracked.bone_length * size - self.typical_bone) * 10).index_select(-1, self.bodies)[:, None]
        return [
            bone.expand(-1, heading.shape[1], -1),
            tilt.flatten(-2),
            tracked.head_position[..., 1:2] * size[..., None],
            torch.clamp(velocity, -5.0, 5.0),
            torch.clamp(spin, -10.0, 10.0) / 3,
            torch.clamp(tracked.interval[..., None] * 30, 0.2, 3.0),
        ]


def tracked_of(observation: Observation, skeleton: Skeleton) -> TrackedBody:
    """Return the inputs of the network for T frames of a wearer with `skeleton`; a batch of one.

    The observation must have every point of the skeleton, and position and rotation of the head in every frame.
    """
    head = skeleton.index("head")
    position, rotation, visible, _ = observed_points(observation, skeleton)

    def batch(values: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))[None]

    time = observation.time
    interval = np.diff(time, prepend=2 * time[0] - time[1] if len(time) > 1 else time[0] - FIRST_INTERVAL)
    return TrackedBody(
        position=batch(np.where(visible[..., None], position, 0.0)),
        visible=torch.from_numpy(visible)[None],
        head_position=batch(position[:, head]),
        head_rotation=batch(rotation[:, head]),
        interval=batch(interval),
        bone_length=batch(skeleton.bone_length),
        height=torch.tensor([skeleton.extent], dtype=torch.float32),
    )


def read_weights(path: Path, skeleton: Skeleton) -> BodyNetwork:
    """A network of UNOC's tables. Raises BodysenseError for any other file."""

    def make(config: dict[str, Any] | str) -> BodyNetwork:
        if isinstance(config, str):  # as JSON, in files of earlier versions
            config = {name: tuple(v) if isinstance(v, list) else v for name, v in json.loads(config).items()}
        return BodyNetwork(BodyNetworkConfig(**config), skeleton)

    return read_weights_file(path, make, "a network of UNOC's tables", "bodysense train unoc-tables")[0]
