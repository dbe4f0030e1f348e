"""Training loop of every network: averaged weights, checkpoints, resumption, best weights and a log.

A `Task` defines loss and validation. Several processes, on one machine or more, share a training by Fabric. Each draws
its own batches, and gradients are averaged.
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

from bodysense.errors import BodysenseError
from bodysense_lab.core.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense_lab.core.options import Run
from bodysense_lab.core.precision import layer_precision

MOST_STEPS = 10**9  # steps of a run whose time is limited instead
_PACE = (5.0, 600.0)  # s from the start to the first report of the pace; longest time between two reports


@dataclass(frozen=True)
class Progress:
    """The state of a run at its start, at every checkpoint, and between checkpoints for its pace."""

    step: int
    steps: int  # of the whole run
    seconds: float  # since the start
    terms: dict[str, float]  # means of the loss since the last checkpoint; empty at the start
    validation: dict[str, float]  # empty except at checkpoints
    steps_per_second: float  # since this process started; 0 at the start
    machine: str  # device, precision of the layers, and number of processes


Report = Callable[[Progress], None]


class Task:
    """Loss, batches and validation of a training; the task of a method overrides the defaults."""

    network: Any  # the module to train
    schedule: Any  # learning_rate, average_decay, check_every, seed; part of the identity
    source: Any = None  # training data in plain values; part of the identity
    keeps_best: bool = True  # whether the best weights in validation are kept; otherwise the last averaged weights
    mixed: bool = False  # whether layers run in `precision.layer_autocast`
    clip: float = 1.0  # highest norm of the gradients of a group of parameters; a group's own `clip` overrides it

    def identity(self) -> str:
        """Return the identity of the run, which a checkpoint must have to be resumed."""
        return identity(getattr(self, "configuration", self.network.config), self.schedule, self.source)

    @property
    def steps(self) -> int:
        """Optimiser steps of the whole run."""
        return self.schedule.steps

    @property
    def patience(self) -> int | None:
        """Number of checks without progress after which the learning rate is halved; None: never."""
        return getattr(self.schedule, "patience", None)

    def optimizer(self) -> Optimizer:
        """Return the optimiser of a new run."""
        learned = [parameter for parameter in self.network.parameters() if parameter.requires_grad]
        decay = getattr(self.schedule, "weight_decay", 0.0)
        return AdamW(learned, lr=self.schedule.learning_rate, weight_decay=decay)

    def rate(self, step: int, steps: int | None = None) -> float:
        """Return the learning rate of a step of `steps` (None: those of the schedule)."""
        return rate_at(self.schedule, step, steps or self.steps)

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[Any]:
        """Yield batches from step `done` on; a resumed run draws new ones."""
        raise NotImplementedError

    def loss(self, batch: Any, memory: Any) -> tuple[dict[str, Tensor], Any]:
        """Return the weighted terms with their sum, 'loss', and the memory for the next batch.

        `memory` is None for the first batch.
        """
        raise NotImplementedError

    def validate(self, network: Any) -> dict[str, float]:
        """Return figures on validation people. The first one is the score; smaller is better."""
        raise NotImplementedError


def rate_at(schedule: Any, step: int, steps: int | None = None) -> float:
    """Return the learning rate of a step: a linear rise, then half a cosine down to `last_share` (default 0.01)."""
    if step < schedule.warm_up:
        return schedule.learning_rate * step / schedule.warm_up
    along = (step - schedule.warm_up) / max(1, (steps or schedule.steps) - schedule.warm_up)
    last, share = getattr(schedule, "last_share", 0.01), 0.5 * (1 + math.cos(math.pi * along))
    return schedule.learning_rate * (last + (1 - last) * share)


def moving_average(averaged: Tensor, current: Tensor, count: Tensor | int, decay: float) -> Tensor:
    """Return the exponential average of weights; its decay grows to `decay`, so that the first weights fade early."""
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
    """Train the task's network and return its figures; it ends with the kept averaged weights, in evaluation mode.

    Args:
        task: network, loss and validation.
        checkpoint: file from which training resumes if it exists; the log is next to it as .jsonl, one line for each
            checkpoint.
        report: called at every checkpoint; prints a line, as `pace` then does, if None.
        fabric: devices; the default ones if None.
        pace: called at the start, 5 s later, and then at growing intervals between checkpoints.

    Raises BodysenseError if the checkpoint belongs to another configuration, schedule or source.
    """
    fabric = fabric or launch_fabric()
    if report is None:
        report = pace = progress_printer()
    network, schedule = fabric.to_device(task.network), task.schedule
    optimizer = task.optimizer()
    decay = partial(moving_average, decay=schedule.average_decay)
    average = AveragedModel(network, avg_fn=decay, use_buffers=True)
    average.module.eval()
    run = task.identity()
    done, kept, spent = load_checkpoint(checkpoint, run, network, optimizer, average)
    best = kept or {"score": math.inf, "step": 0, "since": 0, "factor": 1.0, "weights": network.state_dict()}
    batches = task.batches(np.random.default_rng([schedule.seed, done, fabric.global_rank]), done)
    begun, memory, machine = time.monotonic(), None, describe_machine(fabric, task.mixed)
    recent: list[dict[str, float]] = []

    def progress(step: int, figures: dict[str, float]) -> Progress:
        seconds = time.monotonic() - begun
        mean = {name: float(np.mean([row[name] for row in recent])) for name in (recent[0] if recent else ())}
        return Progress(step, steps, seconds, mean, figures, (step - done) / seconds if recent else 0.0, machine)

    length = _RunLength(task.steps, getattr(schedule, "minutes", None), begun - spent, fabric)
    steps = length.steps_at(done)
    if fabric.is_global_zero and done < steps and pace is not None:
        pace(progress(done, {}))
    due = _pace_is_due(begun)
    for step, batch in zip(range(done + 1, MOST_STEPS), batches, strict=False):
        if step > steps:
            break
        steps = length.steps_at(step)
        for group in optimizer.param_groups:
            group["lr"] = task.rate(step, steps) * best.get("factor", 1.0)
        torch.manual_seed(schedule.seed * 1_000_003 + step)  # of dropout, so that resumed and other runs are equal
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
                kept = best if task.keeps_best else None
                save_checkpoint(checkpoint, run, step, network, optimizer, average, kept, length.seconds)
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
    """Take one optimiser step on a batch; return the terms of its loss and the memory for the next batch."""
    task.network.train()
    terms, memory = task.loss(fabric.to_device(batch), memory)
    optimizer.zero_grad()
    terms["loss"].backward()
    for parameter in task.network.parameters() if fabric.world_size > 1 else ():
        if parameter.grad is not None:
            parameter.grad = fabric.all_reduce(parameter.grad, reduce_op="mean")  # type: ignore[assignment]
    for group in optimizer.param_groups:
        nn.utils.clip_grad_norm_(group["params"], group.get("clip", task.clip))
    optimizer.step()
    return terms, memory


@dataclass(frozen=True)
class _RunLength:
    """Number of steps of a run: given, or estimated from the pace so far if its time is limited instead."""

    steps: int
    minutes: float | None
    begun: float  # s, when the run would have begun without interruption, by the clock of `time.monotonic`
    fabric: Fabric

    @property
    def seconds(self) -> float:
        """Time of the run so far, without interruptions."""
        return time.monotonic() - self.begun

    def steps_at(self, step: int) -> int:
        """Return the number of steps of the whole run, as known when `step` begins. It is `step` in the last one."""
        if self.minutes is None:
            return self.steps
        share = self.seconds / (60 * self.minutes)
        if self.fabric.world_size > 1:  # all processes stop together
            share = float(self.fabric.broadcast(share))
        if share >= 1:
            return step
        return max(step + 1, math.ceil(step / share)) if step and share > 0 else MOST_STEPS


def _pace_is_due(begun: float) -> Iterator[bool]:
    """Yield whether the pace is due: `_PACE[0]` s after `begun`, then after intervals that double."""
    wait_for, most = _PACE
    last = begun
    while True:
        due = time.monotonic() >= last + wait_for
        if due:
            last, wait_for = time.monotonic(), min(2 * wait_for, most)
        yield due


def _update_best(
    best: dict[str, Any], figures: dict[str, float], step: int, network: nn.Module, patience: int | None
) -> dict[str, Any]:
    """Return the best so far after a check; after `patience` checks without progress the learning rate is halved."""
    score = next(iter(figures.values()))
    if score < best["score"]:
        weights = {name: value.clone() for name, value in network.state_dict().items()}
        return best | {"score": score, "step": step, "since": 0, "weights": weights}
    since = best.get("since", 0) + 1
    if patience is not None and since >= patience:
        return best | {"since": 0, "factor": best["factor"] / 2}
    return best | {"since": since}


def process_seed(seed: int, rank: int) -> int:
    """Return the seed of one of the processes that share a training and draw batches by the step's number."""
    return seed + 1_000_003 * rank


