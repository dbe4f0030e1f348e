"""The finger network, from recorded motion to trained weights, and back from a checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path

import torch

from bodysense.errors import BodysenseError
from bodysense.lab.completion.corpus import read_corpus
from bodysense.lab.completion.finger_task import FingerTask, FingerTaskConfig
from bodysense.lab.completion.finger_validation import finger_validation
from bodysense.lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense.lab.fit import Schedule, fit_and_print
from bodysense.training.checkpoint import best_weights, checkpoint_identity


@dataclass(frozen=True)
class FingerTraining:
    """Train the finger network."""

    data: Path  # folder of motion with splits (docs/data.md)
    run: Path  # folder of the motion as it was read
    checkpoint: Path  # training resumes from it
    schedule: Schedule = Schedule(steps=3000, learning_rate=2e-3, weight_decay=0.1)
    task: FingerTaskConfig = field(default_factory=FingerTaskConfig)
    threads: int = 1  # PyTorch threads


def train_fingers(options: FingerTraining) -> FingerNetwork:
    """Train, or resume, and return the network with the weights that did best on validation clips."""
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.schedule.seed)
    train, val = (read_corpus(options.data, split, options.run / f"{split}.npz") for split in ("train", "val"))
    network = FingerNetwork(options.task.network)
    task = FingerTask(network, options.task, train, finger_validation(val, train))
    fit_and_print(task, options.schedule, options.checkpoint)
    return network


def load_finger_network(checkpoint: Path) -> FingerNetwork:
    """The finger network of a run, with the weights that did best on validation clips.

    Raises BodysenseError where there is no checkpoint, or one of another network.
    """
    built = checkpoint_identity(checkpoint)["network"].get("network", {})
    if set(built) != {one.name for one in fields(FingerConfig)}:
        raise BodysenseError(f"{checkpoint} is not of the finger network; give the .ckpt that train_fingers wrote")
    network = FingerNetwork(FingerConfig(**built))
    network.load_state_dict(best_weights(checkpoint, network))
    return network.eval()
