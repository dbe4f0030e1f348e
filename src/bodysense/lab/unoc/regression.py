"""Training of networks that place points: one supervised loop, over whole sequences or over windows."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
import torch
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from bodysense.lab.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense.lab.unoc.losses import LossWeights
from bodysense.lab.unoc.point_episodes import PointBatch, PointEpisode, collate, lanes, windows
from bodysense.lab.unoc.point_network import Answer, PointNetwork
from bodysense.lab.unoc.training import Progress, moving_average

TYPICAL = 0.02  # m: the distance at which a squared one weighs as much as a Euclidean one


class Schedule(Protocol):
    """Of which the learning rate warms up and then falls."""

    @property
    def steps(self) -> int:
        """Of the optimiser."""
        ...

    @property
    def warm_up(self) -> int:
        """Steps until the learning rate is reached."""
        ...

    @property
    def learning_rate(self) -> float:
        """The highest."""
        ...


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


def point_loss(network: PointNetwork, answer: Answer, batch: PointBatch, schedule: PointSchedule) -> dict[str, Tensor]:
    """The terms of UNOC, section 4.2, without occlusion, and their sum, 'loss' (see `training.losses`)."""
    weights = schedule.loss
    mask = batch.valid[..., None]
    count = mask.sum().clamp(min=1)
    fingers = network.is_finger
    distance = _length(answer.offset - batch.offset)
    place_weight = torch.where(fingers, weights.finger, weights.body)
    charged = distance if schedule.distance == "euclidean" else distance.square() / TYPICAL
    position = (charged * place_weight * mask).sum() / count / distance.shape[-1]

    children, parents = network.bones
    bone, true_bone = (_bones(offset, batch.known, children, parents) for offset in (answer.offset, batch.offset))
    bone_weight = weights.finger_bone if bool(fingers.all()) else weights.body_bone
    parent = (_length(bone - true_bone) * mask).sum() / count / len(children) * weights.parent
    length = ((_length(bone) - _length(true_bone)).abs() * mask).sum() / count / len(children) * bone_weight
    terms = {"position": position, "parent": parent, "bone": length}
    if network.judge is not None:
        # Laplace likelihood: its optimum is the mean absolute error. The error itself is not pulled by it.
        reached = distance.detach() + 1e-4
        likelihood = reached / answer.error + torch.log(answer.error)
        terms["expected"] = (likelihood * mask).sum() / count / distance.shape[-1] * weights.expected_error
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def train_points(
    network: PointNetwork,
    schedule: PointSchedule,
    episodes: Sequence[PointEpisode],
    validation: Sequence[PointEpisode],
    checkpoint: Path,
    report: Callable[[Progress], None],
) -> tuple[PointNetwork, float]:
    """Train and return the network with the averaged weights that did best on `validation`, and their RMSJPE, cm.

    Continues from `checkpoint` where that file exists; raises BodysenseError when it belongs to another configuration.
    """
    optimizer = torch.optim.AdamW(network.parameters(), lr=schedule.learning_rate, weight_decay=schedule.weight_decay)
    average = AveragedModel(network, avg_fn=partial(moving_average, decay=schedule.average_decay))
    averaged = average.module
    assert isinstance(averaged, PointNetwork)
    run = identity(network.config, schedule)
    done, kept = load_checkpoint(checkpoint, run, network, optimizer, average)
    best = kept or {"score": math.inf, "step": 0, "weights": network.state_dict()}
    memory = network.start(schedule.batch)
    begun, recent = time.monotonic(), []
    steps = range(done + 1, schedule.steps + 1)
    for step, batch in zip(steps, batches(network, schedule, episodes, done), strict=False):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(schedule, step)
        network.train()
        if network.config.window is None:
            memory = torch.where(batch.begins[:, None], 0.0, memory.detach())
            hidden, memory = network.recurrent(batch.features, memory)
        else:
            hidden = network.recurrent.last(batch.features)[:, None]
        judged = batch if network.config.window is None else last_frame(batch)
        terms = point_loss(network, network.answer(judged.features, hidden, judged.start), judged, schedule)
        optimizer.zero_grad()
        terms["loss"].backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        average.update_parameters(network)
        recent.append({name: float(value.detach()) for name, value in terms.items()})
        if step % schedule.check_every == 0 or step == schedule.steps:
            score = validate_points(averaged, validation)
            if score < best["score"]:
                best = {"score": score, "step": step, "weights": averaged.state_dict()}
                best["weights"] = {name: value.clone() for name, value in best["weights"].items()}
            save_checkpoint(checkpoint, run, step, network, optimizer, average, best)
            mean = {name: float(np.mean([row[name] for row in recent])) for name in recent[0]}
            recent = []
            scores = {"rmsjpe_cm": score, "best_rmsjpe_cm": best["score"]}
            report(Progress(step, schedule.steps, time.monotonic() - begun, mean, scores))
    network.load_state_dict(best["weights"])
    return network.eval(), best["score"]


def batches(
    network: PointNetwork, schedule: PointSchedule, episodes: Sequence[PointEpisode], done: int
) -> Iterator[PointBatch]:
    """The run's batches from step `done` on; a resumed run draws anew from there."""
    rng = np.random.default_rng([schedule.seed, done])
    if network.config.window is None:
        return lanes(episodes, schedule.batch, schedule.chunk, rng)
    return windows(episodes, network.config.window, schedule.batch, rng)


def last_frame(batch: PointBatch) -> PointBatch:
    """Windows answer their last frame."""
    fixed = {"start": batch.start, "begins": batch.begins}
    return PointBatch(**{name: value[:, -1:] for name, value in batch._asdict().items() if name not in fixed}, **fixed)


def learning_rate(schedule: Schedule, step: int) -> float:
    """Warm-up, then a cosine down to a hundredth."""
    if step < schedule.warm_up:
        return schedule.learning_rate * step / schedule.warm_up
    along = (step - schedule.warm_up) / max(1, schedule.steps - schedule.warm_up)
    return schedule.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * along)))


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


def _length(vector: Tensor) -> Tensor:
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-12)
