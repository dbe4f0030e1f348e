"""Training of the networks of a glove (two-hands, section 3.3): how long, and the loop. What is learned is a task."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from bodysense.lab.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense.lab.fit import Progress, moving_average, rate_at

HIDDEN_SHARE = (0.70, 0.17, 0.08, 0.05)  # how often one to four markers are hidden (two-hands, Fig. 13)
EVEN_SHARE = (0.4, 0.25, 0.2, 0.15)  # ours: so that four are learned, too


@dataclass(frozen=True)
class GloveSchedule:
    """How long and on what. The learning rate warms up and falls as a cosine, or, with `patience`, is halved."""

    steps: int = 20_000
    batch: int = 256
    learning_rate: float = 1e-3
    warm_up: int = 200  # steps
    patience: int | None = None  # checks without progress after which the learning rate is halved: the paper's way
    average_decay: float = 0.999  # the kept weights are a moving average; 0 keeps the last ones
    check_every: int = 1000  # steps
    noise: float = 0.0003  # m, of every marker in every frame
    hidden_share: tuple[float, ...] = EVEN_SHARE
    # Of markers also the change of the error over 0.1 to 2 s is learned, for at run time the error at the moment of
    # occlusion is taken off (two-hands, section 3.2.2, Discontinuities).
    change: float = 1.0
    squared: bool = False  # mean squared error, the paper's, of markers or of angles; else distances
    seed: int = 1


PAPER_MARKER_SCHEDULE = GloveSchedule(
    batch=32, patience=5, average_decay=0.0, noise=0.0, hidden_share=HIDDEN_SHARE, change=0.0, squared=True
)
PAPER_JOINT_SCHEDULE = GloveSchedule(batch=32, patience=5, average_decay=0.0, noise=0.0, squared=True)


class Task(Protocol):
    """What a network learns."""

    def loss(self, network: Any, rng: np.random.Generator) -> dict[str, Tensor]:
        """Of one batch: its terms and their sum, 'loss'."""
        ...

    def validate(self, network: Any) -> float:
        """The error on frames that are not learned, cm."""
        ...


def train_glove(
    network: nn.Module,
    task: Task,
    schedule: GloveSchedule,
    source: dict[str, Any],
    checkpoint: Path,
    report: Callable[[Progress], None],
) -> tuple[nn.Module, float]:
    """Train and return the network with the averaged weights that did best in validation, and their error, cm.

    Every step draws from a generator of its own, so that a run continued from `checkpoint` is the same run. `source` is
    what is learned from, in plain values. Raises BodysenseError when the checkpoint belongs to another configuration.
    """
    optimizer = torch.optim.Adam(network.parameters(), lr=schedule.learning_rate)
    average = AveragedModel(network, avg_fn=partial(moving_average, decay=schedule.average_decay))
    run = identity(network.config, schedule, source)
    done, kept = load_checkpoint(checkpoint, run, network, optimizer, average)
    best = kept or {"score": math.inf, "step": 0, "since": 0, "factor": 1.0, "weights": network.state_dict()}
    begun, recent = time.monotonic(), []
    for step in range(done + 1, schedule.steps + 1):
        falling = rate_at(schedule, step) if schedule.patience is None else schedule.learning_rate
        for group in optimizer.param_groups:
            group["lr"] = falling * best["factor"]
        network.train()
        torch.manual_seed(schedule.seed * 1_000_003 + step)  # of dropout
        terms = task.loss(network, np.random.default_rng([schedule.seed, step]))
        optimizer.zero_grad()
        terms["loss"].backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        average.update_parameters(network)
        recent.append({name: float(value.detach()) for name, value in terms.items()})
        if step % schedule.check_every == 0 or step == schedule.steps:
            score = task.validate(average.module.eval())
            best = _better(best, score, step, average.module, schedule)
            save_checkpoint(checkpoint, run, step, network, optimizer, average, best)
            mean = {name: float(np.mean([row[name] for row in recent])) for name in recent[0]}
            recent = []
            scores = {"error_cm": score, "best_error_cm": best["score"]}
            report(Progress(step, schedule.steps, time.monotonic() - begun, mean, scores))
    network.load_state_dict(best["weights"])
    return network.eval(), best["score"]


def _better(
    best: dict[str, Any], score: float, step: int, network: nn.Module, schedule: GloveSchedule
) -> dict[str, Any]:
    """The best so far after a check; the learning rate's factor is halved where it did not help for long."""
    if score < best["score"]:
        weights = {name: value.clone() for name, value in network.state_dict().items()}
        return best | {"score": score, "step": step, "since": 0, "weights": weights}
    since = best["since"] + 1
    if schedule.patience is not None and since >= schedule.patience:
        return best | {"since": 0, "factor": best["factor"] / 2}
    return best | {"since": since}
