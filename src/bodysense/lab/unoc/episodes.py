"""Episodes: motion seen through a simulated device and turned into what a network reads and should say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.dropout import hide_hands
from bodysense.devices.simulated.headset_camera import HeadsetCamera, observe
from bodysense.io.augment import mirrored, with_limb_proportions
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense.lab.unoc.network import BodyNetwork, tracked_of

RATE = 30.0  # Hz, of the paper


@dataclass(frozen=True)
class Variation:
    """How a pass over the data differs from the recording."""

    mirrored: bool = False
    limb_spread: float = 0.0  # standard deviation of the factors of limb lengths
    hand_dropouts_per_minute: float = 0.0
    rates: tuple[float, float] = (RATE, RATE)  # Hz: the frame rate is drawn between them


@dataclass(frozen=True)
class Episode:
    """One clip, ready to learn from."""

    name: str
    category: str
    features: np.ndarray  # (T, F) what the network reads
    known: np.ndarray  # (T, P, 3) last known offsets
    offset: np.ndarray  # (T, P, 3) the truth in the network's frame
    visible: np.ndarray  # (T, P) bool
    fingers: bool

    def __len__(self) -> int:
        return len(self.features)


def make_episode(clip: Clip, model: BodyNetwork, variation: Variation, rng: np.random.Generator) -> Episode:
    """See a canonical clip through the headset's cameras and prepare it for `model`."""
    low, high = variation.rates
    rate = low if low == high else float(np.exp(rng.uniform(np.log(low), np.log(high))))
    clip = resample(clip, rate)
    if variation.mirrored:
        clip = mirrored(clip)
    if variation.limb_spread:
        # The network scales bodies to one stature itself: vary the proportions only.
        clip = with_limb_proportions(clip, variation.limb_spread, rng)
    observation = observe(clip.pose, clip.time, HeadsetCamera())
    if variation.hand_dropouts_per_minute:
        observation = hide_hands(observation, variation.hand_dropouts_per_minute, rng)
    tracked = tracked_of(observation, clip.pose.skeleton)
    truth = torch.from_numpy(np.asarray(forward_kinematics(clip.pose)[0], dtype=np.float32))[None]
    with torch.no_grad():
        features, known, into, _ = model.prepare(tracked, model.start(1))
        offset = model.offsets(truth, into, tracked.height)
    return Episode(
        name=clip.name,
        category=clip.category,
        features=features[0].numpy(),
        known=known[0].numpy(),
        offset=offset[0].numpy(),
        visible=observation.has_position,
        fingers=clip.has_fingers,
    )


class EpisodeBatch(NamedTuple):
    """A chunk of B episodes; `begins` marks those that start with this chunk."""

    features: Tensor  # (B, T, F)
    known: Tensor  # (B, T, P, 3)
    offset: Tensor  # (B, T, P, 3)
    visible: Tensor  # (B, T, P) bool
    valid: Tensor  # (B, T) bool
    fingers: Tensor  # (B,) bool
    begins: Tensor  # (B,) bool


def lanes(
    episodes: Sequence[Episode], weight: np.ndarray, lane_count: int, chunk: int, rng: np.random.Generator
) -> Iterator[EpisodeBatch]:
    """Endless chunks for truncated backpropagation: each of B lanes plays whole clips, drawn by `weight`.

    The state of a lane carries over from batch to batch, except where `begins`. A clip's last chunk is padded.
    """
    length = np.array([len(episode) for episode in episodes])
    for clips, starts, begins in walk(length, weight, lane_count, chunk, rng):
        pieces = [(episodes[clip], int(start)) for clip, start in zip(clips, starts, strict=True)]
        yield collate(pieces, chunk, begins)


def walk(
    length: np.ndarray, weight: np.ndarray, lane_count: int, chunk: int, rng: np.random.Generator
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Where each lane stands, chunk after chunk: its clip, its first frame there, and whether it begins the clip.

    Clips of `length` (C,) frames are drawn by `weight` (C,) and play whole, so that they count by their length already.
    """
    probability = weight / weight.sum()
    clip, place = np.full(lane_count, -1), np.zeros(lane_count, dtype=int)
    while True:
        begins = (clip < 0) | (place >= length[clip])
        for lane in np.flatnonzero(begins):
            clip[lane], place[lane] = rng.choice(len(length), p=probability), 0
        yield clip.copy(), place.copy(), begins
        place += chunk


def collate(pieces: Sequence[tuple[Episode, int]], chunk: int, begins: np.ndarray) -> EpisodeBatch:
    """Cut `chunk` frames from each episode at its start frame; past the end the last frame repeats, not valid.

    A negative start repeats the first frame before it.
    """
    rows = [np.clip(np.arange(start, start + chunk), 0, len(episode) - 1) for episode, start in pieces]
    valid = [np.arange(start, start + chunk) < len(episode) for episode, start in pieces]

    def stack(name: str) -> Tensor:
        return torch.from_numpy(np.stack([getattr(e, name)[r] for (e, _), r in zip(pieces, rows, strict=True)]))

    return EpisodeBatch(
        features=stack("features"),
        known=stack("known"),
        offset=stack("offset"),
        visible=stack("visible"),
        valid=torch.from_numpy(np.stack(valid)),
        fingers=torch.tensor([episode.fingers for episode, _ in pieces]),
        begins=torch.from_numpy(begins),
    )


def windows(
    episodes: Sequence[Episode], window: int, stride: int, batch: int, rng: np.random.Generator
) -> Iterator[EpisodeBatch]:
    """One epoch of windows that end at every `stride`-th frame of every clip, shuffled (papers.md 1.5)."""
    first = [int(rng.integers(min(stride, len(episode)))) for episode in episodes]
    ends = [(k, end) for k, episode in enumerate(episodes) for end in range(first[k], len(episode), stride)]
    order = rng.permutation(len(ends))
    for begin in range(0, len(order), batch):
        chosen = [ends[i] for i in order[begin : begin + batch]]
        pieces = [(episodes[k], end - window + 1) for k, end in chosen]
        yield collate(pieces, window, np.ones(len(pieces), dtype=bool))
