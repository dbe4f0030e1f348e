"""The training task of the completion networks: batches, losses, and figures on validation people and bodies.

The body's and the fingers' network learn from the same sequences, one after the other.
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
from bodysense_lab.completion.batches import SequenceBatch, collate, whole_clips
from bodysense_lab.completion.corpus import Corpus
from bodysense_lab.completion.finger_errors import predicted_fingers, untracked_distances
from bodysense_lab.completion.fingers import FingerConfig
from bodysense_lab.completion.losses import FingerLosses, Losses, finger_losses, losses, missed_by
from bodysense_lab.completion.network import CompletionConfig
from bodysense_lab.completion.points import JOINTS
from bodysense_lab.completion.postures import low_share, standing_share
from bodysense_lab.completion.sensor_draws import worn
from bodysense_lab.completion.sequences import Sequence, draw_hands, draw_sequence
from bodysense_lab.fit import Task, stream_sequences
from bodysense_lab.options import Schedule
from bodysense_lab.precision import layer_autocast

WORN = ("sit", "talk_gesture", "everyday", "locomotion", "")  # what wearers of a headset do; unknown motion counts
SETS = ("three_point", "head", "six_point", "headset_camera", "three_point_imu_feet")
_SETTLED = 0.15  # share of sequences in postures that are rare in recordings
_GENERATED = 0.5  # share of sequences whose fingers are generated


@dataclass(frozen=True)
class CompletionTaskConfig:
    """Batches and losses of the body."""

    network: CompletionConfig = CompletionConfig()
    streams: int = 96  # sequences side by side
    chunk: int = 48  # frames of truncated backpropagation
    backward: bool = False  # time runs backward
    losses: Losses = field(default_factory=Losses)


@dataclass(frozen=True)
class FingerTaskConfig:
    """Batches and losses of the fingers."""

    network: FingerConfig = FingerConfig()
    streams: int = 32  # sequences side by side
    chunk: int = 48  # frames of truncated backpropagation
    losses: FingerLosses = field(default_factory=FingerLosses)
    generated_hours: float = 0.0  # of generated fingers, which clips without fingers move; 0: those are left out
    left_out: str = ""  # person whose clips are excluded from training


@dataclass(frozen=True, eq=False)
class CompletionTask(Task):
    """The task of `bodysense_lab.fit` for the body's network, which plays through sequences."""

    network: Any
    configuration: Any
    schedule: Schedule
    corpus: Corpus
    validation: Mapping[str, Any]
    source: Mapping[str, Any] | None = None
    precision: torch.dtype | None = None  # of the layers; None: the device's own
    mixed = True

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[SequenceBatch]:
        """Streams that play whole sequences, side by side; drawn by the length of their clips."""
        chunk = self.configuration.chunk
        for pieces, begins in stream_sequences(self.drawing(rng), self.configuration.streams, chunk):
            yield collate(pieces, chunk, begins)

    def loss(self, batch: SequenceBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor]:
        """Losses of a chunk, with the memory carried over where no sequence begins."""
        before = self.network.begin(len(batch.begins)) if memory is None else memory
        begins = batch.begins.repeat_interleave(before.shape[1] // len(batch.begins))  # both hands of a sequence
        return self.terms(batch, torch.where(begins[None, :, None], 0.0, before.detach().float()))

    def drawing(self, rng: np.random.Generator) -> Callable[[], Sequence]:
        """Return a function that draws a sequence of a clip by its length, sometimes of a person who settles."""
        seconds = self.corpus.length / self.corpus.rate
        weight = seconds * np.where(np.isin(self.corpus.category, WORN), 1.0, 0.6) * (1 + low_share(self.corpus))
        still = seconds * standing_share(self.corpus) ** 2
        weight, still = weight / weight.sum(), still / max(still.sum(), 1e-9)

        def draw() -> Sequence:
            settles = bool(still.any() and rng.uniform() < _SETTLED)
            clip = int(rng.choice(len(weight), p=still if settles else weight))
            return draw_sequence(self.corpus, clip, rng, settles, self.configuration.backward)

        return draw

    def terms(self, batch: SequenceBatch, before: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Return the losses of the body and the memory after a chunk."""
        features = self.network.read(batch.signal)
        with layer_autocast(features.device, self.precision):
            (turned, judged), after = self.network.predict(features, before)
        prediction = self.network.prediction(turned.float(), judged.float())
        return losses(self.network, prediction, batch, self.configuration.losses), after

    @torch.no_grad()
    def validate(self, network: Any) -> dict[str, float]:
        """Mean error from the head, cm in the world's measure, for each set of sensors and bodies; first their mean."""
        figures: dict[str, float] = {}
        for name, batches in self.validation.items():
            far, turned, count = 0.0, 0.0, 0.0
            for batch in batches:
                raw, _ = network.predict(network.read(batch.signal), network.begin(len(batch.begins)))
                missed, rotation, wanted = missed_by(network, network.prediction(*raw), batch)
                angle = (rotation - wanted).abs().mean(dim=(-2, -1))
                distance = missed[..., :JOINTS, :].norm(dim=-1).mean(dim=-1) * batch.signal.size[:, None]
                far += float((distance * batch.valid).sum())
                turned += float((angle.mean(dim=-1) * batch.valid).sum())
                count += float(batch.valid.sum())
            figures[f"{name}_mpjpe_cm"] = 100 * far / count
            figures[f"{name}_rotation"] = turned / count
        return _scored(figures, "cm")


@dataclass(frozen=True, eq=False)
class FingerTask(CompletionTask):
    """Task for the fingers' network, which reads and places the hands of the sequences."""

    generated: np.ndarray | None = None  # (N, 30, 4)

    def drawing(self, rng: np.random.Generator) -> Callable[[], Sequence]:
        """Return a function that draws a sequence of a clip by its length, recorded fingers as often as generated."""
        weight, recorded = self.corpus.length / self.corpus.rate, self.corpus.finger_start >= 0
        for part, share in ((recorded, 1 - _GENERATED), (~recorded, 0.0 if self.generated is None else _GENERATED)):
            weight[part] *= share / max(weight[part].sum(), 1e-9)
        weight /= weight.sum()
        return lambda: draw_hands(self.corpus, int(rng.choice(len(weight), p=weight)), rng, self.generated)

    def terms(self, batch: SequenceBatch, before: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Return the losses of both hands and the memory after a chunk."""
        assert batch.hands is not None
        with layer_autocast(before.device, self.precision):
            rotation, error, after = self.network(batch.hands.signal, before)
        return finger_losses(rotation, error, batch.hands, self.configuration.losses), after

    @torch.no_grad()
    def validate(self, network: Any) -> dict[str, float]:
        """Mean error, cm, of points that are not tracked, and its ratio to a baseline's, by set of sensors.

        The first figure is the mean of the ratios.
        """
        figures: dict[str, float] = {}
        for name, (batches, baseline) in self.validation.items():
            missed = float(untracked_distances(partial(predicted_fingers, network), batches).mean())
            figures[f"{name}_cm"], figures[f"{name}_ratio"] = 100 * missed, missed / baseline
        return _scored(figures, "ratio")


def _scored(figures: dict[str, float], ending: str) -> dict[str, float]:
    """Return figures after their score, the mean of those whose names end so."""
    return {"score": float(np.mean([value for name, value in figures.items() if name.endswith(ending)]))} | figures


def validation_batches(corpus: Corpus, stride: int, backward: bool = False) -> dict[str, list[SequenceBatch]]:
    """Return every `stride`-th clip of what wearers do, whole, on its own and on an unseen body; by set and body."""
    clips = [k for k in range(len(corpus)) if corpus.category[k] in WORN][::stride]
    if not clips:
        raise BodysenseError("the val split has no everyday motion; give --data with some, or without categories")
    return {
        f"{name}_{body}": whole_clips(corpus, clips, (body,), track=partial(worn, SENSOR_SETS[name]), backward=backward)
        for name in SETS
        for body in ("own", "stranger")
    }
