"""The training task of the completion network: batches, losses, and figures on validation people and bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sized
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits

from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense_lab.checkpoint import best_weights
from bodysense_lab.completion.corpus import Corpus, read_corpus
from bodysense_lab.completion.features import Before, TrackedSignal
from bodysense_lab.completion.network import (
    CompletionConfig,
    CompletionNetwork,
    Prediction,
    orthonormal,
    turn_about_up,
)
from bodysense_lab.completion.options import CompletionTraining
from bodysense_lab.completion.points import BODY_POINTS, CONTACT, HEAD, JOINTS, SPIN_PLACES
from bodysense_lab.completion.postures import low_share, standing_share
from bodysense_lab.completion.sensor_draws import worn
from bodysense_lab.completion.sequences import (
    Draw,
    Sequence,
    TrainingBody,
    draw_sequence,
    make_sequence,
)
from bodysense_lab.fit import Task, begin, cut, fit, played
from bodysense_lab.options import Schedule
from bodysense_lab.precision import layer_autocast

WORN = ("sit", "talk_gesture", "everyday", "locomotion", "")  # what wearers of a headset do; unknown motion counts
_SETTLED = 0.15  # share of sequences in postures that are rare in recordings
_FEET = [BODY.index(name) for name in CONTACT]
# Weight of a joint's rotation relative to other joints, and of its position. Recorded rotations of feet are unreliable.
# Wearers see their own elbows and shoulders, and few tracked points determine them.
_TURN_WEIGHT = {"ankle": 0.6, "foot": 0.3, "collar": 1.5, "shoulder": 2.0, "elbow": 2.5}
_PLACE_WEIGHT = {"shoulder": 1.5, "elbow": 2.0}


@dataclass(frozen=True)
class Losses:
    """Weights of the terms, each a mean over frames and joints at the reference stature."""

    rotation: float = 1.3  # mean absolute difference of matrices, of rotations from the frame under the head
    local: float = 0.5  # the same of rotations from the parent joint
    position: float = 8.0  # per metre, mean absolute difference from the head
    velocity: float = 0.4  # per m/s
    haste: float = 16.0  # per m/s by which a joint is faster than the true one, beyond `SLACK`
    skate: float = 0.1  # per m/s, of feet that truly stand
    contact: float = 0.03  # cross-entropy
    error: float = 0.01  # likelihood of the expected error


SLACK = 0.6  # m/s


@dataclass(frozen=True)
class CompletionTaskConfig:
    """Batches and losses."""

    network: CompletionConfig = CompletionConfig()
    streams: int = 96  # sequences side by side
    chunk: int = 48  # frames of truncated backpropagation
    backward: bool = False  # time runs backward
    losses: Losses = field(default_factory=Losses)


class SequenceBatch(NamedTuple):
    """Frames of B sequences; `begins` marks those that start with this batch."""

    signal: TrackedSignal
    true_position: Tensor  # (B, T, 25, 3) m, world
    true_rotation: Tensor  # (B, T, 22, 3, 3) world ← joint
    contact: Tensor  # (B, T, 4)
    valid: Tensor  # (B, T) bool
    begins: Tensor  # (B,) bool


@dataclass(frozen=True, eq=False)
class CompletionTask(Task):
    """The task of `bodysense_lab.fit` for the completion network."""

    network: CompletionNetwork
    configuration: CompletionTaskConfig
    schedule: Schedule
    corpus: Corpus
    validation: dict[str, list[SequenceBatch]]
    source: Mapping[str, Any] | None = None
    precision: torch.dtype | None = None  # of the layers; None: the device's own
    mixed = True

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[SequenceBatch]:
        """Streams that play whole sequences, side by side; drawn by the length of their clips."""
        chunk = self.configuration.chunk
        seconds = self.corpus.length / self.corpus.rate
        weight = seconds * np.where(np.isin(self.corpus.category, WORN), 1.0, 0.6) * (1 + low_share(self.corpus))
        still = seconds * standing_share(self.corpus) ** 2
        weight, still = weight / weight.sum(), still / max(still.sum(), 1e-9)

        backward = self.configuration.backward

        def draw() -> Sequence:
            if still.any() and rng.uniform() < _SETTLED:
                return draw_sequence(self.corpus, int(rng.choice(len(still), p=still)), rng, True, backward)
            return draw_sequence(self.corpus, int(rng.choice(len(weight), p=weight)), rng, False, backward)

        for pieces, begins in played(draw, self.configuration.streams, chunk):
            yield collate(pieces, chunk, begins)

    def loss(self, batch: SequenceBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor]:
        """Losses of a chunk, with the memory carried over where no sequence begins."""
        before = self.network.begin(len(batch.begins)) if memory is None else memory
        before = torch.where(batch.begins[None, :, None], 0.0, before.detach().float())
        features = self.network.read(batch.signal)
        with layer_autocast(features.device, self.precision):
            (turned, judged), after = self.network.predict(features, before)
        prediction = self.network.prediction(turned.float(), judged.float())
        return losses(self.network, prediction, batch, self.configuration.losses), after

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Mean error from the head, cm in the world's measure, for each set of sensors and bodies; first their mean."""
        assert isinstance(network, CompletionNetwork)
        figures: dict[str, float] = {}
        for name, batches in self.validation.items():
            far, turned, count = 0.0, 0.0, 0.0
            for batch in batches:
                raw, _ = network.predict(network.read(batch.signal), network.begin(len(batch.begins)))
                missed, rotation, wanted = _missed(network, network.prediction(*raw), batch)
                angle = (rotation - wanted).abs().mean(dim=(-2, -1))
                distance = missed[..., :JOINTS, :].norm(dim=-1).mean(dim=-1) * batch.signal.size[:, None]
                far += float((distance * batch.valid).sum())
                turned += float((angle.mean(dim=-1) * batch.valid).sum())
                count += float(batch.valid.sum())
            figures[f"{name}_mpjpe_cm"] = 100 * far / count
            figures[f"{name}_rotation"] = turned / count
        score = float(np.mean([value for name, value in figures.items() if name.endswith("cm")]))
        return {"score": score, **figures}


