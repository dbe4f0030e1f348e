"""Training of networks that place points: over whole sequences or over windows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from bodysense_lab.core.fit import Task
from bodysense_lab.papers.unoc.network.losses import LossWeights, length_of, unlikelihood
from bodysense_lab.papers.unoc.network.point_network import PointNetwork, PointPrediction
from bodysense_lab.papers.unoc.sequences.body_sequences import last_frame
from bodysense_lab.papers.unoc.sequences.point_sequences import (
    PointBatch,
    PointSequence,
    carried_batches,
    collate,
    windows,
)

TYPICAL = 0.02  # m: the distance at which a squared one weighs as much as a Euclidean one


@dataclass(frozen=True)
class PointSchedule:
    """Schedule of a training."""

    steps: int = 4000
    batch: int = 128  # sequences of carried training, or windows
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
    """Return the terms of UNOC, section 4.2, without occlusion, and their sum, 'loss' (see `losses`)."""
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
    sequences: Sequence[PointSequence]
    validation: Sequence[PointSequence]
    source: Mapping[str, Any] | None = None
    clip = 5.0

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[PointBatch]:
        """Sequences side by side, or windows, without end."""
        schedule, window = self.schedule, self.network.config.window
        if window is None:
            return carried_batches(self.sequences, schedule.batch, schedule.chunk, rng)
        return windows(self.sequences, window, schedule.batch, rng)

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
def validate_points(network: PointNetwork, sequences: Sequence[PointSequence]) -> float:
    """RMSJPE over all frames and placed points, cm at the reference size."""
    training = network.training
    network.eval()
    total, count = 0.0, 0
    for sequence in sequences:
        batch = collate([(sequence, 0)], len(sequence), np.ones(1, dtype=bool))
        hidden, _ = network.recurrent(batch.features, network.start(1))
        missed = network.answer(batch.features, hidden, batch.start).offset - batch.offset
        total += float((missed**2).sum())
        count += missed[..., 0].numel()
    network.train(training)
    return 100 * math.sqrt(total / max(count, 1))


def _bones(offset: Tensor, known: Tensor, children: list[int], parents: list[int]) -> Tensor:
    """Return vectors (B, T, bones, 3) from parents to children. Some of the ends are known points."""
    points = torch.cat([offset, known, torch.zeros_like(known[..., :1, :])], dim=-2)
    return points[..., children, :] - points[..., parents, :]
