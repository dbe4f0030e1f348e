"""The finger network, from recorded motion to trained weights, and back from a checkpoint."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.lab.checkpoint import best_weights, checkpoint_identity
from bodysense.lab.completion.corpus import Corpus, read_corpus
from bodysense.lab.completion.finger_sequences import clips_with_fingers
from bodysense.lab.completion.finger_task import FingerTask, FingerTaskConfig
from bodysense.lab.completion.finger_validation import finger_validation
from bodysense.lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense.lab.completion.generated_fingers import generate_fingers, read_fingers, write_fingers
from bodysense.lab.completion.options import FingerTraining
from bodysense.lab.fit import begin, fit


def train_fingers(options: FingerTraining, task: FingerTaskConfig = FingerTaskConfig()) -> FingerNetwork:
    """Train, or resume, and return the network with the weights that did best on validation clips."""
    begin(options.schedule.seed, options.threads)
    train, val = (read_corpus(options.data, split, options.folder / f"{split}.npz") for split in ("train", "val"))
    if options.leave_out:
        train, val = (without(corpus, options.leave_out) for corpus in (train, val))
    generated = _generated(options) if options.generated_hours else None
    network = FingerNetwork(task.network)
    task = replace(task, generated_hours=options.generated_hours, left_out=options.leave_out)
    fit(
        FingerTask(network, task, options.schedule, train, finger_validation(val, train), generated),
        options.out,
    )
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
    hours, seed = options.generated_hours, options.schedule.seed
    kept = options.folder / f"fingers-{hours:g}h-{seed}.npz"
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
