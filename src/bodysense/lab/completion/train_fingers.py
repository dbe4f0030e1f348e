"""The finger network, from recorded motion to trained weights, and back from a checkpoint."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
import torch

from bodysense.errors import BodysenseError
from bodysense.lab.checkpoint import best_weights, checkpoint_identity
from bodysense.lab.completion.corpus import Corpus, read_corpus
from bodysense.lab.completion.finger_sequences import clips_with_fingers
from bodysense.lab.completion.finger_task import FingerTask, FingerTaskConfig
from bodysense.lab.completion.finger_validation import finger_validation
from bodysense.lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense.lab.completion.generated_fingers import generate_fingers, read_fingers, write_fingers
from bodysense.lab.fit import Schedule, fit


@dataclass(frozen=True)
class FingerTraining:
    """Train the finger network."""

    data: Path  # folder of motion with splits (docs/data.md)
    run: Path  # folder of the motion as it was read
    checkpoint: Path  # training resumes from it
    schedule: Schedule = Schedule(steps=2000, learning_rate=2e-3, weight_decay=0.1, check_every=500)
    task: FingerTaskConfig = field(default_factory=FingerTaskConfig)
    threads: int = 1  # PyTorch threads


def train_fingers(options: FingerTraining) -> FingerNetwork:
    """Train, or resume, and return the network with the weights that did best on validation clips."""
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.schedule.seed)
    train, val = (read_corpus(options.data, split, options.run / f"{split}.npz") for split in ("train", "val"))
    if options.task.left_out:
        train, val = (without(corpus, options.task.left_out) for corpus in (train, val))
    generated = _generated(options) if options.task.generated_hours else None
    network = FingerNetwork(options.task.network)
    task = FingerTask(network, options.task, options.schedule, train, finger_validation(val, train), generated)
    fit(task, options.checkpoint)
    return network


def without(corpus: Corpus, person: str) -> Corpus:
    """The corpus without the fingers of a person. Raises BodysenseError where it has none of theirs."""
    theirs = np.array([str(name).split("/")[0] == person for name in corpus.name]) & (corpus.finger_start >= 0)
    if not theirs.any():
        people = sorted({str(corpus.name[clip]).split("/")[0] for clip in clips_with_fingers(corpus)})
        raise BodysenseError(f"--leave-out {person}: no one of that name has fingers; valid are {', '.join(people)}")
    return corpus.of(np.flatnonzero(~theirs))


def _generated(options: FingerTraining) -> np.ndarray:
    """Generated fingers, kept in the folder of the run."""
    hours, seed = options.task.generated_hours, options.schedule.seed
    kept = options.run / f"fingers-{hours:g}h-{seed}.npz"
    if not kept.is_file():
        write_fingers(kept, generate_fingers(hours, seed))
    return read_fingers(kept)


def load_finger_network(checkpoint: Path) -> tuple[FingerNetwork, FingerTaskConfig]:
    """The finger network of a run, with the weights that did best on validation clips, and what it learned.

    Raises BodysenseError where there is no checkpoint, or one of another network.
    """
    task = checkpoint_identity(checkpoint)["network"]
    built = task.get("network", {})
    if set(built) != {one.name for one in fields(FingerConfig)}:
        raise BodysenseError(f"{checkpoint} is not of the finger network; give the .ckpt that train_fingers wrote")
    network = FingerNetwork(FingerConfig(**built))
    network.load_state_dict(best_weights(checkpoint, network))
    return network.eval(), FingerTaskConfig(
        network=network.config, generated_hours=task.get("generated_hours", 0.0), left_out=task.get("left_out", "")
    )
