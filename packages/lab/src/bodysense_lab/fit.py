"""The training loop of every network: averaged weights, checkpoints, resumption, the best so far, a log.

A `Task` defines loss and validation. Several processes, on one machine or more, share a training through Fabric: each
draws batches of its own, and gradients are averaged.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from lightning_fabric import Fabric
from rich.console import Console
from torch import Tensor, nn
from torch.optim import AdamW, Optimizer
from torch.optim.swa_utils import AveragedModel

from bodysense_lab.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense_lab.options import Run
from bodysense_lab.precision import layer_precision

_PACE = (5.0, 600.0)  # s from the beginning to the first report of the pace, and the most from one to the next


@dataclass(frozen=True)
class Progress:
    """The state of a run: at its beginning, between checkpoints to tell its pace, and at every checkpoint."""

    step: int
    steps: int
    seconds: float
    terms: dict[str, float]  # means since the last checkpoint; empty at the beginning
    validation: dict[str, float]  # empty but at checkpoints
    steps_per_second: float  # of this run, without the steps before a stop; 0 at the beginning
    machine: str  # device, precision of the layers, and processes


Report = Callable[[Progress], None]


class Task:
    """Loss, batches and validation of a training; a method's task overrides the defaults."""

    network: Any  # the module that is trained
    schedule: Any  # learning_rate, average_decay, check_every, seed; a checkpoint must agree on it
    source: Any = None  # what is learned from, in plain values: likewise
    keeps_best: bool = True  # else the averaged weights of the end are kept
    mixed: bool = False  # whether layers run in `precision.layer_autocast`
    clip: float = 1.0  # highest norm of the gradients of a group of parameters, unless it has a `clip` of its own

    def identity(self) -> str:
        """Settings on which a checkpoint must agree."""
        return identity(getattr(self, "configuration", self.network.config), self.schedule, self.source)

    @property
    def steps(self) -> int:
        """Optimiser steps of the whole run."""
        return self.schedule.steps

    @property
    def patience(self) -> int | None:
        """Checks without progress after which the learning rate is halved; None: it is not."""
        return getattr(self.schedule, "patience", None)

    def optimizer(self) -> Optimizer:
        """The optimiser of a new run."""
        learned = [parameter for parameter in self.network.parameters() if parameter.requires_grad]
        decay = getattr(self.schedule, "weight_decay", 0.0)
        return AdamW(learned, lr=self.schedule.learning_rate, weight_decay=decay)

    def rate(self, step: int) -> float:
        """Learning rate of a step."""
        return rate_at(self.schedule, step, self.steps)

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[Any]:
        """Batches from step `done` on; a resumed run draws new ones from there."""
        raise NotImplementedError

    def loss(self, batch: Any, memory: Any) -> tuple[dict[str, Tensor], Any]:
        """Weighted terms with their sum, 'loss', and what is carried to the next batch; `memory` is None at first."""
        raise NotImplementedError

    def validate(self, network: Any) -> dict[str, float]:
        """Figures on validation people; the first one is the score, smaller is better."""
        raise NotImplementedError


def rate_at(schedule: Any, step: int, steps: int | None = None) -> float:
    """Learning rate of a step: a linear rise, then half a cosine down to `last_share` (0.01 if it has none)."""
    if step < schedule.warm_up:
        return schedule.learning_rate * step / schedule.warm_up
    along = (step - schedule.warm_up) / max(1, (steps or schedule.steps) - schedule.warm_up)
    last, share = getattr(schedule, "last_share", 0.01), 0.5 * (1 + math.cos(math.pi * along))
    return schedule.learning_rate * (last + (1 - last) * share)


def moving_average(averaged: Tensor, current: Tensor, count: Tensor | int, decay: float) -> Tensor:
    """Exponential average of weights that forgets its beginning: the decay grows to `decay` with the steps."""
    if not averaged.is_floating_point():
        return current
    return torch.lerp(current, averaged, min(decay, (1 + int(count)) / (10 + int(count))) if decay else 0.0)


