"""Training of networks that place points: over whole sequences or over windows.

Episodes for networks that place points: motion turned into what they read and should say, and batches of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.resting import resting_offset
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.io.clip import Clip
from bodysense_lab.fit import Task, cut, played
from bodysense_lab.unoc.point_network import PointNetwork, PointPrediction, TrackedPoints
from bodysense_lab.unoc.task import LossWeights, Variation, last_frame, length_of, unlikelihood, varied


@dataclass(frozen=True, eq=False)
class PointEpisode:
    """One clip, ready to learn from: float32."""

    features: np.ndarray  # (T, F) what the network reads
    start: np.ndarray  # (O, 3) resting offsets
    known: np.ndarray  # (T, R, 3) offsets of the points that are read
    offset: np.ndarray  # (T, O, 3) the truth

    def __len__(self) -> int:
        return len(self.features)


class PointBatch(NamedTuple):
    """Frames of B episodes; `begins` marks those that start with this batch."""

    features: Tensor  # (B, T, F)
    start: Tensor  # (B, O, 3)
    known: Tensor  # (B, T, R, 3)
    offset: Tensor  # (B, T, O, 3)
    valid: Tensor  # (B, T) bool
    begins: Tensor  # (B,) bool


def make_point_episode(
    clip: Clip, network: PointNetwork, variation: Variation, rng: np.random.Generator
) -> PointEpisode:
    """Prepare a canonical clip, varied, for `network`."""
    tracked, placed = tracked_of(varied(clip, variation, rng).pose, network)
    with torch.no_grad():
        prepared, offset = network.prepare(tracked), network.offsets(placed, tracked)
    return PointEpisode(
        features=prepared.features[0].numpy(),
        start=prepared.start[0].numpy(),
        known=prepared.known[0].numpy(),
        offset=offset[0].numpy(),
    )


def tracked_of(pose: Pose, network: PointNetwork) -> tuple[TrackedPoints, Tensor]:
    """Return the inputs of `network` for a motion (T, …), and the true world positions (1, T, O, 3) m."""
    skeleton = pose.skeleton
    position, rotation = (np.asarray(values, dtype=np.float32)[None] for values in forward_kinematics(pose))
    places = skeleton.indices(network.config.places)
    tracked = TrackedPoints(
        position=torch.from_numpy(position[..., skeleton.indices(network.config.reads), :]),
        rotation=torch.from_numpy(rotation[..., skeleton.indices(THREE_POINTS), :]),
        rest=torch.tensor(resting_offset(skeleton)[None, places], dtype=torch.float32),
        bone_length=torch.tensor(skeleton.bone_length[None], dtype=torch.float32),
        height=torch.tensor([skeleton.height], dtype=torch.float32),
    )
    return tracked, torch.from_numpy(position[..., places, :])


def collate(pieces: Sequence[tuple[PointEpisode, int]], length: int, begins: np.ndarray) -> PointBatch:
    """Cut `length` frames from each episode at its start frame (see `cut`)."""
    return PointBatch(
        **cut(pieces, length, ("features", "known", "offset")),
        start=torch.from_numpy(np.stack([episode.start for episode, _ in pieces])),
        begins=torch.from_numpy(begins),
    )


def lanes(
    episodes: Sequence[PointEpisode], lane_count: int, chunk: int, rng: np.random.Generator
) -> Iterator[PointBatch]:
    """Endless chunks of whole clips, `lane_count` side by side, whose state carries over except where `begins`."""
    # A drawn clip plays whole, so that it counts by its length already.
    for pieces, begins in played(lambda: episodes[int(rng.integers(len(episodes)))], lane_count, chunk):
        yield collate(pieces, chunk, begins)


def windows(
    episodes: Sequence[PointEpisode], window: int, batch: int, rng: np.random.Generator
) -> Iterator[PointBatch]:
    """Endless batches of windows that end at a frame drawn from all frames of all clips."""
    length = np.array([len(episode) for episode in episodes])
    first = np.cumsum(length) - length
    while True:
        drawn = rng.integers(length.sum(), size=batch)
        which = np.searchsorted(first, drawn, side="right") - 1
        pieces = [(episodes[k], int(frame - first[k]) - window + 1) for k, frame in zip(which, drawn, strict=True)]
        yield collate(pieces, window, np.ones(batch, dtype=bool))


TYPICAL = 0.02  # m: the distance at which a squared one weighs as much as a Euclidean one


@dataclass(frozen=True)
class PointSchedule:
    """How long and on what."""

    steps: int = 4000
    batch: int = 128  # lanes of carried training, or windows
    chunk: int = 12  # frames of truncated backpropagation
    learning_rate: float = 1e-3
    warm_up: int = 100  # steps
    weight_decay: float = 0.0
    average_decay: float = 0.998  # the kept weights are a moving average; 0 keeps the last ones
    check_every: int = 200  # steps between checkpoints, each of which measures the average and keeps it if it is best
    seed: int = 1
    loss: LossWeights = field(default_factory=LossWeights)
    # 'squared' has the mean as its optimum where the input leaves several answers, as fingers do; 'euclidean', the
    # paper's, something like the median.
    distance: Literal["euclidean", "squared"] = "euclidean"


def point_loss(
    network: PointNetwork, answer: PointPrediction, batch: PointBatch, schedule: PointSchedule
) -> dict[str, Tensor]:
    """The terms of UNOC, section 4.2, without occlusion, and their sum, 'loss' (see `losses`)."""
    weights = schedule.loss
    mask = batch.valid[..., None]
    count = mask.sum().clamp(min=1)
    fingers = network.is_finger
    distance = length_of(answer.offset - batch.offset)
    place_weight = torch.where(fingers, weights.finger, weights.body)
    charged = distance if schedule.distance == "euclidean" else distance.square() / TYPICAL
    position = (charged * place_weight * mask).sum() / count / distance.shape[-1]

    children, parents = network.bones
    bone, true_bone = (_bones(offset, batch.known, children, parents) for offset in (answer.offset, batch.offset))
    bone_weight = weights.finger_bone if bool(fingers.all()) else weights.body_bone
    parent = (length_of(bone - true_bone) * mask).sum() / count / len(children) * weights.parent
    length = ((length_of(bone) - length_of(true_bone)).abs() * mask).sum() / count / len(children) * bone_weight
    terms = {"position": position, "parent": parent, "bone": length}
    if network.judge is not None:
        likelihood = unlikelihood(distance, answer.error)
        terms["expected"] = (likelihood * mask).sum() / count / distance.shape[-1] * weights.expected_error
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


@dataclass(frozen=True, eq=False)
class PointTask(Task):
    """Training of a network that places points, on whole sequences or on windows."""

    network: PointNetwork
    schedule: PointSchedule
    episodes: Sequence[PointEpisode]
    validation: Sequence[PointEpisode]
    source: Mapping[str, Any] | None = None
    clip = 5.0

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[PointBatch]:
        """Sequences side by side, or windows, without end."""
        schedule, window = self.schedule, self.network.config.window
        if window is None:
            return lanes(self.episodes, schedule.batch, schedule.chunk, rng)
        return windows(self.episodes, window, schedule.batch, rng)

    def loss(self, batch: PointBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor | None]:
        """Loss terms of a chunk with carried memory, or of the last frame of windows."""
        network = self.network
        if self.network.config.window is None:
            before = network.start(len(batch.begins)) if memory is None else memory.detach()
            hidden, memory = network.recurrent(batch.features, torch.where(batch.begins[:, None], 0.0, before))
        else:
            hidden, batch = network.recurrent.last(batch.features)[:, None], last_frame(batch)
        return point_loss(network, network.answer(batch.features, hidden, batch.start), batch, self.schedule), memory

    def validate(self, network: PointNetwork) -> dict[str, float]:
        """RMSJPE, cm."""
        return {"rmsjpe_cm": validate_points(network, self.validation)}


@torch.no_grad()
def validate_points(network: PointNetwork, episodes: Sequence[PointEpisode]) -> float:
    """RMSJPE over all frames and placed points, cm at the reference size."""
    training = network.training
    network.eval()
    total, count = 0.0, 0
    for episode in episodes:
        batch = collate([(episode, 0)], len(episode), np.ones(1, dtype=bool))
        hidden, _ = network.recurrent(batch.features, network.start(1))
        missed = network.answer(batch.features, hidden, batch.start).offset - batch.offset
        total += float((missed**2).sum())
        count += missed[..., 0].numel()
    network.train(training)
    return 100 * math.sqrt(total / max(count, 1))


def _bones(offset: Tensor, known: Tensor, children: list[int], parents: list[int]) -> Tensor:
    """Vectors from parents to children (B, T, bones, 3), some of whose ends are known."""
    points = torch.cat([offset, known, torch.zeros_like(known[..., :1, :])], dim=-2)
    return points[..., children, :] - points[..., parents, :]
