"""Training of the body network: on whole sequences with carried state, or on windows as in the paper (section 4.2)."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from bodysense.body.skeleton import TESTED
from bodysense.lab.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense.lab.unoc.episodes import Episode
from bodysense.lab.unoc.losses import LossWeights, Truth, body_loss
from bodysense.lab.unoc.network import BodyNetwork, BodyNetworkConfig
from bodysense.lab.unoc.sampling import Batch, collate, lanes, windows


@dataclass(frozen=True)
class Schedule:
    """How long and on what."""

    steps: int = 20_000  # of carried training; windows train by epochs
    lanes: int = 256
    chunk: int = 12  # frames of truncated backpropagation
    learning_rate: float = 1e-3
    warm_up: int = 300  # steps of carried training
    finger_share: float = 0.3  # how often a drawn clip has recorded fingers
    average_decay: float = 0.999  # the kept weights are a moving average; 0 keeps the last ones
    epochs: int = 5  # of windows
    epoch_batches: tuple[int, ...] = (256, 512, 1024, 1024, 1024)  # papers.md 1.8
    window_stride: int = 1  # train on every n-th window; 1 is the paper's
    checkpoint_every: int = 500
    seed: int = 1
    loss: LossWeights = field(default_factory=LossWeights)


@dataclass(frozen=True)
class Progress:
    """Where a run stands; handed to `report` at every checkpoint."""

    step: int
    steps: int
    seconds: float
    terms: dict[str, float]
    validation: dict[str, float]


class Learner(nn.Module):
    """Network and loss as one module, so that a step is one call on any number of devices."""

    def __init__(self, model: BodyNetwork, weights: LossWeights) -> None:
        super().__init__()
        self.model = model
        self.weights = weights

    def forward(self, batch: Batch, memory: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Loss terms of a chunk with carried memory, or of the last frame of windows."""
        if self.model.config.window is None:
            hidden, memory = self.model.recurrent(batch.features, memory)
            answer = self.model.answer(batch.features, hidden, batch.known)
            truth = Truth(batch.offset, batch.visible, batch.valid, batch.fingers)
        else:
            last = self.model.recurrent.last(batch.features)
            answer = self.model.answer(batch.features[:, -1:], last[:, None], batch.known[:, -1:])
            truth = Truth(batch.offset[:, -1:], batch.visible[:, -1:], batch.valid[:, -1:], batch.fingers)
        return body_loss(self.model, answer, truth, self.weights), memory


def train(
    model: BodyNetwork,
    schedule: Schedule,
    episodes: Sequence[Episode],
    validation: Sequence[Episode],
    checkpoint: Path,
    report: Callable[[Progress], None],
    fabric: Fabric,
) -> BodyNetwork:
    """Train and return the network with its averaged weights. Continues from `checkpoint` where that file exists.

    Raises BodysenseError when the checkpoint belongs to another configuration.
    """
    optimizer = torch.optim.Adam(model.parameters(), lr=schedule.learning_rate)
    # On its device first: what is loaded or averaged afterwards goes there too.
    network, optimizer = fabric.setup(Learner(model, schedule.loss), optimizer)
    average = AveragedModel(model, avg_fn=partial(moving_average, decay=schedule.average_decay))
    averaged = average.module
    assert isinstance(averaged, BodyNetwork)
    averaged.eval()
    run = identity(model.config, schedule)
    done, _ = load_checkpoint(checkpoint, run, model, optimizer, average)
    steps = step_count(model.config, schedule, episodes)
    memory = fabric.to_device(model.start(schedule.lanes).memory)
    batches = itertools.islice(make_batches(model.config, schedule, episodes, done, fabric.global_rank), steps - done)
    begun, recent = time.monotonic(), []
    for step, batch in enumerate((to_device(batch, fabric) for batch in batches), start=done + 1):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(model.config, schedule, step, steps)
        if model.config.window is None:
            memory = torch.where(batch.begins[:, None], 0.0, memory.detach().float())
        terms, memory = network(batch, memory)
        optimizer.zero_grad()
        fabric.backward(terms["loss"])
        fabric.clip_gradients(network, optimizer, max_norm=5.0)
        optimizer.step()
        average.update_parameters(model)
        recent.append({name: float(value.detach()) for name, value in terms.items()})
        if step % schedule.checkpoint_every == 0 or step == steps:
            if fabric.is_global_zero:
                save_checkpoint(checkpoint, run, step, model, optimizer, average)
            mean = {name: float(np.mean([row[name] for row in recent])) for name in recent[0]}
            recent = []
            report(Progress(step, steps, time.monotonic() - begun, mean, validate(averaged, validation)))
    model.load_state_dict(averaged.state_dict())
    return model


