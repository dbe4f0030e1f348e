"""Training of the three-point network: losses on positions, rotations and their change, and the loop."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from torch.optim.swa_utils import AveragedModel

from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.skeleton import BODY, LOWER_BODY
from bodysense.models.three_point_network import CONTACT, Answer, ThreePointNetwork
from bodysense.training.body_network import Progress, moving_average
from bodysense.training.checkpoint import identity, load_checkpoint, save_checkpoint
from bodysense.training.regression import learning_rate
from bodysense.training.three_point_episodes import Corpus, ThreePointBatch, world_turn

LOWER = [BODY.index(name) for name in LOWER_BODY]
UPPER = [joint for joint in range(len(BODY)) if joint not in LOWER]
_FEET = [BODY.index(name) for name in CONTACT]
# The recordings' wrists do not bend, and their feet turn unreliably; the head is measured.
_TURN_WEIGHT = {"head": 0.0, "wrist": 0.1, "ankle": 0.3, "foot": 0.1}


@dataclass(frozen=True)
class ThreePointWeights:
    """Weights of the terms, each a mean over frames and joints at the reference height."""

    position: float = 10.0  # per metre
    rotation: float = 1.0  # per radian, of rotations from the heading's frame
    local: float = 0.5  # per radian, of rotations from the parent's
    velocity: float = 0.5  # per m/s, of the difference between frames, in the world
    skate: float = 0.3  # per m/s of ankles and feet that truly stand
    contact: float = 0.05  # cross-entropy
    expected_error: float = 0.01


@dataclass(frozen=True)
class ThreePointSchedule:
    """How long and on what."""

    steps: int = 20_000
    lanes: int = 128
    chunk: int = 12  # frames of truncated backpropagation
    learning_rate: float = 1.5e-3
    warm_up: int = 200  # steps
    weight_decay: float = 0.0
    average_decay: float = 0.999  # the kept weights are a moving average
    check_every: int = 500  # steps between checkpoints, each of which measures the average and keeps it if it is best
    seed: int = 1
    loss: ThreePointWeights = field(default_factory=ThreePointWeights)


def three_point_loss(
    network: ThreePointNetwork, answer: Answer, batch: ThreePointBatch, weights: ThreePointWeights
) -> dict[str, Tensor]:
    """The weighted terms and their sum, 'loss'. Distances are Euclidean, angles nearly: ‖A − B‖ / √2."""
    valid = batch.valid[..., None]
    count = valid.sum().clamp(min=1)
    distance = _length(answer.position - batch.position)
    terms = {"position": (distance * valid).sum() / count / len(BODY) * weights.position}

    truth = quaternion_to_matrix(batch.rotation)
    turn_weight = torch.tensor([_TURN_WEIGHT.get(name.rpartition("_")[2], 1.0) for name in BODY])
    total = turn_weight.sum()
    away = _angle(answer.rotation, truth)
    terms["rotation"] = (away * turn_weight * valid).sum() / count / total * weights.rotation
    said, wanted = (
        rotation[..., network.parents, :, :].mT @ rotation[..., 1:, :, :] for rotation in (answer.rotation, truth)
    )
    # The head's own rotation is measured; from the neck it says how the neck is turned.
    local_weight = turn_weight[1:] + (turn_weight[1:] == 0)
    terms["local"] = (_angle(said, wanted) * local_weight * valid).sum() / count / total * weights.local

    # The head is where it is measured, so what is missed is missed in the world.
    missed = (answer.position - batch.position) @ world_turn(batch.travel)
    both = valid[:, 1:] & valid[:, :-1]
    pairs = both.sum().clamp(min=1)
    too_fast = (missed[:, 1:] - missed[:, :-1]) / batch.interval[:, None, None, None]
    terms["velocity"] = (_length(too_fast) * both).sum() / pairs / len(BODY) * weights.velocity
    standing = batch.contact[:, 1:] & batch.contact[:, :-1] & both
    skating = (_length(too_fast[..., _FEET, :]) * standing).sum() / standing.sum().clamp(min=1)
    terms["skate"] = skating * weights.skate

    contact = binary_cross_entropy_with_logits(answer.contact_logit, batch.contact.float(), reduction="none")
    terms["contact"] = (contact * valid).sum() / count / len(CONTACT) * weights.contact
    # Laplace likelihood: its optimum is the mean absolute error. The error itself is not pulled by it.
    likelihood = (distance.detach() + 1e-4) / answer.error + torch.log(answer.error)
    terms["expected"] = (likelihood * valid).sum() / count / len(BODY) * weights.expected_error
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def train_three_point(
    network: ThreePointNetwork,
    schedule: ThreePointSchedule,
    corpus: Corpus,
    validation: dict[str, Corpus],
    checkpoint: Path,
    report: Callable[[Progress], None],
) -> tuple[ThreePointNetwork, dict[str, float]]:
    """Train and return the network with the averaged weights that did best on the first of `validation`; its figures.

    Continues from `checkpoint` where that file exists; raises BodysenseError when it belongs to another configuration.
    """
    optimizer = torch.optim.AdamW(network.parameters(), lr=schedule.learning_rate, weight_decay=schedule.weight_decay)
    average = AveragedModel(network, avg_fn=partial(moving_average, decay=schedule.average_decay))
    averaged = average.module
    assert isinstance(averaged, ThreePointNetwork)
    run = identity(network.config, schedule)
    done, kept = load_checkpoint(checkpoint, run, network, optimizer, average)
    best = kept or {"score": math.inf, "step": 0, "weights": network.state_dict()}
    memory = network.recurrent.start(schedule.lanes)
    batches = corpus.lanes(schedule.lanes, schedule.chunk, np.random.default_rng([schedule.seed, done]))
    begun, recent = time.monotonic(), []
    for step, batch in zip(range(done + 1, schedule.steps + 1), batches, strict=False):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(schedule, step)
        memory = torch.where(batch.begins[:, None], 0.0, memory.detach())
        # Half precision is for the layers alone: geometry needs the digits.
        with torch.autocast("cpu", torch.bfloat16):
            hidden, after = network.recurrent(batch.features, memory)
            said = network.say(batch.features, hidden)
        answer = network.answer(batch.prepared, *(part.float() for part in said))
        memory, terms = after.float(), three_point_loss(network, answer, batch, schedule.loss)
        optimizer.zero_grad()
        terms["loss"].backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimizer.step()
        average.update_parameters(network)
        recent.append({name: float(value.detach()) for name, value in terms.items()})
        if step % schedule.check_every == 0 or step == schedule.steps:
            figures = validate_three_point(averaged, validation)
            score = next(iter(figures.values()))
            if score < best["score"]:
                weights = {name: value.clone() for name, value in averaged.state_dict().items()}
                best = {"score": score, "step": step, "weights": weights}
            save_checkpoint(checkpoint, run, step, network, optimizer, average, best)
            mean = {name: float(np.mean([row[name] for row in recent])) for name in recent[0]}
            recent = []
            report(Progress(step, schedule.steps, time.monotonic() - begun, mean, figures))
    network.load_state_dict(best["weights"])
    return network.eval(), validate_three_point(network, validation)


@torch.no_grad()
def validate_three_point(network: ThreePointNetwork, corpora: dict[str, Corpus]) -> dict[str, float]:
    """Figures of every corpus by its name, at the reference height: mean errors over frames and joints.

    `full_mpjpe_cm`, `full_lower_cm`, `full_upper_cm` of positions from the head, `full_velocity_cm_s` in the world and
    `full_rotation_deg` of rotations from the heading's frame, for a corpus 'full'.
    """
    figures, training = {}, network.training
    network.eval()
    for name, corpus in corpora.items():
        distance, velocity, angle, frames, pairs = np.zeros(len(BODY)), 0.0, 0.0, 0, 0
        for clip in range(len(corpus)):
            batch = corpus.whole(clip)
            said, _ = network.ask_twice(batch.features, network.begin(1))
            answer = network.answer(batch.prepared, *said)
            missed = (answer.position - batch.position) @ world_turn(batch.travel)
            distance += _length(missed).sum(dim=(0, 1)).numpy()
            too_fast = (missed[:, 1:] - missed[:, :-1]) / batch.interval[:, None, None, None]
            velocity += float(_length(too_fast).mean(dim=-1).sum())
            angle += float(_angle(answer.rotation, quaternion_to_matrix(batch.rotation)).mean(dim=-1).sum())
            frames, pairs = frames + missed.shape[1], pairs + too_fast.shape[1]
        mean = 100 * distance / frames
        parts = {"mpjpe_cm": mean, "lower_cm": mean[LOWER], "upper_cm": mean[UPPER]}
        figures |= {f"{name}_{part}": float(values.mean()) for part, values in parts.items()}
        figures[f"{name}_velocity_cm_s"] = 100 * velocity / max(pairs, 1)
        figures[f"{name}_rotation_deg"] = float(np.degrees(angle / frames))
    network.train(training)
    return figures


def _length(vector: Tensor) -> Tensor:
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-12)


def _angle(a: Tensor, b: Tensor) -> Tensor:
    """Nearly the angle θ between rotations (..., 3, 3), radians: 2 sin(θ/2)."""
    difference = a - b
    return torch.sqrt((difference * difference).sum(dim=(-2, -1)) / 2 + 1e-12)
