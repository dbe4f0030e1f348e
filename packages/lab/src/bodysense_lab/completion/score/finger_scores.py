"""Table of `evaluate fingers`: untracked fingers of a person who was left out of training.

Hidden fingers are those that the headset's cameras do not see. Their baseline is the last known hand or, before a hand
is first seen, the mean hand of the training people. Synthesised fingers belong to hands with a tracked wrist
only. Their baseline is that mean hand. Errors are root mean squares of distances in the frame of the wrist, of
points that bend.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path

import numpy as np
import torch

from bodysense.errors import BodysenseError
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.networks.fingers import FingerConfig, FingerNetwork
from bodysense_lab.completion.score.finger_errors import (
    hand_batches,
    last_known_fingers,
    mean_hand,
    predicted_fingers,
    untracked_distances,
)
from bodysense_lab.completion.training.task import FingerTaskConfig
from bodysense_lab.core.checkpoint import best_weights, checkpoint_identity
from bodysense_lab.core.table import Report


def load_finger_network(checkpoint: Path) -> tuple[FingerNetwork, FingerTaskConfig]:
    """Return the finger network of a run, with the best weights on validation clips, and its task's settings.

    Raises BodysenseError if there is no checkpoint, or if it is of another network.
    """
    task = checkpoint_identity(checkpoint)["network"]
    built = task.get("network", {})
    if set(built) != {one.name for one in fields(FingerConfig)}:
        raise BodysenseError(
            f"{checkpoint} is not of the finger network; give the .ckpt that `bodysense train completion-fingers` wrote"
        )
    network = FingerNetwork(FingerConfig(**built))
    network.load_state_dict(best_weights(checkpoint, network))
    return network.eval(), FingerTaskConfig(network=network.config, left_out=task.get("left_out", ""))


SETS = {"camera": "occluded", "nothing": "synthesised"}  # names of sensor sets in keys of figures


@dataclass(frozen=True)
class FingerScore:
    """Score of a network on the person who was left out of its training."""

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
    networks: Mapping[str, tuple[FingerNetwork, FingerTaskConfig]], scored: Corpus, train: Corpus
) -> list[FingerScore]:
    """Score each network on the clips of the person whom it left out. `train` is the train split, for baselines."""
    scores = []
    for name, (network, task) in networks.items():
        mean = mean_hand(train.select(train.finger_clips(task.left_out)[1]))
        test = scored.select(scored.finger_clips(task.left_out)[0])
        for sensors in SETS:
            batches = hand_batches(test, sensors)
            errors = untracked_distances(partial(predicted_fingers, network), batches)
            baselines = untracked_distances(partial(last_known_fingers, mean), batches)
            error, baseline = (float(distances.square().mean().sqrt()) for distances in (errors, baselines))
            scores.append(FingerScore(name, task, sensors, error, baseline, len(errors)))
    return scores


def finger_report(scores: list[FingerScore], data_name: str) -> Report:
    """Return a table with a row for each network and kind of fingers. `data_name` is part of the title."""
    rows = tuple(
        (
            *(one.network, one.task.left_out, SETS[one.sensors]),
            *(100 * one.error, 100 * one.baseline, one.ratio),
        )
        for one in scores
    )
    return Report(
        name="fingers",
        title=f"Fingers of people left out of training ({data_name})",
        columns=("network", "left out", "fingers", "error", "baseline", "ratio"),
        rows=rows,
        numbers=finger_numbers(scores),
        caption="RMSJPE of points that bend, from the wrist, cm; ratio: error by baseline.",
        digits=2,
    )


def finger_numbers(scores: list[FingerScore]) -> dict[str, float]:
    """Return ratios and errors over all left-out people, by flat keys."""
    numbers: dict[str, float] = {}
    for sensors, what in SETS.items():
        chosen = [one for one in scores if one.sensors == sensors]
        if chosen:
            points = np.array([one.points for one in chosen], dtype=float)
            error, baseline = (
                float(np.sqrt(np.average([getattr(one, name) ** 2 for one in chosen], weights=points)))
                for name in ("error", "baseline")
            )
            numbers[f"finger_{what}_ratio"] = error / baseline
            numbers[f"finger_{what}_cm"] = 100 * error
            numbers[f"finger_{what}_baseline_cm"] = 100 * baseline
    return numbers
