"""Training of the body network: on whole sequences with carried state, or on windows as in the paper (section 4.2).

The losses of UNOC, section 4.2: position, kinematics, occlusion; and the expected error that IK weighs by.

Episodes: motion seen through a simulated device and turned into what a network reads and should say.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
import torch
from torch import Tensor

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_canonical, quaternion_exp, quaternion_multiply, swing_twist
from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.augment import mirrored, with_limb_proportions
from bodysense_lab.fit import Task, cut, played, rate_at
from bodysense_lab.precision import layer_autocast
from bodysense_lab.scoring import scored_points
from bodysense_lab.unoc.lost_hands import hide_hands
from bodysense_lab.unoc.network import BodyNetwork, BodyNetworkConfig, BodyPrediction, tracked_of


@dataclass(frozen=True)
class LossWeights:
    """Weights of the paper's losses (section 4.2). Terms are means over points, in metres at the reference height."""

    body: float = 10.0
    finger: float = 100.0
    parent: float = 3.0
    body_bone: float = 7.0
    finger_bone: float = 10.0
    occluded: float = 1.2  # factor on the position terms of hidden points
    occlusion: float = 0.025
    expected_error: float = 0.01
    sums: bool = False  # bones and occlusion are sums over points, as the paper prints L_kin and L_occ


class EpisodeBatch(NamedTuple):
    """A chunk of B episodes; `begins` marks those that start with this chunk."""

    features: Tensor  # (B, T, F)
    known: Tensor  # (B, T, P, 3)
    offset: Tensor  # (B, T, P, 3) the truth in the network's own frame
    visible: Tensor  # (B, T, P) bool
    valid: Tensor  # (B, T) bool: frames that are part of the clip
    fingers: Tensor  # (B,) bool: clips with recorded fingers
    begins: Tensor  # (B,) bool


def body_loss(
    model: BodyNetwork, answer: BodyPrediction, truth: EpisodeBatch, weights: LossWeights
) -> dict[str, Tensor]:
    """The weighted terms and their sum, 'loss'. Distances are Euclidean; terms that a clip cannot teach are masked."""
    points, device = len(model.skeleton.points), truth.offset.device
    is_finger = torch.zeros(points, dtype=torch.bool, device=device)
    is_finger[model.finger] = True
    counted = torch.ones(points, dtype=torch.bool, device=device)
    counted[model.head] = False
    mask = truth.valid[..., None] & counted & (~is_finger | truth.fingers[:, None, None])
    count = mask.sum().clamp(min=1)
    # Sums over points are averaged over frames.
    frames = truth.valid.sum().clamp(min=1) if weights.sums else count

    emphasis = 1 + (weights.occluded - 1) * (~truth.visible).float()
    distance = length_of(answer.offset - truth.offset)
    position_weight = torch.where(is_finger, weights.finger, weights.body)
    position = (distance * position_weight * emphasis * mask).sum() / count

    bone, true_bone = (bones(model, offset) for offset in (answer.offset, truth.offset))
    parent = (length_of(bone - true_bone) * emphasis * mask).sum() / frames * weights.parent
    bone_weight = torch.where(is_finger, weights.finger_bone, weights.body_bone)
    length = ((length_of(bone) - length_of(true_bone)).abs() * bone_weight * mask).sum() / frames

    cross_entropy = torch.nn.functional.binary_cross_entropy_with_logits(
        answer.hidden_logit, (~truth.visible).float(), reduction="none"
    )
    occlusion = (cross_entropy * mask).sum() / frames * weights.occlusion
    expected = (unlikelihood(distance, answer.error) * mask).sum() / count * weights.expected_error
    terms = {"position": position, "parent": parent, "bone": length, "occlusion": occlusion, "expected": expected}
    return {"loss": torch.stack(list(terms.values())).sum(), **terms}