def _missed(network: CompletionNetwork, prediction: Prediction, batch: SequenceBatch) -> tuple[Tensor, Tensor, Tensor]:
    """Errors of positions from the head (B, T, 25, 3), and rotations in the frame under it, said and true.

    Measured rotations stand in the place of those that are said.
    """
    signal = batch.signal
    measured, wanted = (signal.turn.mT[..., None, :, :] @ turned for turned in (signal.rotation, batch.true_rotation))
    rotation = torch.where(signal.has_rotation[..., None, None], measured, orthonormal(prediction.axes))
    position = network.places(rotation, signal.rest_offset / signal.size[:, None, None])
    truth = batch.true_position - batch.true_position[..., HEAD : HEAD + 1, :]
    return position - truth @ signal.turn / signal.size[:, None, None, None], rotation, wanted


def losses(
    network: CompletionNetwork, prediction: Prediction, batch: SequenceBatch, weights: Losses
) -> dict[str, Tensor]:
    """The sum, 'loss', and its weighted terms."""
    signal = batch.signal
    size = signal.size[:, None, None, None]
    missed, rotation, wanted = _missed(network, prediction, batch)
    valid, both = batch.valid[..., None], (batch.valid[:, 1:] & batch.valid[:, :-1])[..., None]
    count, pairs, points = batch.valid.sum().clamp(min=1), both.sum().clamp(min=1), missed.shape[-2]

    def frames(values: Tensor, width: int) -> Tensor:
        """The mean over frames and `width` joints or points."""
        return (values * valid).sum() / count / width

    def steps(values: Tensor) -> Tensor:
        """The mean over pairs of frames and points."""
        return (values * both).sum() / pairs / points

    turn_weight = torch.tensor([_TURN_WEIGHT.get(name.rpartition("_")[2], 1.0) for name in BODY])
    place_weight = torch.tensor([_PLACE_WEIGHT.get(name.rpartition("_")[2], 1.0) for name in BODY_POINTS])
    angle = (rotation - wanted).abs().mean(dim=(-2, -1)) * turn_weight
    parents = network.bone_parents[: JOINTS - 1]
    local, true_local = (turned[..., parents, :, :].mT @ turned[..., 1:, :, :] for turned in (rotation, wanted))
    bent = (local - true_local).abs().mean(dim=(-2, -1)) * turn_weight[1:]
    terms = {
        "rotation": frames(angle, JOINTS) * weights.rotation,
        "local": frames(bent, JOINTS) * weights.local,
        "position": frames(missed.abs().mean(dim=-1) * place_weight, points) * weights.position,
    }
    # Where the head is not tracked, the network says where it is.
    place = (batch.true_position[..., HEAD : HEAD + 1, :] - signal.origin[..., None, :]) @ signal.turn / size
    lost = ~signal.has_position[..., HEAD, None]
    terms["head"] = frames((prediction.head - place[..., 0, :]).abs() * lost, 3) * weights.position * 0.3

    world = missed @ signal.turn.mT
    too_fast = (world[:, 1:] - world[:, :-1]) / signal.interval[:, 1:, None, None]
    terms["velocity"] = steps(too_fast.abs().mean(dim=-1)) * weights.velocity
    true_step = (batch.true_position[:, 1:] - batch.true_position[:, :-1]) / size
    shown_step, interval = true_step + world[:, 1:] - world[:, :-1], signal.interval[:, 1:, None]
    faster = (length(shown_step) - length(true_step)) / interval - SLACK / size[..., 0]
    terms["haste"] = steps(faster.clamp_min(0.0)) * weights.haste
    standing = (batch.contact[:, 1:] * batch.contact[:, :-1]) * both
    skating = (length(too_fast[..., _FEET, :]) * standing).sum() / standing.sum().clamp(min=1)
    terms["skate"] = skating * weights.skate
    contact = binary_cross_entropy_with_logits(prediction.contact_logit, batch.contact, reduction="none")
    terms["contact"] = frames(contact, len(CONTACT)) * weights.contact
    # Laplace likelihood: its optimum is the mean distance. The positions are not pulled by it.
    likelihood = length(missed.detach()) / prediction.error + torch.log(prediction.error)
    terms["error"] = frames(likelihood, points) * weights.error
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def length(vector: Tensor) -> Tensor:
    """Length (...) of vectors (..., K), whose gradient is finite where it is 0."""
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-10)


