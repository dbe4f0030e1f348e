"""The finger network, from recorded motion to trained weights, and back from a checkpoint.

`evaluate fingers` scores untracked fingers of a person who was left out of training. Hidden fingers are those that the
headset's cameras do not see; their baseline is the last known hand or, before the first, the mean hand of the training
people. Synthesised fingers belong to hands with a tracked wrist only; their baseline is that mean hand. Errors are root
mean squares of distances in the frame of the wrist, of points that bend.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import torch
from lightning_fabric import Fabric

from bodysense.errors import BodysenseError
from bodysense_lab.checkpoint import best_weights, checkpoint_identity
from bodysense_lab.completion.corpus import Corpus, read_corpus
from bodysense_lab.completion.finger_sequences import clips_with_fingers
from bodysense_lab.completion.finger_task import (
    FingerTask,
    FingerTaskConfig,
    finger_batches,
    finger_error,
    finger_validation,
    last_known_error,
    mean_hand,
    scored_distances,
)
from bodysense_lab.completion.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.generated_fingers import generate_fingers, read_fingers, write_fingers
from bodysense_lab.completion.options import FINGER_SCHEDULE, CompletionTraining, FingerTraining
from bodysense_lab.completion.weights_file import read_weights
from bodysense_lab.fit import begin, fit
from bodysense_lab.table import Report


def train_fingers(
    options: FingerTraining, fabric: Fabric, task: FingerTaskConfig = FingerTaskConfig()
) -> FingerNetwork:
    """Train, or resume, and return the network with the weights that did best on validation clips."""
    begin(options.schedule.seed, options.threads)
    with fabric.rank_zero_first():  # the others find what it read in the cache
        train, val = (read_corpus(options.data, split, options.limit) for split in ("train", "val"))
        generated = _generated(options) if options.generated_hours else None
    if options.leave_out:
        train, val = (without(corpus, options.leave_out) for corpus in (train, val))
    network = FingerNetwork(task.network)
    task = replace(task, generated_hours=options.generated_hours, left_out=options.leave_out)
    watched, source = finger_validation(val, train), options.limited or None
    fit(FingerTask(network, task, options.schedule, train, watched, generated, source), options.out, fabric=fabric)
    return network.cpu()


def fingers_of_completion(run: CompletionTraining, fabric: Fabric) -> FingerNetwork:
    """Return the finger network that is written beside a body: trained, or without steps that of `begin_with`.

    Fingers stay relaxed where there is neither, and where time runs backward.
    """
    if run.finger_steps:
        schedule = replace(FINGER_SCHEDULE, steps=run.finger_steps, seed=run.schedule.seed)
        shared = {name: getattr(run, name) for name in ("data", "limit", "threads", "devices", "nodes")}
        return train_fingers(FingerTraining(out=run.folder / "fingers.ckpt", schedule=schedule, **shared), fabric)
    if run.begin_with is not None and run.begin_with.suffix == ".safetensors" and not run.backward:
        return read_weights(run.begin_with)[1]
    return FingerNetwork(FingerConfig()).relaxed_only()


def without(corpus: Corpus, person: str) -> Corpus:
    """Return the corpus without the fingers of a person. Raises BodysenseError if it has no fingers of that person."""
    theirs, others = person_clips(corpus, person)
    if not len(theirs):
        people = sorted({str(corpus.name[clip]).split("/")[0] for clip in others})
        raise BodysenseError(f"--leave-out {person}: no one of that name has fingers; valid are {', '.join(people)}")
    return corpus.of(np.setdiff1d(np.arange(len(corpus)), theirs))


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


SETS = {"camera": "occluded", "nothing": "synthesised"}


@dataclass(frozen=True)
class FingerScore:
    """One network on the person whom it does not know."""

    network: str
    task: FingerTaskConfig
    sensors: str  # a key of `SETS`
    error: float  # m
    baseline: float  # m
    points: int  # scored points, times frames

    @property
    def ratio(self) -> float:
        """The network's error divided by the baseline's."""
        return self.error / self.baseline


@torch.no_grad()
def score_fingers(
    networks: Mapping[str, tuple[FingerNetwork, FingerTaskConfig]], scored: Corpus, learned: Corpus
) -> list[FingerScore]:
    """Score networks on the clips of the people whom they leave out; `learned` is the train split."""
    scores = []
    for name, (network, task) in networks.items():
        theirs, others = (person_clips(corpus, task.left_out) for corpus in (scored, learned))
        mean = mean_hand(learned.of(others[1]))
        for sensors, batches in finger_batches(scored.of(theirs[0]), tuple(SETS)).items():
            found = [finger_error(network, batch) for batch in batches]
            known = [last_known_error(batch, mean) for batch in batches]
            error, baseline = (float(scored_distances(one, batches).square().mean().sqrt()) for one in (found, known))
            count = len(scored_distances(found, batches))
            scores.append(FingerScore(name, task, sensors, error, baseline, count))
    return scores


def person_clips(corpus: Corpus, person: str) -> tuple[np.ndarray, np.ndarray]:
    """Clips with fingers of a person, and of all others."""
    clips = clips_with_fingers(corpus)
    theirs = np.array([str(corpus.name[clip]).split("/")[0] == person for clip in clips], dtype=bool)
    return clips[theirs], clips[~theirs]


def finger_report(scores: list[FingerScore], where: str) -> Report:
    """A row a network and a kind of fingers; `where` says whose fingers."""
    rows = tuple(
        (
            *(one.network, one.task.left_out, f"{one.task.generated_hours:g}", SETS[one.sensors]),
            *(100 * one.error, 100 * one.baseline, one.ratio),
        )
        for one in scores
    )
    return Report(
        name="fingers",
        title=f"Fingers of people of whom nothing was learned ({where})",
        columns=("network", "left out", "generated h", "fingers", "error", "baseline", "ratio"),
        rows=rows,
        numbers=finger_numbers(scores),
        caption="RMSJPE of points that bend, from the wrist, cm; ratio: error by baseline.",
        digits=2,
    )


def finger_numbers(scores: list[FingerScore]) -> dict[str, float]:
    """One flat object: ratios over all people who were left out, with and without generated fingers."""
    numbers: dict[str, float] = {}
    for sensors, what in SETS.items():
        for generated, ending in ((True, ""), (False, "_recorded_only")):
            chosen = [one for one in scores if one.sensors == sensors and bool(one.task.generated_hours) == generated]
            if chosen:
                share = np.array([one.points for one in chosen], dtype=float)
                error, baseline = (
                    float(np.sqrt(np.average([getattr(one, name) ** 2 for one in chosen], weights=share)))
                    for name in ("error", "baseline")
                )
                numbers[f"finger_{what}_ratio_foreign{ending}"] = error / baseline
                numbers[f"finger_{what}_foreign{ending}_cm"] = 100 * error
                numbers[f"finger_{what}_baseline_foreign{ending}_cm"] = 100 * baseline
    return numbers