def fit(
    task: Task,
    checkpoint: Path,
    report: Report | None = None,
    fabric: Fabric | None = None,
    pace: Report | None = None,
) -> dict[str, float]:
    """Train the task's network, which ends with the averaged weights that are kept, evaluating; return its figures.

    `report` is called at every checkpoint; `pace` at the beginning, 5 s later, and then ever more rarely between
    checkpoints. Without `report`, both print a line. Training continues from `checkpoint` if that file exists; the log
    is next to it as .jsonl, a line a checkpoint. Raises BodysenseError when the checkpoint belongs to another
    configuration, schedule or source.
    """
    fabric = fabric or launch_fabric()
    if report is None:
        report = pace = progress_printer()
    network, schedule = fabric.to_device(task.network), task.schedule
    optimizer = task.optimizer()
    decay = partial(moving_average, decay=schedule.average_decay)
    average = AveragedModel(network, avg_fn=decay, use_buffers=True)
    average.module.eval()
    run, steps = task.identity(), task.steps
    done, kept = load_checkpoint(checkpoint, run, network, optimizer, average)
    best = kept or {"score": math.inf, "step": 0, "since": 0, "factor": 1.0, "weights": network.state_dict()}
    batches = task.batches(np.random.default_rng([schedule.seed, done, fabric.global_rank]), done)
    begun, memory, machine = time.monotonic(), None, describe_machine(fabric, task.mixed)
    recent: list[dict[str, float]] = []

    def progress(step: int, figures: dict[str, float]) -> Progress:
        seconds = time.monotonic() - begun
        mean = {name: float(np.mean([row[name] for row in recent])) for name in (recent[0] if recent else ())}
        return Progress(step, steps, seconds, mean, figures, (step - done) / seconds if recent else 0.0, machine)

    if fabric.is_global_zero and done < steps and pace is not None:
        pace(progress(done, {}))
    due = _pace_is_due(begun)
    for step, batch in zip(range(done + 1, steps + 1), batches, strict=False):
        for group in optimizer.param_groups:
            group["lr"] = task.rate(step) * best.get("factor", 1.0)
        torch.manual_seed(schedule.seed * 1_000_003 + step)  # of dropout: a run that goes on is the run that it was
        terms, memory = take_step(task, optimizer, batch, memory, fabric)
        average.update_parameters(network)
        recent.append({name: float(value.detach()) for name, value in terms.items()})
        if step % schedule.check_every == 0 or step == steps:
            figures = task.validate(average.module)
            if task.keeps_best:
                best = _update_best(best, figures, step, average.module, task.patience)
                figures = figures | {f"best_{next(iter(figures))}": best["score"]}
            now = progress(step, figures)
            recent.clear()
            if fabric.is_global_zero:
                save_checkpoint(checkpoint, run, step, network, optimizer, average, best if task.keeps_best else None)
                with checkpoint.with_suffix(".jsonl").open("a", encoding="utf-8") as file:
                    file.write(json.dumps(vars(now)) + "\n")
                report(now)
        elif fabric.is_global_zero and pace is not None and next(due):
            pace(progress(step, {}))
    network.load_state_dict(best["weights"] if task.keeps_best else average.module.state_dict())
    network.eval()
    return task.validate(network)


def take_step(
    task: Task, optimizer: Optimizer, batch: Any, memory: Any, fabric: Fabric
) -> tuple[dict[str, Tensor], Any]:
    """Take one optimiser step on a batch; return the terms of its loss and what is carried to the next batch."""
    task.network.train()
    terms, memory = task.loss(fabric.to_device(batch), memory)
    optimizer.zero_grad()
    terms["loss"].backward()
    _average_gradients(task.network, fabric)
    for group in optimizer.param_groups:
        nn.utils.clip_grad_norm_(group["params"], group.get("clip", task.clip))
    optimizer.step()
    return terms, memory


def _pace_is_due(begun: float) -> Iterator[bool]:
    """Yield whether the pace is to be reported now: `_PACE[0]` after a time, then after twice as long each time."""
    wait_for, most = _PACE
    last = begun
    while True:
        due = time.monotonic() >= last + wait_for
        if due:
            last, wait_for = time.monotonic(), min(2 * wait_for, most)
        yield due


def _average_gradients(network: nn.Module, fabric: Fabric) -> None:
    for parameter in network.parameters() if fabric.world_size > 1 else ():
        if parameter.grad is not None:
            parameter.grad = fabric.all_reduce(parameter.grad, reduce_op="mean")  # type: ignore[assignment]


