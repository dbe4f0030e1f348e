"""Training of the body network: on whole sequences with carried state, or on windows as in the paper (section 4.2)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bodysense_lab.core.fit import Task, rate_at
from bodysense_lab.core.precision import layer_autocast
from bodysense_lab.core.scoring import scored_points
from bodysense_lab.papers.unoc.network.losses import LossWeights, body_loss
from bodysense_lab.papers.unoc.network.network import BodyNetwork, BodyNetworkConfig
from bodysense_lab.papers.unoc.sequences.body_sequences import (
    BodyBatch,
    BodySequence,
    carried_batches,
    collate,
    last_frame,
    windows,
)

CARRIED_STEPS = 20_000


@dataclass(frozen=True)
class BodySchedule:
    """Schedule of a training."""

    steps: int | None = None  # at most; None: `CARRIED_STEPS` of carried training, all epochs of windows
    lanes: int = 256
    chunk: int = 12  # frames of truncated backpropagation
    learning_rate: float = 1e-3
    warm_up: int = 300  # steps of carried training
    finger_share: float = 0.3  # how often a drawn clip has recorded fingers
    average_decay: float = 0.999  # the kept weights are a moving average; 0 keeps the last ones
    epochs: int = 5  # of windows
    epoch_batches: tuple[int, ...] = (256, 512, 1024, 1024, 1024)  # reproduce.md 1.8
    window_stride: int = 1  # train on every n-th window; 1 is the paper's
    check_every: int = 500
    seed: int = 1
    loss: LossWeights = field(default_factory=LossWeights)


@dataclass(frozen=True, eq=False)
class BodyTask(Task):
    """Training of the body network on whole sequences with carried state, or on windows as in the paper."""

    network: BodyNetwork
    schedule: BodySchedule
    sequences: Sequence[BodySequence]
    validation: Sequence[BodySequence]
    source: Mapping[str, Any] | None = None
    keeps_best = False
    mixed = True
    clip = 5.0

    @property
    def steps(self) -> int:
        """Optimiser steps of the whole run."""
        return step_count(self.network.config, self.schedule, self.sequences)

    def rate(self, step: int, steps: int | None = None) -> float:
        """Warm-up and cosine for carried training; constant for windows, as in the paper."""
        if self.network.config.window is not None:
            return self.schedule.learning_rate
        return rate_at(self.schedule, step, steps or self.steps)

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[BodyBatch]:
        """See `make_batches`."""
        return make_batches(self.network.config, self.schedule, self.sequences, rng, done)

    def loss(self, batch: BodyBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor | None]:
        """Loss terms of a chunk with carried memory, or of the last frame of windows."""
        network = self.network
        if memory is None:
            memory = network.start(len(batch.begins)).memory
        with layer_autocast(batch.features.device):
            if network.config.window is None:
                memory = torch.where(batch.begins[:, None], 0.0, memory.detach().float())
                hidden, memory = network.recurrent(batch.features, memory)
            else:
                hidden, batch = network.recurrent.last(batch.features)[:, None], last_frame(batch)
            answer = network.answer(batch.features, hidden, batch.known)
            return body_loss(network, answer, batch, self.schedule.loss), memory

    def validate(self, network: BodyNetwork) -> dict[str, float]:
        """See `validate`."""
        return validate(network, self.validation)


def step_count(config: BodyNetworkConfig, schedule: BodySchedule, sequences: Sequence[BodySequence]) -> int:
    """Return the optimiser steps of a whole run."""
    most = schedule.steps
    if config.window is None:
        return CARRIED_STEPS if most is None else most
    fewest = sum(max(1, len(sequence) // schedule.window_stride) for sequence in sequences)  # windows of an epoch
    whole = sum(max(1, fewest // batch) for batch in schedule.epoch_batches[: schedule.epochs])
    return whole if most is None else min(most, whole)


def make_batches(
    config: BodyNetworkConfig,
    schedule: BodySchedule,
    sequences: Sequence[BodySequence],
    rng: np.random.Generator,
    done: int,
) -> Iterator[BodyBatch]:
    """Yield the run's batches from step `done` on: sequences without end, or the epochs of windows."""
    if config.window is None:
        fingers = np.array([sequence.fingers for sequence in sequences])
        share = np.where(fingers, schedule.finger_share, 1 - schedule.finger_share)
        length = np.array([len(sequence) for sequence in sequences], dtype=float)
        # Fingers are drawn by `finger_share` of the frames, spread evenly over all that have them.
        weight = share / np.where(fingers, length[fingers].sum(), length[~fingers].sum())
        return carried_batches(sequences, weight, schedule.lanes, schedule.chunk, rng)
    epochs = (
        windows(sequences, config.window, schedule.window_stride, batch, rng)
        for batch in schedule.epoch_batches[: schedule.epochs]
    )
    return itertools.islice(itertools.chain.from_iterable(epochs), done, None)


@torch.no_grad()
def validate(model: BodyNetwork, sequences: Sequence[BodySequence]) -> dict[str, float]:
    """Occluded RMSJPE (cm at the reference height, network's frame) of the network and of last-known, body and fingers.

    Without clips with fingers, their figures are missing.
    """
    tested = scored_points(model.skeleton)
    total = {key: 0.0 for key in ("body", "body_known", "finger", "finger_known")}
    count = {"body": 0, "finger": 0}
    device, training = model.scale.device, model.training
    wrist = model.skeleton.wrist_of[model.finger].tolist()
    model.eval()
    for sequence in sequences:
        batch = collate([(sequence, 0)], len(sequence), np.ones(1, dtype=bool))
        hidden, _ = model.recurrent(batch.features.to(device), model.start(1).memory)
        offset = model.answer(batch.features.to(device), hidden, batch.known.to(device)).offset.cpu()
        for part, points in (("body", tested), ("finger", model.finger)):
            if part == "finger" and not sequence.fingers:
                continue
            mask = ~batch.visible[..., points]
            count[part] += int(mask.sum())
            for key, guess in ((part, offset), (f"{part}_known", batch.known)):
                missed = guess - batch.offset
                if part == "finger" and model.config.finger_origin == "head":
                    missed[..., points, :] -= missed[..., wrist, :]
                squared = (missed[..., points, :] ** 2).sum(dim=-1)
                total[key] += float((squared * mask).sum())
    model.train(training)
    hidden = {key: count[key.partition("_")[0]] for key in total}
    return {key: 100 * math.sqrt(value / hidden[key]) for key, value in total.items() if hidden[key]}