def bones(model: BodyNetwork, offset: Tensor) -> Tensor:
    """Vectors from every point's parent to the point, in the network's frame: (B, T, P, 3)."""
    parents = [max(parent, 0) for parent in model.skeleton.parents]
    at_wrist = [parent == model.origin[point] and point in model.finger for point, parent in enumerate(parents)]
    from_parent = offset - offset[..., parents, :]
    return torch.where(torch.tensor(at_wrist, device=offset.device)[:, None], offset, from_parent)


def length_of(vector: Tensor) -> Tensor:
    """Lengths of vectors (..., 3), with a slope at zero."""
    return torch.sqrt((vector * vector).sum(dim=-1) + 1e-12)


def unlikelihood(distance: Tensor, expected: Tensor) -> Tensor:
    """By Laplace's distribution: its optimum is the mean absolute error. The error itself is not pulled by it."""
    return (distance.detach() + 1e-4) / expected + torch.log(expected)


RATE = 30.0  # Hz, of the paper


@dataclass(frozen=True)
class Variation:
    """How a pass over the data differs from the recording."""

    mirrored: bool = False
    limb_spread: float = 0.0  # standard deviation of the factors of limb lengths
    wrist_bend: float = 0.0  # rad, standard deviation of the bending given to wrists of which none was recorded
    hand_dropouts_per_minute: float = 0.0
    rates: tuple[float, float] = (RATE, RATE)  # Hz: the frame rate is drawn between them


@dataclass(frozen=True)
class Episode:
    """One clip, ready to learn from."""

    features: np.ndarray  # (T, F) what the network reads
    known: np.ndarray  # (T, P, 3) last known offsets
    offset: np.ndarray  # (T, P, 3) the truth in the network's frame
    visible: np.ndarray  # (T, P) bool
    fingers: bool

    def __len__(self) -> int:
        return len(self.features)


def varied(clip: Clip, variation: Variation, rng: np.random.Generator) -> Clip:
    """Return a canonical clip at the rate of a pass and with its changes, but for lost hands."""
    low, high = variation.rates
    clip = resample(clip, low if low == high else float(np.exp(rng.uniform(np.log(low), np.log(high)))))
    if variation.wrist_bend:
        clip = with_bent_wrists(clip, variation.wrist_bend, rng)
    if variation.mirrored:
        clip = mirrored(clip)
    if variation.limb_spread:
        # The network scales bodies to one stature itself: vary the proportions only.
        clip = with_limb_proportions(clip, variation.limb_spread, rng)
    return clip


STIFF = np.radians(2.0)  # wrists that never bend further than this were not recorded


def with_bent_wrists(clip: Clip, spread: float, rng: np.random.Generator) -> Clip:
    """The clip with slow random bending of every wrist of which no bending was recorded; others are left alone.

    `spread` is the standard deviation of either axis, radians. A wrist that only ever follows the forearm would tell a
    network where the elbow is, which no hand does.
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


def make_episode(clip: Clip, model: BodyNetwork, variation: Variation, rng: np.random.Generator) -> Episode:
    """See a canonical clip through the headset's cameras and prepare it for `model`."""
    clip = varied(clip, variation, rng)
    observation = observe(clip.pose, clip.time, HEADSET_CAMERA)
    if variation.hand_dropouts_per_minute:
        observation = hide_hands(observation, variation.hand_dropouts_per_minute, rng)
    tracked = tracked_of(observation, clip.pose.skeleton)
    truth = torch.from_numpy(np.asarray(forward_kinematics(clip.pose)[0], dtype=np.float32))[None]
    with torch.no_grad():
        features, known, into, _ = model.prepare(tracked, model.start(1))
        offset = model.offsets(truth, into, tracked.height)
    return Episode(
        features=features[0].numpy(),
        known=known[0].numpy(),
        offset=offset[0].numpy(),
        visible=observation.has_position,
        fingers=clip.has_fingers,
    )


