"""Training tasks of the completion networks: batches, losses, and figures on validation people and bodies.

The body's network and the fingers' network are trained one after the other, on the same kind of sequences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import torch
from torch import Tensor

from bodysense.devices.simulated.sensors import SENSOR_SETS
from bodysense.errors import BodysenseError
from bodysense.parallel import prefetched
from bodysense_lab.completion.data.batches import RawBatch, SequenceBatch, assembled, cut_batch, whole_clips
from bodysense_lab.completion.data.corpus import Corpus, CorpusReader
from bodysense_lab.completion.data.points import JOINTS
from bodysense_lab.completion.data.postures.postures import low_share, standing_share
from bodysense_lab.completion.data.postures.upright import stance_shifts
from bodysense_lab.completion.data.sensor_draws import draw_sensors, fixed_sensors
from bodysense_lab.completion.data.sequence_draws import draw_hands, draw_scene, draw_sequence
from bodysense_lab.completion.data.sequences import DrawSensors, Sequence
from bodysense_lab.completion.networks.fingers import FingerConfig
from bodysense_lab.completion.networks.network import CompletionConfig
from bodysense_lab.completion.score.finger_errors import FingerValidation, predicted_fingers, untracked_distances
from bodysense_lab.completion.training.drawing import Drawing
from bodysense_lab.completion.training.losses import (
    FingerLosses,
    Losses,
    finger_losses,
    losses,
    prediction_errors,
)
from bodysense_lab.completion.training.options import Body
from bodysense_lab.core.fit import Task, stream_sequences
from bodysense_lab.core.options import Schedule
from bodysense_lab.core.precision import layer_autocast

HEADSET_CATEGORIES = ("sit", "talk_gesture", "everyday", "locomotion", "")  # motions of headset wearers; "" is unknown
# Bodies of each sensor set of validation: of all weights, and of the updates, which act without the head's pose.
SETS: dict[str, tuple[Body, ...]] = {
    **dict.fromkeys(
        ("three_point", "head", "six_point", "headset_camera", "three_point_imu_feet"), ("own", "stranger")
    ),
    **dict.fromkeys(("mocopi_six", "dip_six", "headset_slimevr_six"), ("own",)),
}
UPDATE_SETS: dict[str, tuple[Body, ...]] = dict.fromkeys(("mocopi_six", "dip_six", "slimevr_five"), ("own",))
_POSTURE_SHARE = 0.2  # share of sequences in postures that are rare in recordings
_SCENE_SHARE = 0.12  # share of sequences that are scripted scenes


@dataclass(frozen=True)
class CompletionTaskConfig:
    """Settings of batches and losses of the body."""

    network: CompletionConfig = CompletionConfig()
    streams: int = 96  # sequences in parallel
    chunk: int = 48  # frames of truncated backpropagation
    backward: bool = False  # time runs backward
    losses: Losses = field(default_factory=Losses)


@dataclass(frozen=True)
class FingerTaskConfig:
    """Settings of batches and losses of the fingers."""

    network: FingerConfig = FingerConfig()
    streams: int = 32  # sequences in parallel
    chunk: int = 48  # frames of truncated backpropagation
    losses: FingerLosses = field(default_factory=FingerLosses)
    left_out: str = ""  # person whose clips are excluded from training


@dataclass(frozen=True, eq=False)
class CompletionTask(Task):
    """Training task of the body's network."""

    network: Any
    configuration: CompletionTaskConfig
    schedule: Schedule
    corpus: Corpus
    validation: Mapping[str, list[SequenceBatch]]
    source: Mapping[str, Any] | None = None
    precision: torch.dtype | None = None  # of the layers; None: the device's own
    sensors: DrawSensors = draw_sensors  # draws the sensors of sequences
    drawing: Drawing | None = None  # worker processes that draw sequences; None: this process draws them
    mixed = True

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[RawBatch]:
        """Yield chunks of random sequences, each sequence from its first to its last frame."""
        if self.drawing is None:
            draw = sequence_sampler(self.corpus, self.configuration.backward, rng, self.sensors)
            return _stream_batches(draw, self.configuration)
        drawn = self.drawing.sequences(int(rng.integers(2**63)))
        return prefetched(_stream_batches(lambda: next(drawn), self.configuration))

    def loss(self, batch: RawBatch | SequenceBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor]:
        """Return the losses of a chunk and the memory after it."""
        batch = assembled(batch)
        before = _memory_before(self.network, batch, memory)
        features = self.network.read(batch.signal)
        with layer_autocast(features.device, self.precision):
            (turned, judged), after = self.network.predict(features, before)
        prediction = self.network.prediction(turned.float(), judged.float())
        return losses(self.network, prediction, batch, self.configuration.losses), after.detach().float()

    @torch.no_grad()
    def validate(self, network: Any) -> dict[str, float]:
        """Return the mean error from the head in cm at true size, and the rotation error, by sensor set and body.

        The first figure, the score, is the mean of the errors in cm.
        """
        figures: dict[str, float] = {}
        for name, batches in self.validation.items():
            far, turned, count = 0.0, 0.0, 0.0
            for batch in batches:
                raw, _ = network.predict(network.read(batch.signal), network.begin(len(batch.begins)))
                missed, rotation, wanted = prediction_errors(network, network.prediction(*raw), batch)
                angle = (rotation - wanted).abs().mean(dim=(-2, -1))
                distance = missed[..., :JOINTS, :].norm(dim=-1).mean(dim=-1) * batch.signal.size[:, None]
                far += float((distance * batch.valid).sum())
                turned += float((angle.mean(dim=-1) * batch.valid).sum())
                count += float(batch.valid.sum())
            figures[f"{name}_mpjpe_cm"] = 100 * far / count
            figures[f"{name}_rotation"] = turned / count
        return _with_score(figures, "cm")