def collate(pieces: list[tuple[Sequence, int]], chunk: int, begins: np.ndarray) -> SequenceBatch:
    """Cut `chunk` frames from each sequence at its start (see `cut`)."""
    kept = ("position", "has_position", "has_rotation", "acceleration", "has_acceleration")
    now = cut(pieces, chunk, (*kept, "rotation", "anchor", "true_position", "true_rotation", "contact"))
    earlier = cut([(one, start - 1) for one, start in pieces], chunk, (*kept[:3], "rotation"))

    def each(name: str) -> Tensor:
        return torch.from_numpy(np.stack([np.asarray(getattr(one, name), dtype=np.float32) for one, _ in pieces]))

    anchor = now["anchor"]
    origin = torch.zeros(*anchor.shape[:2], 3)
    origin[..., 0], origin[..., 2] = anchor[..., 2], anchor[..., 3]
    first = torch.tensor([start == 0 for _, start in pieces])
    has_before = torch.ones(len(pieces), chunk, 1, dtype=torch.bool)
    has_before[first, 0] = False
    signal = TrackedSignal(
        **{name: now[name] for name in kept},
        rotation=quaternion_to_matrix(now["rotation"]),
        accuracy=each("accuracy")[:, None].expand(-1, chunk, -1),
        interval=each("interval")[:, None].expand(-1, chunk),
        turn=turn_about_up(anchor[..., 0], anchor[..., 1]),
        origin=origin,
        before=Before(
            position=earlier["position"],
            has_position=earlier["has_position"] & has_before,
            rotation=quaternion_to_matrix(earlier["rotation"][..., SPIN_PLACES, :]),
            has_rotation=earlier["has_rotation"][..., SPIN_PLACES] & has_before,
        ),
        rest_offset=each("rest_offset"),
        certainty=each("certainty"),
        size=each("size"),
    )
    return SequenceBatch(
        signal=signal,
        true_position=now["true_position"],
        true_rotation=quaternion_to_matrix(now["true_rotation"]),
        contact=now["contact"].float(),
        valid=now["valid"],
        begins=torch.from_numpy(begins),
    )


