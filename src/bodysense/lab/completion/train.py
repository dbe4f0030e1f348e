"""`bodysense train completion`: from recorded motion to trained weights."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import torch

from bodysense.lab.checkpoint import best_weights
from bodysense.lab.completion.corpus import read_corpus
from bodysense.lab.completion.network import CompletionNetwork
from bodysense.lab.completion.task import CompletionTask, CompletionTaskConfig
from bodysense.lab.completion.validation import validation_batches
from bodysense.lab.fit import Schedule, fit


@dataclass(frozen=True)
class CompletionTraining:
    """Train the completion network."""

    data: Path  # folder of motion with splits (docs/data.md)
    run: Path  # folder of the checkpoint and of the motion as it was read; training resumes from it
    schedule: Schedule = Schedule()
    task: CompletionTaskConfig = field(default_factory=CompletionTaskConfig)
    validation_stride: int = 3  # of the validation clips every n-th is scored at a checkpoint
    begin_with: Path | None = None  # checkpoint of an earlier run, whose best weights this one begins with
    threads: int = 1  # PyTorch threads


def train_completion(options: CompletionTraining) -> CompletionNetwork:
    """Train, or resume, and return the network with the weights that did best on validation people."""
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.schedule.seed)
    train, val = (read_corpus(options.data, split, options.run / f"{split}.npz") for split in ("train", "val"))
    print(f"{train.minutes:.0f} minutes to learn from, {val.minutes:.0f} to validate")
    network = CompletionNetwork(options.task.network)
    if options.begin_with is not None:
        network.load_state_dict(best_weights(options.begin_with, network))
    task = CompletionTask(
        network, options.task, options.schedule, train, validation_batches(val, options.validation_stride)
    )
    fit(task, options.run / "completion.ckpt")
    return network