def moving_average(averaged: Tensor, current: Tensor, count: Tensor | int, decay: float) -> Tensor:
    """Exponential average of weights that forgets its beginning: the decay grows to `decay` with the steps."""
    return torch.lerp(current, averaged, min(decay, (1 + int(count)) / (10 + int(count))) if decay else 0.0)


def step_count(config: BodyNetworkConfig, schedule: Schedule, episodes: Sequence[Episode]) -> int:
    """Optimiser steps of a whole run."""
    if config.window is None:
        return schedule.steps
    fewest = sum(max(1, len(episode) // schedule.window_stride) for episode in episodes)  # windows of an epoch
    return sum(max(1, fewest // batch) for batch in schedule.epoch_batches[: schedule.epochs])


def learning_rate(config: BodyNetworkConfig, schedule: Schedule, step: int, steps: int) -> float:
    """Warm-up and cosine for carried training; constant for windows, as in the paper."""
    if config.window is not None:
        return schedule.learning_rate
    if step < schedule.warm_up:
        return schedule.learning_rate * step / schedule.warm_up
    along = (step - schedule.warm_up) / max(1, steps - schedule.warm_up)
    return schedule.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * along)))


def make_batches(
    config: BodyNetworkConfig, schedule: Schedule, episodes: Sequence[Episode], done: int, rank: int = 0
) -> Iterator[Batch]:
    """The run's batches from step `done` on; a resumed run draws anew from there, and every process for itself."""
    rng = np.random.default_rng([schedule.seed, done, rank])
    if config.window is None:
        fingers = np.array([episode.fingers for episode in episodes])
        share = np.where(fingers, schedule.finger_share, 1 - schedule.finger_share)
        length = np.array([len(episode) for episode in episodes], dtype=float)
        # Fingers are drawn by `finger_share` of the frames, spread evenly over all that have them.
        weight = share / np.where(fingers, length[fingers].sum(), length[~fingers].sum())
        return lanes(episodes, weight, schedule.lanes, schedule.chunk, rng)
    epochs = (
        windows(episodes, config.window, schedule.window_stride, batch, rng)
        for batch in schedule.epoch_batches[: schedule.epochs]
    )
    return itertools.islice(itertools.chain.from_iterable(epochs), done, None)


@torch.no_grad()
def validate(model: BodyNetwork, episodes: Sequence[Episode]) -> dict[str, float]:
    """Occluded RMSJPE (cm at the reference height, network's frame) of the network and of last-known, body and fingers.

    Where no clip has fingers, there are no figures of them.
    """
    tested = [p for p, name in enumerate(model.skeleton.points) if name.partition("_")[2] in TESTED]
    total = {key: 0.0 for key in ("body", "body_known", "finger", "finger_known")}
    count = {"body": 0, "finger": 0}
    device, training = model.scale.device, model.training
    wrist = model.skeleton.wrist_of[model.finger].tolist()
    model.eval()
    for episode in episodes:
        batch = collate([(episode, 0)], len(episode), np.ones(1, dtype=bool))
        hidden, _ = model.recurrent(batch.features.to(device), model.start(1).memory)
        offset = model.answer(batch.features.to(device), hidden, batch.known.to(device)).offset.cpu()
        for part, points in (("body", tested), ("finger", model.finger)):
            if part == "finger" and not episode.fingers:
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


def to_device(batch: Batch, fabric: Fabric) -> Batch:
    """The batch on the device that trains."""
    return Batch(*(fabric.to_device(value) for value in batch))
