"""Batches of training sequences: frames of the body and, if the sequences have them, of both hands."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.shape import sample_bodies
from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense_lab.completion.data.corpus import Corpus
from bodysense_lab.completion.data.hands import TrainingHands
from bodysense_lab.completion.data.points import SPIN_INDICES
from bodysense_lab.completion.data.sequences import Sequence, SequenceAugmentation, make_sequence
from bodysense_lab.completion.data.training_bodies import TrainingBody
from bodysense_lab.completion.networks.features import Before, TrackedSignal
from bodysense_lab.completion.networks.fingers import FingerSignal
from bodysense_lab.completion.networks.network import turn_about_up
from bodysense_lab.core.fit import cut_frames

_GROUP = 16  # whole sequences in a batch


class HandBatch(NamedTuple):
    """Frames of both hands of B sequences."""

    signal: FingerSignal
    true_position: Tensor  # (B, T, 2, 20, 3) m, in the frame of the wrist
    true_rotation: Tensor  # (B, T, 2, 15, 3, 3) wrist ← joint
    valid: Tensor  # (B, T) bool


class SequenceBatch(NamedTuple):
    """Frames of B sequences; `begins` marks those that start with this batch."""

    signal: TrackedSignal
    true_position: Tensor  # (B, T, 25, 3) m, world
    true_rotation: Tensor  # (B, T, 22, 3, 3) world ← joint
    contact: Tensor  # (B, T, 4)
    valid: Tensor  # (B, T) bool
    begins: Tensor  # (B,) bool
    hands: HandBatch | None = None


class RawBatch(NamedTuple):
    """Drawn frames of B sequences. `assembled` completes them on the training device."""

    parts: dict[str, Tensor]  # frames of the sequences (B, T, ...), and parts of the sequences (B, ...)
    earlier: dict[str, Tensor]  # the frames before these, of the tracked points
    begins: Tensor  # (B,) bool
    hands: HandBatch | None = None


_TRACKED = ("position", "has_position", "has_rotation", "acceleration", "has_acceleration")
_OF_SEQUENCE = ("rest_offset", "certainty", "size", "accuracy", "interval")


def cut_batch(pieces: list[tuple[Sequence, int]], chunk: int, begins: np.ndarray) -> RawBatch:
    """Return `chunk` frames of each sequence, from its start frame on (see `cut_frames`)."""
    now = cut_frames(pieces, chunk, (*_TRACKED, "rotation", "anchor", "true_position", "true_rotation", "contact"))
    earlier = cut_frames([(one, start - 1) for one, start in pieces], chunk, (*_TRACKED[:3], "rotation"))
    sequences = [one for one, _ in pieces]
    now |= {name: _stacked(sequences, name) for name in _OF_SEQUENCE}
    now["first"] = torch.tensor([start == 0 for _, start in pieces])
    hands = [(one.hands, start) for one, start in pieces if one.hands is not None]
    interval = now["interval"][:, None].expand(-1, chunk)
    return RawBatch(now, earlier, torch.from_numpy(begins), _collate_hands(hands, chunk, interval) if hands else None)


def assembled(batch: RawBatch | SequenceBatch) -> SequenceBatch:
    """Return a batch with matrices and masks, made on the device of the raw one; others are returned unchanged."""
    if isinstance(batch, SequenceBatch):
        return batch
    now, earlier = batch.parts, batch.earlier
    anchor, chunk = now["anchor"], now["anchor"].shape[1]
    origin = torch.stack([anchor[..., 2], torch.zeros_like(anchor[..., 2]), anchor[..., 3]], dim=-1)
    has_before = torch.ones_like(now["valid"])[..., None]
    has_before[:, :1] &= ~now["first"][:, None, None]
    signal = TrackedSignal(
        **{name: now[name] for name in (*_TRACKED, "rest_offset", "certainty", "size")},
        rotation=quaternion_to_matrix(now["rotation"]),
        accuracy=now["accuracy"][:, None].expand(-1, chunk, -1),
        interval=now["interval"][:, None].expand(-1, chunk),
        turn=turn_about_up(anchor[..., 0], anchor[..., 1]),
        origin=origin,
        before=Before(
            position=earlier["position"],
            has_position=earlier["has_position"] & has_before,
            rotation=quaternion_to_matrix(earlier["rotation"][..., SPIN_INDICES, :]),
            has_rotation=earlier["has_rotation"][..., SPIN_INDICES] & has_before,
        ),
    )
    return SequenceBatch(
        signal=signal,
        true_position=now["true_position"],
        true_rotation=quaternion_to_matrix(now["true_rotation"]),
        contact=now["contact"].float(),
        valid=now["valid"],
        begins=batch.begins,
        hands=batch.hands,
    )


def collate(pieces: list[tuple[Sequence, int]], chunk: int, begins: np.ndarray) -> SequenceBatch:
    """Return a whole batch of `chunk` frames of each sequence, from its start frame on."""
    return assembled(cut_batch(pieces, chunk, begins))


def _collate_hands(pieces: list[tuple[TrainingHands, int]], chunk: int, interval: Tensor) -> HandBatch:
    kept, turns = (
        ("position", "has_position", "has_rotation", "wrist", "wrist_velocity"),
        ("rotation", "wrist_rotation"),
    )
    now = cut_frames(pieces, chunk, (*kept, *turns, "true_position", "true_rotation"))
    signal = FingerSignal(
        **{name: now[name] for name in kept},
        **{name: quaternion_to_matrix(now[name]) for name in turns},
        rest_offset=_stacked([one for one, _ in pieces], "rest_offset"),
        interval=interval,
    )
    return HandBatch(signal, now["true_position"], quaternion_to_matrix(now["true_rotation"]), now["valid"])


def _stacked(items: Iterable[Any], name: str) -> Tensor:
    return torch.from_numpy(np.stack([np.asarray(getattr(one, name), dtype=np.float32) for one in items]))


def whole_clips(corpus: Corpus, clips: Iterable[int], bodies: tuple[str, ...], **choices: Any) -> list[SequenceBatch]:
    """Return batches of whole clips of similar lengths, on known bodies.

    Args:
        corpus: recorded motion.
        clips: indices of clips.
        bodies: `own`, `stranger` (an unseen body), or both.
        **choices: further fields of `SequenceAugmentation`.
    """
    clips = sorted(clips, key=lambda clip: corpus.length[clip] / corpus.rate[clip])
    sequences = []
    for clip, unseen in zip(clips, sample_bodies("validation", len(clips)), strict=True):
        offsets: Mapping[str, np.ndarray] = {"own": corpus.rest_offset[clip].astype(float), "stranger": unseen}
        for body in bodies:
            augmentation = SequenceAugmentation(TrainingBody.fully_known(offsets[body]), **choices)
            sequences.append(make_sequence(corpus, clip, augmentation, np.random.default_rng([7, clip])))
    groups = [sequences[first : first + _GROUP] for first in range(0, len(sequences), _GROUP)]
    return [
        collate([(one, 0) for one in group], max(map(len, group)), np.ones(len(group), dtype=bool)) for group in groups
    ]