def launch_fabric(devices: int = 1, nodes: int = 1, device: str = "auto") -> Fabric:
    """Return Fabric, launched on the devices of this process; all processes of a run share one folder.

    Raises BodysenseError if `device` is `cuda` and the machine has no CUDA device.
    """
    if device == "cuda" and not torch.cuda.is_available():
        raise BodysenseError("--device cuda: PyTorch finds no such device; give --device cpu, or leave it out")
    fabric = Fabric(accelerator=device, devices=devices, num_nodes=nodes, precision="32-true")
    fabric.launch()
    return fabric


def announce_run(run: Run, task: type[Task]) -> Fabric:
    """Launch Fabric for a run and print its device and precision, before data is read."""
    fabric = launch_fabric(run.devices, run.nodes, run.device)
    fabric.print(f"training on {describe_machine(fabric, task.mixed)}", flush=True)
    return fabric


def describe_machine(fabric: Fabric, mixed: bool) -> str:
    """Return a text with the device, the precision of the layers and the number of processes."""
    layers = str(layer_precision(fabric.device) if mixed else torch.float32).removeprefix("torch.")
    processes = f"{fabric.world_size} processes" if fabric.world_size > 1 else "1 process"
    return f"{fabric.device.type}, {layers} layers, {processes}"


def set_seed_and_threads(seed: int, threads: int | None) -> None:
    """Set PyTorch's seed, and its threads if given. Call it before creating a network."""
    if threads is not None:
        torch.set_num_threads(threads)
    torch.manual_seed(seed)