def lanes(
    episodes: Sequence[Episode], weight: np.ndarray, lane_count: int, chunk: int, rng: np.random.Generator
) -> Iterator[EpisodeBatch]:
    """Endless chunks for truncated backpropagation: each of B lanes plays whole clips, drawn by `weight`.

    The state of a lane carries over from batch to batch, except where `begins`. A clip's last chunk is padded.
    """
    share = weight / weight.sum()
    for pieces, begins in played(lambda: episodes[int(rng.choice(len(episodes), p=share))], lane_count, chunk):
        yield collate(pieces, chunk, begins)


def collate(pieces: Sequence[tuple[Episode, int]], chunk: int, begins: np.ndarray) -> EpisodeBatch:
    """Cut `chunk` frames from each episode at its start frame (see `cut`)."""
    return EpisodeBatch(
        **cut(pieces, chunk, ("features", "known", "offset", "visible")),
        fingers=torch.tensor([episode.fingers for episode, _ in pieces]),
        begins=torch.from_numpy(begins),
    )


def windows(
    episodes: Sequence[Episode], window: int, stride: int, batch: int, rng: np.random.Generator
) -> Iterator[EpisodeBatch]:
    """One epoch of windows that end at every `stride`-th frame of every clip, shuffled (reproduce.md 1.5)."""
    first = [int(rng.integers(min(stride, len(episode)))) for episode in episodes]
    ends = [(k, end) for k, episode in enumerate(episodes) for end in range(first[k], len(episode), stride)]
    order = rng.permutation(len(ends))
    for begin in range(0, len(order), batch):
        chosen = [ends[i] for i in order[begin : begin + batch]]
        pieces = [(episodes[k], end - window + 1) for k, end in chosen]
        yield collate(pieces, window, np.ones(len(pieces), dtype=bool))


Batch = TypeVar("Batch", bound=NamedTuple)
_OF_EPISODES = ("start", "fingers", "begins")  # fields of a batch without an axis of time


def last_frame(batch: Batch) -> Batch:
    """Return the last frame of windows, which is the one that they answer."""
    return batch._replace(**{k: value[:, -1:] for k, value in batch._asdict().items() if k not in _OF_EPISODES})


CARRIED_STEPS = 20_000


@dataclass(frozen=True)
class BodySchedule:
    """How long and on what."""

    steps: int | None = None  # at most; None: `CARRIED_STEPS` of carried training, all epochs of windows
    lanes: int = 256
    chunk: int = 12  # frames of truncated backpropagation
    learning_rate: float = 1e-3
    warm_up: int = 300  # steps of carried training
    finger_share: float = 0.3  # how often a drawn clip has recorded fingers
    average_decay: float = 0.999  # the kept weights are a moving average; 0 keeps the last ones
    epochs: int = 5  # of windows
    epoch_batches: tuple[int, ...] = (256, 512, 1024, 1024, 1024)  # reproduce.md 1.8
    window_stride: int = 1  # train on every n-th window; 1 is the paper's
    check_every: int = 500
    seed: int = 1
    loss: LossWeights = field(default_factory=LossWeights)


@dataclass(frozen=True, eq=False)
class BodyTask(Task):
    """Training of the body network on whole sequences with carried state, or on windows as in the paper."""

    network: BodyNetwork
    schedule: BodySchedule
    episodes: Sequence[Episode]
    validation: Sequence[Episode]
    source: Mapping[str, Any] | None = None
    keeps_best = False
    mixed = True
    clip = 5.0

    @property
    def steps(self) -> int:
        """Optimiser steps of the whole run."""
        return step_count(self.network.config, self.schedule, self.episodes)

    def rate(self, step: int) -> float:
        """Warm-up and cosine for carried training; constant for windows, as in the paper."""
        if self.network.config.window is not None:
            return self.schedule.learning_rate
        return rate_at(self.schedule, step, self.steps)

    def batches(self, rng: np.random.Generator, done: int = 0) -> Iterator[EpisodeBatch]:
        """See `make_batches`."""
        return make_batches(self.network.config, self.schedule, self.episodes, rng, done)

    def loss(self, batch: EpisodeBatch, memory: Tensor | None) -> tuple[dict[str, Tensor], Tensor | None]:
        """Loss terms of a chunk with carried memory, or of the last frame of windows."""
        network = self.network
        if memory is None:
            memory = network.start(len(batch.begins)).memory
        with layer_autocast(batch.features.device):
            if network.config.window is None:
                memory = torch.where(batch.begins[:, None], 0.0, memory.detach().float())
                hidden, memory = network.recurrent(batch.features, memory)
            else:
                hidden, batch = network.recurrent.last(batch.features)[:, None], last_frame(batch)
            answer = network.answer(batch.features, hidden, batch.known)
            return body_loss(network, answer, batch, self.schedule.loss), memory

    def validate(self, network: BodyNetwork) -> dict[str, float]:
        """See `validate`."""
        return validate(network, self.validation)


