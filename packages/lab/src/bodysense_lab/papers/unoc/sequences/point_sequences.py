"""Training sequences of networks that predict points: their inputs and targets, and batches of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.resting import resting_offset
from bodysense.devices.simulated.sensors import THREE_POINTS
from bodysense.io.clip import Clip
from bodysense_lab.core.fit import cut_frames, stream_sequences
from bodysense_lab.papers.unoc.network.point_network import PointNetwork, TrackedPoints
from bodysense_lab.papers.unoc.sequences.body_sequences import Augmentation, augmented


@dataclass(frozen=True, eq=False)
class PointSequence:
    """One clip as inputs and targets of the network: float32."""

    features: np.ndarray  # (T, F) what the network reads
    start: np.ndarray  # (O, 3) resting offsets
    known: np.ndarray  # (T, R, 3) offsets of the points that are read
    offset: np.ndarray  # (T, O, 3) the truth

    def __len__(self) -> int:
        return len(self.features)


class PointBatch(NamedTuple):
    """Frames of B sequences; `begins` marks those that start with this batch."""

    features: Tensor  # (B, T, F)
    start: Tensor  # (B, O, 3)
    known: Tensor  # (B, T, R, 3)
    offset: Tensor  # (B, T, O, 3)
    valid: Tensor  # (B, T) bool
    begins: Tensor  # (B,) bool


def make_point_sequence(
    clip: Clip, network: PointNetwork, augmentation: Augmentation, rng: np.random.Generator
) -> PointSequence:
    """Augment a canonical clip and prepare it for `network`."""
    tracked, truth = tracked_of(augmented(clip, augmentation, rng).pose, network)
    with torch.no_grad():
        prepared, offset = network.prepare(tracked), network.offsets(truth, tracked)
    return PointSequence(
        features=prepared.features[0].numpy(),
        start=prepared.start[0].numpy(),
        known=prepared.known[0].numpy(),
        offset=offset[0].numpy(),
    )


def tracked_of(pose: Pose, network: PointNetwork) -> tuple[TrackedPoints, Tensor]:
    """Return the inputs of `network` for a motion (T, …), and the true world positions (1, T, O, 3) m."""
    skeleton = pose.skeleton
    position, rotation = (np.asarray(values, dtype=np.float32)[None] for values in forward_kinematics(pose))
    places = skeleton.indices(network.config.places)
    tracked = TrackedPoints(
        position=torch.from_numpy(position[..., skeleton.indices(network.config.reads), :]),
        rotation=torch.from_numpy(rotation[..., skeleton.indices(THREE_POINTS), :]),
        rest=torch.tensor(resting_offset(skeleton)[None, places], dtype=torch.float32),
        bone_length=torch.tensor(skeleton.bone_length[None], dtype=torch.float32),
        height=torch.tensor([skeleton.extent], dtype=torch.float32),
    )
    return tracked, torch.from_numpy(position[..., places, :])


def collate(pieces: Sequence[tuple[PointSequence, int]], length: int, begins: np.ndarray) -> PointBatch:
    """Cut `length` frames from each sequence at its start frame (see `cut_frames`)."""
    return PointBatch(
        **cut_frames(pieces, length, ("features", "known", "offset")),
        start=torch.from_numpy(np.stack([sequence.start for sequence, _ in pieces])),
        begins=torch.from_numpy(begins),
    )


def carried_batches(
    sequences: Sequence[PointSequence], batch: int, chunk: int, rng: np.random.Generator
) -> Iterator[PointBatch]:
    """Endless chunks of whole clips, `batch` side by side, whose state carries over except where `begins`."""
    # A drawn clip plays whole, so that it counts by its length already.
    for pieces, begins in stream_sequences(lambda: sequences[int(rng.integers(len(sequences)))], batch, chunk):
        yield collate(pieces, chunk, begins)


def windows(
    sequences: Sequence[PointSequence], window: int, batch: int, rng: np.random.Generator
) -> Iterator[PointBatch]:
    """Endless batches of windows that end at a frame drawn from all frames of all clips."""
    length = np.array([len(sequence) for sequence in sequences])
    first = np.cumsum(length) - length
    while True:
        drawn = rng.integers(length.sum(), size=batch)
        which = np.searchsorted(first, drawn, side="right") - 1
        pieces = [(sequences[k], int(frame - first[k]) - window + 1) for k, frame in zip(which, drawn, strict=True)]
        yield collate(pieces, window, np.ones(batch, dtype=bool))