def progress_printer(name: str = "") -> Report:
    """Return a report that prints a line, with `name` at its head."""
    return partial(_print_progress, name)


def _print_progress(name: str, progress: Progress) -> None:
    head = f"{name} " if name else ""
    Console(width=200).print(f"{head}{progress_line(progress)}", highlight=False, soft_wrap=True)


def progress_line(progress: Progress) -> str:
    """Return a line of progress: the machine at the start, then the pace, the time remaining, and any figures."""
    done = f"step {progress.step}/{progress.steps}, {progress.seconds:.0f} s"
    if not progress.terms:
        return f"{done} · {progress.machine}"
    remaining = timedelta(seconds=round((progress.steps - progress.step) / progress.steps_per_second))
    pace = f"{progress.steps_per_second:.3g} steps/s, {remaining} remaining"
    parts = (done, pace, figures_line(progress.terms, 4), figures_line(progress.validation, 3))
    return " · ".join(part for part in parts if part)


def figures_line(values: Mapping[str, float], digits: int) -> str:
    """Return figures by name in one line."""
    return " ".join(f"{name} {value:.{digits}f}" for name, value in values.items())


S = TypeVar("S", bound=Sized)


def stream_sequences(draw: Callable[[], S], count: int, chunk: int) -> Iterator[tuple[list[tuple[S, int]], np.ndarray]]:
    """Yield chunks of `count` streams: each stream's sequence and first frame, and which streams start one (B,).

    A stream draws a new sequence when its sequence has ended.
    """
    playing = [(draw(), 0) for _ in range(count)]
    while True:
        yield playing, np.array([first == 0 for _, first in playing])
        after = [(one, first + chunk) for one, first in playing]
        playing = [(one, first) if first < len(one) else (draw(), 0) for one, first in after]


def cut_frames(pieces: Sequence[tuple[Any, int]], length: int, names: Sequence[str]) -> dict[str, Tensor]:
    """Cut `length` frames of the arrays `names` from each sequence at its start frame, and mark the `valid` frames.

    After the end the last frame is repeated, and not valid. Before the start the first frame is repeated.
    """
    wanted = [np.arange(start, start + length) for _, start in pieces]
    rows = [np.clip(frames, 0, len(one) - 1) for frames, (one, _) in zip(wanted, pieces, strict=True)]
    valid = [frames < len(one) for frames, (one, _) in zip(wanted, pieces, strict=True)]
    parts = {name: [getattr(e, name)[r] for (e, _), r in zip(pieces, rows, strict=True)] for name in names}
    return {name: torch.from_numpy(np.stack(values)) for name, values in (parts | {"valid": valid}).items()}
