"""The training task of the finger network: batches of sequences, losses, and figures on validation clips.

Validation uses clips that are not trained on, on recorded and on unseen hands, and compares with simple baselines.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bodysense.body.rotation import quaternion_to_matrix
from bodysense.body.shape import sample_bodies
from bodysense.body.skeleton import default_skeleton
from bodysense_lab.completion.corpus import Corpus
from bodysense_lab.completion.finger_sequences import (
    PARENT_PLACES,
    FingerSequence,
    FingersTracked,
    TrackFingers,
    clips_with_fingers,
    draw_finger_sequence,
    hand_kinematics,
    make_finger_sequence,
)
from bodysense_lab.completion.fingers import (
    FINGER_JOINTS,
    FINGER_POINTS,
    HAND_JOINTS,
    HAND_POINTS,
    FingerConfig,
    FingerNetwork,
    FingerSignal,
)
from bodysense_lab.completion.sequences import Draw, TrainingBody
from bodysense_lab.completion.task import length, whole_batches
from bodysense_lab.fit import Task, cut, played
from bodysense_lab.options import Schedule
from bodysense_lab.precision import layer_autocast

_CARRIED_BY = [1 + above for above in PARENT_PLACES]  # among [wrist, joints]
_PATH = torch.tensor(default_skeleton().path[np.ix_(HAND_POINTS[0], HAND_POINTS[0])], dtype=torch.float32)
_GENERATED = 0.5  # share of sequences whose fingers are generated
MOVING = [point for point, above in enumerate(PARENT_PLACES) if above >= 0]  # points that bend with the fingers


@dataclass(frozen=True)
class FingerLosses:
    """Weights of the terms, each a mean over frames, hands and joints or points."""

    rotation: float = 1.0  # mean absolute difference of matrices wrist ← joint
    position: float = 24.0  # per metre, mean absolute difference from the wrist
    velocity: float = 0.4  # per m/s
    error: float = 0.01  # likelihood of the expected error


@dataclass(frozen=True)
class FingerTaskConfig:
    """Batches and losses."""

    network: FingerConfig = FingerConfig()
    streams: int = 32  # sequences side by side
    chunk: int = 48  # frames of truncated backpropagation
    losses: FingerLosses = field(default_factory=FingerLosses)
    generated_hours: float = 0.0  # of generated fingers, which clips without fingers move; 0: those are left out
    left_out: str = ""  # person whose clips are excluded from training


class FingerBatch(NamedTuple):
    """Frames of B sequences; `begins` marks those that start with this batch."""

    signal: FingerSignal
    true_position: Tensor  # (B, T, 2, 20, 3) m, from the wrist, in its frame
    true_rotation: Tensor  # (B, T, 2, 15, 3, 3) wrist ← joint
    valid: Tensor  # (B, T) bool
    begins: Tensor  # (B,) bool


class FingerValidation(NamedTuple):
    """A set of sensors: its sequences, and how much a baseline misses on them."""

    batches: list[FingerBatch]
    baseline: float  # m


@dataclass(frozen=True, eq=False)
class FingerTask(Task):
    """The task of `bodysense_lab.fit` for the finger network."""

    network: FingerNetwork
    configuration: FingerTaskConfig
    schedule: Schedule
    corpus: Corpus
    validation: Mapping[str, FingerValidation]
    generated: np.ndarray | None = None  # (N, 30, 4)
    source: Mapping[str, Any] | None = None
    mixed = True

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[FingerBatch]:
        """Streams that play whole sequences, side by side; drawn by the length of their clips."""
        chunk = self.configuration.chunk
        clips, weight = self._shares()

        def draw() -> FingerSequence:
            return draw_finger_sequence(self.corpus, int(rng.choice(clips, p=weight)), rng, self.generated)

        for pieces, begins in played(draw, self.configuration.streams, chunk):
            yield collate_fingers(pieces, chunk, begins)

    def _shares(self) -> tuple[np.ndarray, np.ndarray]:
        """Clips (N,) and how often each is drawn: by their length, recorded fingers as often as generated ones."""
        seconds = self.corpus.length / self.corpus.rate
        recorded = clips_with_fingers(self.corpus)
        if self.generated is None:
            return recorded, seconds[recorded] / seconds[recorded].sum()
        weight = seconds.astype(float)
        of_recorded = np.zeros(len(weight), dtype=bool)
        of_recorded[recorded] = True
        for part, share in ((of_recorded, 1 - _GENERATED), (~of_recorded, _GENERATED)):
            weight[part] *= share / max(weight[part].sum(), 1e-9)
        return np.arange(len(weight)), weight / weight.sum()

    def loss(self, batch: FingerBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor]:
        """Losses of a chunk, with the memory carried over where no sequence begins."""
        before = self.network.begin(len(batch.begins)) if memory is None else memory
        begins = batch.begins.repeat_interleave(2)  # both hands
        before = torch.where(begins[None, :, None], 0.0, before.detach())
        with layer_autocast(before.device):
            rotation, error, after = self.network(batch.signal, before)
        return finger_losses(rotation, error, batch, self.configuration.losses), after

    @torch.no_grad()
    def validate(self, network: nn.Module) -> dict[str, float]:
        """Mean error, cm, of points that are not tracked, and its ratio to a baseline's, by set of sensors.

        Errors are distances in the frame of the wrist. The first figure is the mean of the ratios.
        """
        assert isinstance(network, FingerNetwork)
        figures: dict[str, float] = {}
        for name, (batches, baseline) in self.validation.items():
            missed = mean_error([finger_error(network, batch) for batch in batches], batches)
            figures[f"{name}_cm"], figures[f"{name}_ratio"] = 100 * missed, missed / baseline
        score = float(np.mean([value for name, value in figures.items() if name.endswith("ratio")]))
        return {"score": score, **figures}


def finger_error(network: FingerNetwork, batch: FingerBatch) -> Tensor:
    """Distances (B, T, 2, 20), m, of predicted points from true ones in the frame of the wrist, of whole sequences."""
    rotation, _, _ = network(batch.signal, network.begin(len(batch.begins)))
    rotation = with_measured(rotation, batch.signal)
    return (finger_positions(rotation, batch.signal.rest_offset) - batch.true_position).norm(dim=-1)


def scored_points(batch: FingerBatch) -> Tensor:
    """(B, T, 2, 15) bool: which of the points `MOVING` are scored, those that are not tracked."""
    return ~batch.signal.has_position[..., MOVING] & batch.valid[..., None, None]


def scored_distances(errors: list[Tensor], batches: list[FingerBatch]) -> Tensor:
    """(N,) the scored ones of distances (B, T, 2, 20)."""
    scored = [scored_points(batch) for batch in batches]
    return torch.cat([error[..., MOVING][one] for error, one in zip(errors, scored, strict=True)])


def mean_error(errors: list[Tensor], batches: list[FingerBatch]) -> float:
    """Return the mean distance over the scored points of (B, T, 2, 20); NaN if no point is scored."""
    return float(scored_distances(errors, batches).mean())


def with_measured(rotation: Tensor, signal: FingerSignal) -> Tensor:
    """Rotations (B, T, 2, 15, 3, 3), measured ones in their place."""
    return torch.where(signal.has_rotation[..., None, None], signal.rotation, rotation)


def finger_positions(rotation: Tensor, rest_offset: Tensor) -> Tensor:
    """Positions (B, T, 2, 20, 3) m from the wrist, in its frame.

    Args:
        rotation: (B, T, 2, 15, 3, 3) wrist ← joint.
        rest_offset: (B, 2, 20, 3) m.
    """
    wrist = torch.eye(3).to(rotation).expand(*rotation.shape[:3], 1, 3, 3)
    carrying = torch.cat([wrist, rotation], dim=3)[..., _CARRIED_BY, :, :]
    bones = (carrying @ rest_offset[:, None, ..., None])[..., 0]
    return _PATH.to(bones) @ bones


def finger_losses(rotation: Tensor, error: Tensor, batch: FingerBatch, weights: FingerLosses) -> dict[str, Tensor]:
    """The sum, 'loss', and its weighted terms.

    Args:
        rotation: (B, T, 2, 15, 3, 3) wrist ← joint, as predicted.
        error: (B, T, 2, 20) m, as expected.
        batch: what was tracked, and the truth.
        weights: of the terms.
    """
    rotation = with_measured(rotation, batch.signal)
    missed = finger_positions(rotation, batch.signal.rest_offset) - batch.true_position
    angle = (rotation - batch.true_rotation).abs().mean(dim=(-2, -1))
    valid = batch.valid[..., None, None]
    count = batch.valid.sum().clamp(min=1) * 2  # hands
    both = (batch.valid[:, 1:] & batch.valid[:, :-1])[..., None, None]
    pairs = both.sum().clamp(min=1) * 2
    too_fast = (missed[:, 1:] - missed[:, :-1]) / batch.signal.interval[:, 1:, None, None, None]
    # Laplace likelihood: its optimum is the mean distance. The positions are not pulled by it.
    likelihood = length(missed.detach()) / error + torch.log(error)
    terms = {
        "rotation": (angle * valid).sum() / count / FINGER_JOINTS * weights.rotation,
        "position": (missed.abs().mean(dim=-1) * valid).sum() / count / FINGER_POINTS * weights.position,
        "velocity": (too_fast.abs().mean(dim=-1) * both).sum() / pairs / FINGER_POINTS * weights.velocity,
        "error": (likelihood * valid).sum() / count / FINGER_POINTS * weights.error,
    }
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def collate_fingers(pieces: list[tuple[FingerSequence, int]], chunk: int, begins: np.ndarray) -> FingerBatch:
    """Cut `chunk` frames from each sequence at its start (see `cut`)."""
    kept = ("position", "has_position", "has_rotation", "wrist", "wrist_velocity")
    turns = ("rotation", "wrist_rotation", "true_rotation")
    values = cut(pieces, chunk, (*kept, *turns, "true_position"))
    matrix = {name: quaternion_to_matrix(values[name]) for name in turns}
    interval = torch.tensor([one.interval for one, _ in pieces], dtype=torch.float32)
    signal = FingerSignal(
        **{name: values[name] for name in kept},
        rotation=matrix["rotation"],
        rest_offset=torch.from_numpy(np.stack([one.rest_offset for one, _ in pieces])),
        wrist_rotation=matrix["wrist_rotation"],
        interval=interval[:, None].expand(-1, chunk),
    )
    return FingerBatch(
        signal=signal,
        true_position=values["true_position"],
        true_rotation=matrix["true_rotation"],
        valid=values["valid"],
        begins=torch.from_numpy(begins),
    )


SETS = ("nothing", "camera", "tips")
_BODY_JOINTS = int(HAND_JOINTS.min())
_ROUNDS = 50  # of the mean hand's search


def finger_validation(corpus: Corpus, train: Corpus) -> dict[str, FingerValidation]:
    """Sequences of `finger_batches` with a baseline.

    The baseline is the last known hand, or the mean hand of `train` before the first.
    """
    mean = mean_hand(train)
    return {
        name: FingerValidation(batches, mean_error([last_known_error(one, mean) for one in batches], batches))
        for name, batches in finger_batches(corpus, SETS).items()
    }


def finger_batches(corpus: Corpus, sets: tuple[str, ...]) -> dict[str, list[FingerBatch]]:
    """Return whole clips with fingers by set of sensors, on their own and on unseen hands, both known."""
    clips = [int(clip) for clip in clips_with_fingers(corpus)]
    clips.sort(key=lambda clip: corpus.length[clip] / corpus.rate[clip])
    strangers = sample_bodies("validation", len(clips))
    result: dict[str, list[FingerBatch]] = {}
    for name in sets:
        pieces = []
        for place, clip in enumerate(clips):
            for true in (corpus.rest_offset[clip].astype(float), strangers[place]):
                body, rng = TrainingBody(true, true, np.zeros(len(true))), np.random.default_rng([7, clip])
                pieces.append(make_finger_sequence(corpus, clip, Draw(body), _tracked(name), rng))
        result[name] = whole_batches(pieces, collate_fingers)
    return result


def mean_hand(corpus: Corpus) -> Tensor:
    """The rotations (15, 3, 3) wrist ← joint of a left hand that miss the recorded ones least, right ones mirrored.

    The least sum of distances of matrices (Weiszfeld 1937), projected on rotations.
    """
    frames = np.concatenate(
        [np.arange(int(corpus.length[clip])) + corpus.finger_start[clip] for clip in clips_with_fingers(corpus)]
    )
    local = corpus.fingers[frames].astype(float)[:, HAND_JOINTS - _BODY_JOINTS]
    rotation, _ = hand_kinematics(local, np.zeros((2, FINGER_POINTS, 3)))
    rotation[:, 1] *= [1.0, 1.0, -1.0, -1.0]
    matrix = quaternion_to_matrix(rotation.reshape(-1, FINGER_JOINTS, 4))
    middle = matrix.mean(axis=0)
    for _ in range(_ROUNDS):
        weight = 1 / np.maximum(np.linalg.norm(matrix - middle, axis=(-2, -1)), 1e-3)
        middle = (weight[..., None, None] * matrix).sum(axis=0) / weight.sum(axis=0)[:, None, None]
    u, _, v = np.linalg.svd(middle)
    u[..., 2] *= np.linalg.det(u @ v)[:, None]
    return torch.tensor(u @ v, dtype=torch.float32)


def last_known_error(batch: FingerBatch, mean: Tensor) -> Tensor:
    """Return distances (B, T, 2, 20), m, of the hand last seen; before the first, of the hand `mean` (15, 3, 3)."""
    mirror = torch.tensor([[1.0, -1, -1], [-1.0, 1, 1], [-1.0, 1, 1]])
    held = torch.stack([mean, mean * mirror])[None].expand(len(batch.begins), -1, -1, -1, -1)
    seen = batch.signal.has_position.all(dim=-1)[..., None, None, None]
    rotations = []
    for frame in range(seen.shape[1]):
        held = torch.where(seen[:, frame], batch.true_rotation[:, frame], held)
        rotations.append(held)
    rotation = with_measured(torch.stack(rotations, dim=1), batch.signal)
    return (finger_positions(rotation, batch.signal.rest_offset) - batch.true_position).norm(dim=-1)


def _tracked(name: str) -> TrackFingers:
    """A named set of sensors, wrists tracked too where fingers are or controllers."""

    def track(visible: np.ndarray, interval: float, rng: np.random.Generator) -> FingersTracked:
        del interval, rng
        frames = len(visible)
        has_position = np.zeros((frames, 2, FINGER_POINTS), dtype=bool)
        if name == "tips":
            has_position[..., FINGER_JOINTS:] = True
        if name == "camera":
            has_position[:] = visible[..., None]
        has_wrist = visible if name == "camera" else np.ones_like(visible)
        return FingersTracked(has_position, np.zeros((frames, 2, FINGER_JOINTS), dtype=bool), has_wrist)

    return track