SETS = ("three_point", "head", "six_point", "headset_camera", "three_point_imu_feet")
_GROUP = 16  # sequences side by side
S = TypeVar("S", bound=Sized)
Batch = TypeVar("Batch")


def validation_batches(corpus: Corpus, stride: int, backward: bool = False) -> dict[str, list[SequenceBatch]]:
    """Return every `stride`-th clip of what wearers do, whole, on its own and on an unseen body; by set and body."""
    clips = [k for k in range(len(corpus)) if corpus.category[k] in WORN][::stride]
    if not clips:
        raise BodysenseError("the val split has no everyday motion; give --data with some, or without categories")
    clips.sort(key=lambda k: corpus.length[k] / corpus.rate[k])
    strangers = sample_bodies("validation", len(clips))
    batches: dict[str, list[SequenceBatch]] = {}
    for name in SETS:
        for whose in ("own", "stranger"):
            pieces = []
            for place, clip in enumerate(clips):
                true = corpus.rest_offset[clip].astype(float) if whose == "own" else strangers[place]
                body = TrainingBody(true, true, np.zeros(len(true)))
                rng = np.random.default_rng([7, clip])
                drawn = Draw(body, track=partial(worn, SENSOR_SETS[name]), backward=backward)
                pieces.append(make_sequence(corpus, clip, drawn, rng))
            batches[f"{name}_{whose}"] = whole_batches(pieces, collate)
    return batches


def whole_batches(sequences: list[S], collate: Callable[[list[tuple[S, int]], int, np.ndarray], Batch]) -> list[Batch]:
    """Return batches of whole sequences, of similar lengths if these are in order."""
    groups = [sequences[first : first + _GROUP] for first in range(0, len(sequences), _GROUP)]
    return [
        collate([(one, 0) for one in group], max(map(len, group)), np.ones(len(group), dtype=bool)) for group in groups
    ]


_VALIDATION_STRIDE = 3  # of the validation clips every n-th is scored at a checkpoint


def train_completion(options: CompletionTraining, fabric: Fabric) -> CompletionNetwork:
    """Train, or resume, and return the network with the weights that did best on validation people.

    With `keep` they are averaged with those that training began with (Wortsman et al. 2022, "Robust fine-tuning of
    zero-shot models"): what training changes comes in part, at a smaller cost in accuracy.
    """
    begin(options.schedule.seed, options.threads)
    with fabric.rank_zero_first():  # the others find what it read in the cache
        train, val = (read_corpus(options.data, split, options.limit) for split in ("train", "val"))
    if options.finger_steps and not (train.finger_start >= 0).any():
        raise BodysenseError(f"{options.data}: no training clip has fingers that move; give --finger-steps 0")
    fabric.print(f"{train.minutes:.0f} minutes to learn from, {val.minutes:.0f} to validate")
    config = CompletionTaskConfig(backward=options.backward)
    network = CompletionNetwork(config.network)
    earlier = network.state_dict() if options.begin_with is None else _weights(options.begin_with, network)
    network.load_state_dict(earlier)
    watched = validation_batches(val, _VALIDATION_STRIDE, options.backward)
    task = CompletionTask(network, config, options.schedule, train, watched, options.limited or None)
    fit(task, options.folder / "completion.ckpt", fabric=fabric)
    network = network.cpu()
    if options.keep:
        trained = network.state_dict()
        network.load_state_dict({name: torch.lerp(trained[name], earlier[name], options.keep) for name in trained})
    return network


def _weights(path: Path, network: CompletionNetwork) -> dict[str, Tensor]:
    """Weights to begin with: the best of a checkpoint, or those of a published file."""
    from bodysense_lab.completion.weights_file import read_weights

    if path.suffix != ".safetensors":
        return best_weights(path, network)
    published, _ = read_weights(path)
    if published.config != network.config:
        raise BodysenseError(f"{path}: built as {published.config}, wanted {network.config}; give another --begin-with")
    return published.state_dict()