def sequence_sampler(
    corpus: Corpus, backward: bool, rng: np.random.Generator, sensors: DrawSensors = draw_sensors
) -> Callable[[], Sequence]:
    """Return a function that draws a sequence for the body's network.

    Clips are drawn by their length. Clips of standing people are sometimes changed to a rare posture. Some sequences
    are scripted scenes. `sensors` draws the sensors.
    """
    seconds = corpus.length / corpus.rate
    everyday = np.isin(corpus.category, HEADSET_CATEGORIES)
    weight = seconds * np.where(everyday, 1.0, 0.6) * (1 + low_share(corpus))
    still = seconds * standing_share(corpus) ** 2
    weight, still = weight / weight.sum(), still / max(still.sum(), 1e-9)
    shifts = stance_shifts(corpus)

    def draw() -> Sequence:
        if rng.uniform() < _SCENE_SHARE:
            return draw_scene(rng, backward, sensors)
        change_posture = bool(still.any() and rng.uniform() < _POSTURE_SHARE)
        clip = int(rng.choice(len(weight), p=still if change_posture else weight))
        shift = 0.0 if change_posture else float(shifts[clip])
        return draw_sequence(corpus, clip, rng, change_posture, backward, shift, sensors)

    return draw


@dataclass(frozen=True)
class CorpusSampler:
    """`sequence_sampler` of a corpus that each process reads itself; it can be pickled."""

    corpora: CorpusReader
    backward: bool = False
    sensors: DrawSensors = draw_sensors

    def __call__(self, rng: np.random.Generator) -> Callable[[], Sequence]:
        """Return a function that draws a sequence of the train split."""
        return sequence_sampler(self.corpora("train"), self.backward, rng, self.sensors)


@dataclass(frozen=True, eq=False)
class FingerTask(Task):
    """Training task of the fingers' network, which reads the hands of the sequences."""

    network: Any
    configuration: FingerTaskConfig
    schedule: Schedule
    corpus: Corpus
    validation: Mapping[str, FingerValidation]
    source: Mapping[str, Any] | None = None
    mixed = True

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[RawBatch]:
        """Yield chunks of random sequences, each sequence from its first to its last frame."""
        return _stream_batches(self._sequence_sampler(rng), self.configuration)

    def loss(self, batch: RawBatch | SequenceBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor]:
        """Return the losses of both hands in a chunk and the memory after it."""
        batch = assembled(batch)
        assert batch.hands is not None
        before = _memory_before(self.network, batch, memory)
        with layer_autocast(before.device):
            rotation, error, after = self.network(batch.hands.signal, before)
        return finger_losses(rotation, error, batch.hands, self.configuration.losses), after

    @torch.no_grad()
    def validate(self, network: Any) -> dict[str, float]:
        """Return the mean error in cm of points that are not tracked, and its ratio to a baseline's, by sensor set.

        The first figure, the score, is the mean of the ratios.
        """
        figures: dict[str, float] = {}
        for name, (batches, baseline) in self.validation.items():
            missed = float(untracked_distances(partial(predicted_fingers, network), batches).mean())
            figures[f"{name}_cm"], figures[f"{name}_ratio"] = 100 * missed, missed / baseline
        return _with_score(figures, "ratio")

    def _sequence_sampler(self, rng: np.random.Generator) -> Callable[[], Sequence]:
        """Return a function that draws a sequence. Clips with fingers are drawn by their length."""
        weight = np.where(self.corpus.finger_start >= 0, self.corpus.length / self.corpus.rate, 0.0)
        weight /= weight.sum()
        return lambda: draw_hands(self.corpus, int(rng.choice(len(weight), p=weight)), rng)


def _stream_batches(
    draw: Callable[[], Sequence], configuration: CompletionTaskConfig | FingerTaskConfig
) -> Iterator[RawBatch]:
    """Yield chunks of parallel streams that play whole sequences, one after the other."""
    for pieces, begins in stream_sequences(draw, configuration.streams, configuration.chunk):
        yield cut_batch(pieces, configuration.chunk, begins)


def _memory_before(network: Any, batch: SequenceBatch, memory: Tensor | None) -> Tensor:
    """Return the network's memory before a chunk: that of the chunk before it, zero for sequences that begin."""
    before = network.begin(len(batch.begins)) if memory is None else memory
    begins = batch.begins.repeat_interleave(before.shape[1] // len(batch.begins))  # both hands of a sequence
    return torch.where(begins[None, :, None], 0.0, before.detach().float())


def _with_score(figures: dict[str, float], ending: str) -> dict[str, float]:
    """Return the figures with a score before them: the mean of those whose names end with `ending`."""
    return {"score": float(np.mean([value for name, value in figures.items() if name.endswith(ending)]))} | figures


def validation_batches(
    corpus: Corpus, stride: int, backward: bool = False, sets: Mapping[str, tuple[Body, ...]] = SETS
) -> dict[str, list[SequenceBatch]]:
    """Return whole clips of the motions of headset wearers, by sensor set and body.

    Every `stride`-th clip is used. Raises BodysenseError if the split has no such motion.
    """
    clips = [k for k in range(len(corpus)) if corpus.category[k] in HEADSET_CATEGORIES][::stride]
    if not clips:
        raise BodysenseError("the val split has no everyday motion; give --data with some, or without categories")
    return {
        f"{name}_{body}": whole_clips(
            corpus, clips, (body,), sensors=partial(fixed_sensors, SENSOR_SETS[name]), backward=backward
        )
        for name, bodies in sets.items()
        for body in bodies
    }
