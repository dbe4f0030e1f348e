"""`bodysense train completion`: from recorded motion to trained weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import torch
from lightning_fabric import Fabric
from rich.console import Console

from bodysense.lab.completion.corpus import read_corpus
from bodysense.lab.completion.network import CompletionNetwork
from bodysense.lab.completion.task import CompletionTask, CompletionTaskConfig
from bodysense.lab.completion.validation import validation_batches
from bodysense.lab.fit import Schedule, fit
from bodysense.training.body_network import Progress


@dataclass(frozen=True)
class CompletionTraining:
    """Train the completion network."""

    data: Path  # folder of motion with splits (docs/data.md)
    run: Path  # folder of the checkpoint and of the motion as it was read; training resumes from it
    schedule: Schedule = Schedule()
    task: CompletionTaskConfig = field(default_factory=CompletionTaskConfig)
    validation_stride: int = 3  # of the validation clips every n-th is scored at a checkpoint
    threads: int = 1  # PyTorch threads


def train_completion(options: CompletionTraining) -> CompletionNetwork:
    """Train, or resume, and return the network with the weights that did best on validation people."""
    console = Console(width=200)
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.schedule.seed)
    train, val = (read_corpus(options.data, split, options.run / f"{split}.npz") for split in ("train", "val"))
    console.print(f"{train.minutes:.0f} minutes to learn from, {val.minutes:.0f} to validate", highlight=False)
    network = CompletionNetwork(options.task.network)
    task = CompletionTask(network, options.task, train, validation_batches(val, options.validation_stride))
    fabric = Fabric(accelerator="auto", devices=1)

    def report(progress: Progress) -> None:
        terms = " ".join(f"{name} {value:.4f}" for name, value in progress.terms.items())
        figures = " ".join(f"{name} {value:.3f}" for name, value in progress.validation.items())
        console.print(
            f"{progress.step}/{progress.steps} {progress.seconds:.0f} s · {terms} · {figures}", highlight=False
        )

    figures = fit(task, options.schedule, options.run / "completion.ckpt", report, fabric)
    console.print(" ".join(f"{name} {value:.3f}" for name, value in figures.items()), highlight=False)
    return network
