"""Training of the networks of arms and hands: losses and schedule of PAHMT (sections 3.4 and 4.2)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from bodysense_lab.core.checkpoint import identity
from bodysense_lab.core.fit import Task, process_seed
from bodysense_lab.core.precision import layer_autocast
from bodysense_lab.data.windows import Windows
from bodysense_lab.papers.pahmt.errors import ARMS, table_errors
from bodysense_lab.papers.pahmt.network import ArmNetwork
from bodysense_lab.papers.pahmt.options import ArmNetworkConfig, ArmSchedule, VideoSimulation
from bodysense_lab.papers.pahmt.recordings import ArmBatch, ArmRecordings, arm_positions, arms_alone, make_batch

_VALIDATED = 192  # windows that are enough to see how a run goes
_WATCHED = ("overall_m", "arms_deg", "hands_m", "fingers_deg")  # errors in a run's log


class Pair(nn.Module):
    """The network and its discriminator."""

    def __init__(self, network: ArmNetwork) -> None:
        super().__init__()
        self.network, self.discriminator = network, Discriminator(network.config)


def arm_loss(network: ArmNetwork, predicted: Tensor, batch: ArmBatch, schedule: ArmSchedule) -> dict[str, Tensor]:
    """Return the weighted terms of eq. 18 and their sum, 'loss', for regressed rotations (B, T, joints, 3 or 6).

    'rotation' is the L1 distance of what is regressed (eq. 15), 'smooth' the L1 norm of its change (eq. 16), 'fk' the
    distance of joints on a character's arms, chest fixed (eq. 17). Unknown joints are left out.
    """
    joints = list(network.config.joints)
    known, truth = batch.known[:, None, joints], batch.rotation[:, :, joints]
    wanted, terms = network.regressed(truth), {}
    if "rotation" in schedule.losses:
        heavier = torch.tensor([schedule.arms if joint in ARMS else 1.0 for joint in joints])
        terms["rotation"] = schedule.rotation * _mean((predicted - wanted).abs().mean(dim=-1), known * heavier)
    if "smooth" in schedule.losses:
        terms["smooth"] = schedule.smooth * _mean((predicted[:, 1:] - predicted[:, :-1]).abs().mean(dim=-1), known)
    if "fk" in schedule.losses or "motion" in schedule.losses:
        missed = arm_positions(network.quaternions(predicted), joints) - arm_positions(truth, joints)
        there = points_known(batch.known, joints)[:, None]
        if "fk" in schedule.losses:
            terms["fk"] = schedule.fk * _mean(_length(missed), there)
        if "motion" in schedule.losses:
            terms["motion"] = schedule.motion * _mean(_length(missed[:, 1:] - missed[:, :-1]), there)
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def points_known(known: Tensor, joints: list[int]) -> Tensor:
    """Return (B, 49) bool: points of `arms_alone` whose parent joint is predicted and `known` (B, 38)."""
    skeleton = arms_alone()
    affected = torch.zeros(len(known), len(skeleton.points), dtype=torch.bool)
    for point in range(1, len(skeleton.points)):
        above = skeleton.parents[point] - 1  # `ARM_JOINTS` follow the chest
        if above in joints:
            affected[:, point] = known[:, above]
    return affected


@dataclass(frozen=True, eq=False)
class ArmTask(Task):
    """Training of a network of arms and hands, with a discriminator that separates its output from recordings."""

    network: Pair
    schedule: ArmSchedule
    frames: ArmRecordings
    validation: ArmRecordings
    source: Mapping[str, Any] | None = None
    rank: int = 0  # place among the processes that share the training: each draws windows of its own
    mixed = True

    def identity(self) -> str:
        """Settings on which a checkpoint must agree."""
        return identity(self.network.network.config, self.schedule, self.source)

    @property
    def steps(self) -> int:
        """Optimiser steps of the whole run."""
        return step_count(self.frames, self.schedule)

    @cached_property
    def epoch_steps(self) -> int:
        """Steps in which every window with hands is seen once."""
        return epoch_steps(self.frames, self.schedule)

    def optimizer(self) -> torch.optim.Optimizer:
        """Adam with the paper's momentum and decay; the discriminator's gradients are not clipped."""
        schedule, pair = self.schedule, self.network
        groups = [
            {"params": list(pair.network.parameters())},
            {"params": list(pair.discriminator.parameters()), "clip": math.inf},
        ]
        betas = (schedule.momentum, 0.999)
        return torch.optim.Adam(groups, lr=schedule.learning_rate, betas=betas, weight_decay=schedule.weight_decay)

    def rate(self, step: int, steps: int | None = None) -> float:
        """Return the learning rate: halved every `halve_every` epochs."""
        epoch = (step - 1) // self.epoch_steps
        return self.schedule.learning_rate * 0.5 ** (epoch // self.schedule.halve_every)

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[ArmBatch]:
        """The batch of each step, whatever went before."""
        windows, drawn = self.frames.windows(), replace(self.schedule, seed=process_seed(self.schedule.seed, self.rank))
        return (batch_of(self.frames, windows, drawn, step) for step in itertools.count(done + 1))

    def loss(self, batch: ArmBatch, memory: None) -> tuple[dict[str, Tensor], None]:
        """Compute the loss of the network plus, with 'gan', of the discriminator (eqs. 13, 14), gradients apart."""
        pair, schedule = self.network, self.schedule
        with layer_autocast(batch.rotation.device):
            predicted = pair.network(batch.window).float()
        terms = arm_loss(pair.network, predicted, batch, schedule)
        if "gan" in schedule.losses:
            pair.discriminator.requires_grad_(False)
            terms["gan"] = schedule.gan * _judged(pair.discriminator(predicted), 1.0)
            pair.discriminator.requires_grad_(True)
            recorded = pair.network.regressed(batch.rotation[:, :, list(pair.network.config.joints)])
            discriminator_loss = _judged(pair.discriminator(recorded), 1.0) + _judged(
                pair.discriminator(predicted.detach()), 0.0
            )
            terms["told"] = discriminator_loss / 2
            terms["loss"] = terms["loss"] + terms["gan"] + terms["told"]
        return terms, None

    def validate(self, network: Pair) -> dict[str, float]:
        """See `validate_arms`."""
        return validate_arms(network.network, self.validation, self.schedule.studio)


def epoch_steps(frames: ArmRecordings, schedule: ArmSchedule) -> int:
    """Steps in which every window with hands is seen once."""
    return max(1, len(frames.windows()) // schedule.batch)


def step_count(frames: ArmRecordings, schedule: ArmSchedule) -> int:
    """Optimiser steps of a whole run."""
    whole = schedule.epochs * epoch_steps(frames, schedule)
    return whole if schedule.steps is None else min(schedule.steps, whole)


def batch_of(frames: ArmRecordings, windows: Windows, schedule: ArmSchedule, step: int) -> ArmBatch:
    """The batch of a step, the same for every network of this seed: "we fix the random seed for generating batches"."""
    epoch, place = divmod(step - 1, max(1, len(windows) // schedule.batch))
    order = np.random.default_rng([schedule.seed, epoch]).permutation(len(windows))
    which = order[place * schedule.batch : (place + 1) * schedule.batch]
    rng = np.random.default_rng([schedule.seed, step, 1])
    stiff = round(schedule.without_hands * len(which))
    if not stiff:
        return make_batch(frames, windows, which, schedule.studio, rng)
    others = frames.windows(fingers=False)
    some = rng.integers(len(others), size=stiff)
    both = replace(
        windows,
        start=np.concatenate([windows.start[which[stiff:]], others.start[some]]),
        clip=np.concatenate([windows.clip[which[stiff:]], others.clip[some]]),
    )
    return make_batch(frames, both, np.arange(len(both)), schedule.studio, rng)


def validation_batches(frames: ArmRecordings, studio: VideoSimulation) -> Iterator[ArmBatch]:
    """The windows on which runs are watched, always filmed alike, not mirrored."""
    studio = replace(studio, mirrored=False)
    windows, rng = frames.windows(), np.random.default_rng(0)
    which = np.linspace(0, len(windows) - 1, min(_VALIDATED, len(windows))).astype(np.int64)
    for some in np.array_split(which, max(1, len(which) // 64)):
        yield make_batch(frames, windows, some, studio, rng)


@torch.no_grad()
def validate_arms(
    network: ArmNetwork, frames: ArmRecordings, studio: VideoSimulation = VideoSimulation()
) -> dict[str, float]:
    """Mean errors on validation windows: `overall_m` (not of hands alone), `hands_m`, `arms_deg`, `fingers_deg`."""
    training = network.training
    network.eval()
    rows: list[dict[str, float]] = []
    for batch in validation_batches(frames, studio):
        predicted = network.quaternions(network(batch.window)).numpy()
        errors = table_errors(predicted, batch.rotation.numpy(), network.config.joints)
        rows.append({name: float(errors[name].mean()) for name in _WATCHED if name in errors})
    network.train(training)
    return {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}


def _judged(logit: Tensor, target: float) -> Tensor:
    return binary_cross_entropy_with_logits(logit, torch.full_like(logit, target))


def _mean(values: Tensor, known: Tensor) -> Tensor:
    """The mean of values (B, T, N) where they are known, (B, 1, N)."""
    return (values * known).sum() / (known.expand_as(values).sum().clamp(min=1))


def _length(vector: Tensor) -> Tensor:
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-12)


class Discriminator(nn.Module):
    """Tells recorded sequences of rotations from estimated ones (section 3.4): three convolutions over time."""

    def __init__(self, config: ArmNetworkConfig) -> None:
        super().__init__()
        count, width = config.size * len(config.joints), 128
        self.layers = nn.Sequential(
            *(nn.Conv1d(count, width, 4, 2, 1), nn.LeakyReLU(0.2)),
            *(nn.Conv1d(width, width, 4, 2, 1), nn.LeakyReLU(0.2)),
            nn.Conv1d(width, 1, 3, padding=1),
        )

    def forward(self, rotation: Tensor) -> Tensor:
        """Rotations (B, T, joints, 3 or 6) → logits (B, T / 4) of being recorded."""
        return self.layers(rotation.flatten(-2).mT)[:, 0]
