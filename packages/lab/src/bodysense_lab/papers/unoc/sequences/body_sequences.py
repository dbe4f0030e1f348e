"""Training sequences of the body network: its inputs from a simulated headset, and the true offsets."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.geometry.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply, swing_twist
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.core.fit import cut_frames, stream_sequences
from bodysense_lab.data.augment import mirrored, with_limb_proportions
from bodysense_lab.papers.unoc.network.network import BodyNetwork, tracked_of
from bodysense_lab.papers.unoc.sequences.lost_hands import hide_hands


class BodyBatch(NamedTuple):
    """A chunk of B sequences; `begins` marks those that start with this chunk."""

    features: Tensor  # (B, T, F)
    known: Tensor  # (B, T, P, 3)
    offset: Tensor  # (B, T, P, 3) the truth in the network's own frame
    visible: Tensor  # (B, T, P) bool
    valid: Tensor  # (B, T) bool: frames that are part of the clip
    fingers: Tensor  # (B,) bool: clips with recorded fingers
    begins: Tensor  # (B,) bool


RATE = 30.0  # Hz, of the paper


@dataclass(frozen=True)
class Augmentation:
    """Augmentation of the clips in a pass over the data."""

    mirrored: bool = False
    limb_spread: float = 0.0  # standard deviation of the factors of limb lengths
    wrist_bend: float = 0.0  # rad, standard deviation of the bending of wrists without a recorded one
    hand_dropouts_per_minute: float = 0.0
    rates: tuple[float, float] = (RATE, RATE)  # Hz: the frame rate is drawn between them


@dataclass(frozen=True)
class BodySequence:
    """One clip as inputs and targets of the network."""

    features: np.ndarray  # (T, F) what the network reads
    known: np.ndarray  # (T, P, 3) last known offsets
    offset: np.ndarray  # (T, P, 3) the truth in the network's frame
    visible: np.ndarray  # (T, P) bool
    fingers: bool

    def __len__(self) -> int:
        return len(self.features)


def augmented(clip: Clip, augmentation: Augmentation, rng: np.random.Generator) -> Clip:
    """Resample and augment a canonical clip, except for lost hands."""
    low, high = augmentation.rates
    clip = resample(clip, low if low == high else float(np.exp(rng.uniform(np.log(low), np.log(high)))))
    if augmentation.wrist_bend:
        clip = with_bent_wrists(clip, augmentation.wrist_bend, rng)
    if augmentation.mirrored:
        clip = mirrored(clip)
    if augmentation.limb_spread:
        # The network scales bodies to one stature itself: vary the proportions only.
        clip = with_limb_proportions(clip, augmentation.limb_spread, rng)
    return clip


STIFF = np.radians(2.0)  # wrists that never bend further than this were not recorded


def with_bent_wrists(clip: Clip, spread: float, rng: np.random.Generator) -> Clip:
    """Bend wrists without recorded bending slowly and at random; return the clip.

    `spread` is the standard deviation about either axis, radians. From wrists that never bend, a network would learn to
    infer the elbow, which fails on real hands.
    """
    pose, rotation = clip.pose, clip.pose.rotation.copy()
    for side in ("left", "right"):
        wrist = pose.skeleton.index(f"{side}_wrist")
        swing, _ = swing_twist(rotation[:, wrist], np.array([1.0, 0.0, 0.0]))
        if (2 * np.arccos(np.clip(np.abs(swing[:, 0]), 0, 1))).max() > STIFF:
            continue
        bend = np.zeros((len(clip), 3))
        for axis in (1, 2):
            rate, phase = rng.uniform(0.05, 0.8, 2), rng.uniform(0, 2 * np.pi, 2)
            waves = np.sin(2 * np.pi * rate * clip.time[:, None] + phase).sum(axis=1)
            bend[:, axis] = spread * (rng.standard_normal() + waves) / np.sqrt(2)
        rotation[:, wrist] = quaternion_canonical(quaternion_multiply(rotation[:, wrist], quaternion_exp(bend)))
    return replace(clip, pose=Pose(pose.skeleton, pose.root_position, rotation))


def make_body_sequence(
    clip: Clip, model: BodyNetwork, augmentation: Augmentation, rng: np.random.Generator
) -> BodySequence:
    """Observe a canonical clip by the headset's cameras and prepare it for `model`."""
    clip = augmented(clip, augmentation, rng)
    observation = observe(clip.pose, clip.time, HEADSET_CAMERA)
    if augmentation.hand_dropouts_per_minute:
        observation = hide_hands(observation, augmentation.hand_dropouts_per_minute, rng)
    tracked = tracked_of(observation, clip.pose.skeleton)
    truth = torch.from_numpy(np.asarray(forward_kinematics(clip.pose)[0], dtype=np.float32))[None]
    with torch.no_grad():
        features, known, into, _ = model.prepare(tracked, model.start(1))
        offset = model.offsets(truth, into, tracked.height)
    return BodySequence(
        features=features[0].numpy(),
        known=known[0].numpy(),
        offset=offset[0].numpy(),
        visible=observation.has_position,
        fingers=clip.has_fingers,
    )


def carried_batches(
    sequences: Sequence[BodySequence], weight: np.ndarray, batch: int, chunk: int, rng: np.random.Generator
) -> Iterator[BodyBatch]:
    """Endless chunks for truncated backpropagation: B sequences side by side, whole clips drawn by `weight`.

    A row keeps its state from batch to batch, except where `begins`. A clip's last chunk is padded.
    """
    share = weight / weight.sum()
    for pieces, begins in stream_sequences(lambda: sequences[int(rng.choice(len(sequences), p=share))], batch, chunk):
        yield collate(pieces, chunk, begins)


def collate(pieces: Sequence[tuple[BodySequence, int]], chunk: int, begins: np.ndarray) -> BodyBatch:
    """Cut `chunk` frames from each sequence at its start frame (see `cut_frames`)."""
    return BodyBatch(
        **cut_frames(pieces, chunk, ("features", "known", "offset", "visible")),
        fingers=torch.tensor([sequence.fingers for sequence, _ in pieces]),
        begins=torch.from_numpy(begins),
    )


def windows(
    sequences: Sequence[BodySequence], window: int, stride: int, batch: int, rng: np.random.Generator
) -> Iterator[BodyBatch]:
    """One epoch of windows that end at every `stride`-th frame of every clip, shuffled (reproduce.md 1.5)."""
    first = [int(rng.integers(min(stride, len(sequence)))) for sequence in sequences]
    ends = [(k, end) for k, sequence in enumerate(sequences) for end in range(first[k], len(sequence), stride)]
    order = rng.permutation(len(ends))
    for begin in range(0, len(order), batch):
        chosen = [ends[i] for i in order[begin : begin + batch]]
        pieces = [(sequences[k], end - window + 1) for k, end in chosen]
        yield collate(pieces, window, np.ones(len(pieces), dtype=bool))


Batch = TypeVar("Batch", bound=NamedTuple)
_WITHOUT_TIME = ("start", "fingers", "begins")  # fields of a batch without an axis of time


def last_frame(batch: Batch) -> Batch:
    """Return the last frame of windows, the only one that is predicted."""
    return batch._replace(**{k: value[:, -1:] for k, value in batch._asdict().items() if k not in _WITHOUT_TIME})
