"""The training loop: averaged weights, checkpoints, resumption, the best so far, bf16 through Fabric."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from lightning_fabric import Fabric
from rich.console import Console
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from bodysense.lab.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense.lab.unoc.training import Progress, moving_average


@dataclass(frozen=True)
class Schedule:
    """How long to train, and how fast."""

    steps: int = 9000
    learning_rate: float = 1e-3
    warm_up: int = 100  # steps
    last_share: float = 0.01  # of the learning rate, at the end of the cosine
    weight_decay: float = 0.02
    average_decay: float = 0.999  # of the moving average of the weights, which is what is kept
    check_every: int = 750  # steps between checkpoints
    seed: int = 1  # random seed


class Task(Protocol):
    """What a network learns and how it is judged."""

    @property
    def network(self) -> nn.Module:
        """The network to train."""
        ...

    @property
    def configuration(self) -> Any:
        """A dataclass that a checkpoint must agree on."""
        ...

    def batches(self, rng: np.random.Generator) -> Iterator[Any]:
        """Endless batches."""
        ...

    def loss(self, batch: Any, memory: Any) -> tuple[dict[str, Tensor], Any]:
        """Weighted terms, their sum first, and what is carried to the next batch; `memory` is None at first."""
        ...

    def validate(self, network: nn.Module) -> dict[str, float]:
        """Figures on validation people; the first one is the score, smaller is better."""
        ...


def rate_at(schedule: Schedule, step: int) -> float:
    """Learning rate of a step: a linear rise, then half a cosine down to `last_share`."""
    if step < schedule.warm_up:
        return schedule.learning_rate * step / schedule.warm_up
    along = (step - schedule.warm_up) / max(1, schedule.steps - schedule.warm_up)
    share = 0.5 * (1 + math.cos(math.pi * along))
    return schedule.learning_rate * (schedule.last_share + (1 - schedule.last_share) * share)


def fit(
    task: Task, schedule: Schedule, checkpoint: Path, report: Callable[[Progress], None], fabric: Fabric
) -> dict[str, float]:
    """Train the task's network, which ends with the averaged weights that did best; return its figures.

    Training continues from `checkpoint` where that file exists. Raises BodysenseError when it belongs to another
    configuration.
    """
    bare = task.network
    optimizer = torch.optim.AdamW(bare.parameters(), lr=schedule.learning_rate, weight_decay=schedule.weight_decay)
    bare = fabric.to_device(bare)
    average = AveragedModel(bare, avg_fn=partial(moving_average, decay=schedule.average_decay))
    run = identity(task.configuration, schedule)
    done, kept = load_checkpoint(checkpoint, run, bare, optimizer, average)
    best: dict[str, Any] = kept or {"score": math.inf, "step": 0, "weights": bare.state_dict()}
    batches = task.batches(np.random.default_rng([schedule.seed, done, fabric.global_rank]))
    begun, memory = time.monotonic(), None
    recent: list[dict[str, float]] = []
    for step in range(done + 1, schedule.steps + 1):
        for group in optimizer.param_groups:
            group["lr"] = rate_at(schedule, step)
        bare.train()
        terms, memory = task.loss(next(batches), memory)
        optimizer.zero_grad()
        terms["loss"].backward()
        for parameter in bare.parameters() if fabric.world_size > 1 else ():
            parameter.grad = fabric.all_reduce(parameter.grad, reduce_op="mean")  # type: ignore[assignment]
        nn.utils.clip_grad_norm_(bare.parameters(), 1.0)
        optimizer.step()
        average.update_parameters(bare)
        recent.append({name: float(value.detach()) for name, value in terms.items()})
        if step % schedule.check_every == 0 or step == schedule.steps:
            average.module.eval()
            figures = task.validate(average.module)
            score = next(iter(figures.values()))
            if score < best["score"]:
                weights = {name: value.clone() for name, value in average.module.state_dict().items()}
                best = {"score": score, "step": step, "weights": weights}
            if fabric.is_global_zero:
                save_checkpoint(checkpoint, run, step, bare, optimizer, average, best)
            mean = {name: float(np.mean([row[name] for row in recent])) for name in recent[0]}
            recent = []
            report(Progress(step, schedule.steps, time.monotonic() - begun, mean, figures))
    bare.load_state_dict(best["weights"])
    bare.eval()
    return task.validate(bare)


def fit_and_print(task: Task, schedule: Schedule, checkpoint: Path) -> None:
    """Train the task's network as `fit` does, and print how it does."""
    console = Console(width=200)

    def report(progress: Progress) -> None:
        terms, figures = _line(progress.terms, 4), _line(progress.validation, 3)
        console.print(
            f"{progress.step}/{progress.steps} {progress.seconds:.0f} s · {terms} · {figures}", highlight=False
        )

    figures = fit(task, schedule, checkpoint, report, Fabric(accelerator="auto", devices=1))
    console.print(_line(figures, 3), highlight=False)


def _line(values: dict[str, float], digits: int) -> str:
    return " ".join(f"{name} {value:.{digits}f}" for name, value in values.items())