def step_count(config: BodyNetworkConfig, schedule: BodySchedule, episodes: Sequence[Episode]) -> int:
    """Optimiser steps of a whole run."""
    most = schedule.steps
    if config.window is None:
        return CARRIED_STEPS if most is None else most
    fewest = sum(max(1, len(episode) // schedule.window_stride) for episode in episodes)  # windows of an epoch
    whole = sum(max(1, fewest // batch) for batch in schedule.epoch_batches[: schedule.epochs])
    return whole if most is None else min(most, whole)


def make_batches(
    config: BodyNetworkConfig, schedule: BodySchedule, episodes: Sequence[Episode], rng: np.random.Generator, done: int
) -> Iterator[EpisodeBatch]:
    """The run's batches from step `done` on: sequences without end, or the epochs of windows."""
    if config.window is None:
        fingers = np.array([episode.fingers for episode in episodes])
        share = np.where(fingers, schedule.finger_share, 1 - schedule.finger_share)
        length = np.array([len(episode) for episode in episodes], dtype=float)
        # Fingers are drawn by `finger_share` of the frames, spread evenly over all that have them.
        weight = share / np.where(fingers, length[fingers].sum(), length[~fingers].sum())
        return lanes(episodes, weight, schedule.lanes, schedule.chunk, rng)
    epochs = (
        windows(episodes, config.window, schedule.window_stride, batch, rng)
        for batch in schedule.epoch_batches[: schedule.epochs]
    )
    return itertools.islice(itertools.chain.from_iterable(epochs), done, None)


@torch.no_grad()
def validate(model: BodyNetwork, episodes: Sequence[Episode]) -> dict[str, float]:
    """Occluded RMSJPE (cm at the reference height, network's frame) of the network and of last-known, body and fingers.

    Where no clip has fingers, there are no figures of them.
    """
    tested = scored_points(model.skeleton)
    total = {key: 0.0 for key in ("body", "body_known", "finger", "finger_known")}
    count = {"body": 0, "finger": 0}
    device, training = model.scale.device, model.training
    wrist = model.skeleton.wrist_of[model.finger].tolist()
    model.eval()
    for episode in episodes:
        batch = collate([(episode, 0)], len(episode), np.ones(1, dtype=bool))
        hidden, _ = model.recurrent(batch.features.to(device), model.start(1).memory)
        offset = model.answer(batch.features.to(device), hidden, batch.known.to(device)).offset.cpu()
        for part, points in (("body", tested), ("finger", model.finger)):
            if part == "finger" and not episode.fingers:
                continue
            mask = ~batch.visible[..., points]
            count[part] += int(mask.sum())
            for key, guess in ((part, offset), (f"{part}_known", batch.known)):
                missed = guess - batch.offset
                if part == "finger" and model.config.finger_origin == "head":
                    missed[..., points, :] -= missed[..., wrist, :]
                squared = (missed[..., points, :] ** 2).sum(dim=-1)
                total[key] += float((squared * mask).sum())
    model.train(training)
    hidden = {key: count[key.partition("_")[0]] for key in total}
    return {key: 100 * math.sqrt(value / hidden[key]) for key, value in total.items() if hidden[key]}