def _update_best(
    best: dict[str, Any], figures: dict[str, float], step: int, network: nn.Module, patience: int | None
) -> dict[str, Any]:
    """The best so far after a check; the learning rate's factor is halved where nothing got better for long."""
    score = next(iter(figures.values()))
    if score < best["score"]:
        weights = {name: value.clone() for name, value in network.state_dict().items()}
        return best | {"score": score, "step": step, "since": 0, "weights": weights}
    since = best.get("since", 0) + 1
    if patience is not None and since >= patience:
        return best | {"since": 0, "factor": best["factor"] / 2}
    return best | {"since": since}


def process_seed(seed: int, rank: int) -> int:
    """Return the seed of one of the processes that share a training, whose batches are drawn by the step's number."""
    return seed + 1_000_003 * rank


def launch_fabric(devices: int = 1, nodes: int = 1) -> Fabric:
    """The devices of this process, and its place among those of a run on several, which share one folder."""
    fabric = Fabric(accelerator="auto", devices=devices, num_nodes=nodes, precision="32-true")
    fabric.launch()
    return fabric


def announce_run(run: Run, task: type[Task]) -> Fabric:
    """Return the devices of a run, and print what it trains on, before anything is read."""
    fabric = launch_fabric(run.devices, run.nodes)
    fabric.print(f"training on {describe_machine(fabric, task.mixed)}", flush=True)
    return fabric


def describe_machine(fabric: Fabric, mixed: bool) -> str:
    """Return the device, the precision of the layers and the number of processes, in words."""
    layers = str(layer_precision(fabric.device) if mixed else torch.float32).removeprefix("torch.")
    processes = f"{fabric.world_size} processes" if fabric.world_size > 1 else "1 process"
    return f"{fabric.device.type}, {layers} layers, {processes}"


def set_seed_and_threads(seed: int, threads: int | None) -> None:
    """Set PyTorch's seed, and its threads if given. Call it before a network is made."""
    if threads is not None:
        torch.set_num_threads(threads)
    torch.manual_seed(seed)


def progress_printer(name: str = "") -> Report:
    """A report that prints a line each time, after a name."""
    return partial(_print_progress, name)


def _print_progress(name: str, progress: Progress) -> None:
    head = f"{name} " if name else ""
    Console(width=200).print(f"{head}{progress_line(progress)}", highlight=False, soft_wrap=True)


def progress_line(progress: Progress) -> str:
    """Return the machine at the beginning, else the pace, the time remaining, and at a checkpoint the figures."""
    done = f"step {progress.step}/{progress.steps}, {progress.seconds:.0f} s"
    if not progress.terms:
        return f"{done} · {progress.machine}"
    remaining = timedelta(seconds=round((progress.steps - progress.step) / progress.steps_per_second))
    pace = f"{progress.steps_per_second:.3g} steps/s, {remaining} remaining"
    parts = (done, pace, figures_line(progress.terms, 4), figures_line(progress.validation, 3))
    return " · ".join(part for part in parts if part)


def figures_line(values: Mapping[str, float], digits: int) -> str:
    """Figures by name in one line."""
    return " ".join(f"{name} {value:.{digits}f}" for name, value in values.items())


S = TypeVar("S", bound=Sized)


def stream_sequences(draw: Callable[[], S], count: int, chunk: int) -> Iterator[tuple[list[tuple[S, int]], np.ndarray]]:
    """Yield chunks of `count` streams: each stream's sequence and first frame, and which streams begin (B,).

    A stream whose sequence has ended draws the next one.
    """
    playing = [(draw(), 0) for _ in range(count)]
    while True:
        yield playing, np.array([first == 0 for _, first in playing])
        after = [(one, first + chunk) for one, first in playing]
        playing = [(one, first) if first < len(one) else (draw(), 0) for one, first in after]


def cut_frames(pieces: Sequence[tuple[Any, int]], length: int, names: Sequence[str]) -> dict[str, Tensor]:
    """Cut `length` frames of some arrays from each sequence at its start frame, and say which of them are `valid`.

    Past the end the last frame repeats, not valid; a negative start repeats the first frame before it.
    """
    wanted = [np.arange(start, start + length) for _, start in pieces]
    rows = [np.clip(frames, 0, len(one) - 1) for frames, (one, _) in zip(wanted, pieces, strict=True)]
    valid = [frames < len(one) for frames, (one, _) in zip(wanted, pieces, strict=True)]
    parts = {name: [getattr(e, name)[r] for (e, _), r in zip(pieces, rows, strict=True)] for name in names}
    return {name: torch.from_numpy(np.stack(values)) for name, values in (parts | {"valid": valid}).items()}
