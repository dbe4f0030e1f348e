"""Episodes for the three-point network: motion turned into what it reads and should say, and batches of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import matrix_to_quaternion, quaternion_multiply
from bodysense.body.skeleton import BODY, Skeleton
from bodysense.data.augment import mirrored, with_limb_proportions
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.models.body_network import REFERENCE_HEIGHT
from bodysense.models.three_point_network import CONTACT, Prepared, ThreePointNetwork, tracked_of, turn_about_up
from bodysense.observation import Observation
from bodysense.occlusion.dropout import hide, hide_hands
from bodysense.occlusion.three_point import HEAD_ONLY, ThreePoint, observe
from bodysense.training.point_episodes import with_bent_wrists
from bodysense.training.sampling import walk

HEAD = BODY.index("head")
# A foot is in contact while it is this little above where it stands at rest, m, and no faster than this, m/s: feet of
# the CMU recordings slide by 0.13 m/s where they stand. Speeds are over 2 · 0.04 s.
_LOW, _SLOW, _HALF_WINDOW = 0.05, 0.3, 0.04
# What happens to hands in a varied episode: chances of none at all, of one hand alone, of hands without orientation,
# of gaps; in the others nothing is lost.
_HEAD_ONLY, _ONE_HAND, _NO_TURN, _GAPS = 0.08, 0.08, 0.04, 0.35
_GAPS_PER_MINUTE = 8.0  # of each hand


@dataclass(frozen=True)
class ThreePointVariation:
    """How a pass over the data differs from the recording.

    Heights are not drawn: the network brings every body to one stature itself, so that a body of another height is the
    same to it. Proportions are.
    """

    mirrored: bool = False
    limb_spread: float = 0.0  # standard deviation of the factors of limb lengths
    wrist_bend: float = 0.0  # rad, standard deviation of the bending given to wrists of which none was recorded
    rates: tuple[float, float] = (30.0, 30.0)  # Hz: the frame rate is drawn between them
    hands: bool = True  # False: the head alone
    loses_hands: bool = False  # in gaps of 0.2-3 s, or for the whole episode


@dataclass(frozen=True, eq=False)
class ThreePointEpisode:
    """One clip, ready to learn from. Lengths are at the reference height, frames those of the head's heading."""

    category: str
    features: np.ndarray  # (T, F) float16
    rotation: np.ndarray  # (T, 22, 4) float16 wxyz, heading ← joint
    position: np.ndarray  # (T, 22, 3) float32 m, from the head
    travel: np.ndarray  # (T, 5) float32: the head's place in the world, m, and cosine and sine of its heading
    contact: np.ndarray  # (T, 4) bool, of `CONTACT`
    rest_offset: np.ndarray  # (22, 3) float32 m
    interval: float  # s

    def __len__(self) -> int:
        return len(self.features)


class ThreePointBatch(NamedTuple):
    """Frames of B episodes; `begins` marks those that start with this batch."""

    features: Tensor  # (B, T, F)
    rotation: Tensor  # (B, T, 22, 4)
    position: Tensor  # (B, T, 22, 3)
    travel: Tensor  # (B, T, 5)
    contact: Tensor  # (B, T, 4) bool
    rest_offset: Tensor  # (B, 22, 3)
    interval: Tensor  # (B,)
    valid: Tensor  # (B, T) bool
    begins: Tensor  # (B,) bool

    @property
    def prepared(self) -> Prepared:
        """What the network reads."""
        return Prepared(self.features, self.rest_offset)


def make_three_point_episode(
    clip: Clip, network: ThreePointNetwork, variation: ThreePointVariation, rng: np.random.Generator
) -> ThreePointEpisode:
    """Prepare a canonical clip, varied, for `network`."""
    clip = without_fingers(clip)
    if variation.mirrored:
        clip = mirrored(clip)
    if variation.limb_spread:
        clip = with_limb_proportions(clip, variation.limb_spread, rng)
    low, high = variation.rates
    clip = resample(clip, low if low == high else float(np.exp(rng.uniform(np.log(low), np.log(high)))))
    if variation.wrist_bend:
        clip = with_bent_wrists(clip, variation.wrist_bend, rng)
    observation = observe(clip.pose, clip.time, ThreePoint() if variation.hands else HEAD_ONLY)
    if variation.loses_hands:
        observation = _losing_hands(observation, rng)
    return _episode(clip, observation, network)


def _episode(clip: Clip, observation: Observation, network: ThreePointNetwork) -> ThreePointEpisode:
    skeleton = clip.pose.skeleton
    tracked = tracked_of(observation, skeleton)
    with torch.no_grad():
        prepared, into, _ = network.prepare(tracked, network.start(1))
    size, turn = REFERENCE_HEIGHT / skeleton.height, into[0].double().numpy()
    position, rotation = forward_kinematics(clip.pose)
    body, head = position[:, : len(BODY)] * size, position[:, HEAD] * size
    away = matrix_to_quaternion(turn.swapaxes(-1, -2))
    return ThreePointEpisode(
        category=clip.category,
        features=prepared.features[0].numpy().astype(np.float16),
        rotation=quaternion_multiply(np.broadcast_to(away[:, None], rotation.shape), rotation).astype(np.float16),
        position=((body - head[:, None]) @ turn).astype(np.float32),
        travel=np.concatenate([head, turn[:, 0, :1], turn[:, 0, 2:]], axis=1).astype(np.float32),
        contact=in_contact(position[:, skeleton.indices(CONTACT)], skeleton, clip.frame_rate),
        rest_offset=prepared.rest_offset[0].numpy(),
        interval=1 / clip.frame_rate,
    )


def in_contact(feet: np.ndarray, skeleton: Skeleton, rate: float) -> np.ndarray:
    """(T, 4) bool: whether ankles and feet (T, 4, 3) m, in the order of `CONTACT`, stand on the floor."""
    rest = (skeleton.path @ skeleton.rest_offset)[:, 1]
    standing = (rest - rest.min())[skeleton.indices(CONTACT)]
    size = skeleton.height / REFERENCE_HEIGHT
    reach = max(1, round(_HALF_WINDOW * rate))
    place = np.arange(len(feet))
    before, after = np.maximum(place - reach, 0), np.minimum(place + reach, len(feet) - 1)
    time = np.maximum(after - before, 1)[:, None] / rate
    speed = np.linalg.norm(feet[after] - feet[before], axis=-1) / time
    return (feet[..., 1] < standing + _LOW * size) & (speed < _SLOW * size)


def without_fingers(clip: Clip) -> Clip:
    """The clip on the 22 joints of `BODY`, with the end sites that make its height: head top and toe tips."""
    skeleton = clip.pose.skeleton
    names = [*BODY, "head_top", "left_toe", "right_toe"]
    chosen = skeleton.indices(names)
    parents = tuple(
        -1 if skeleton.parents[p] < 0 else names.index(skeleton.points[skeleton.parents[p]]) for p in chosen
    )
    light = Skeleton(BODY, tuple(names[len(BODY) :]), parents, skeleton.rest_offset[chosen])
    rotation = clip.pose.rotation[:, chosen[: len(BODY)]]
    return replace(clip, pose=Pose(light, clip.pose.root_position, rotation), has_fingers=False)


def _losing_hands(observation: Observation, rng: np.random.Generator) -> Observation:
    """Hands lost in gaps, or for the whole episode, or nothing lost."""
    hands, drawn = ("left_wrist", "right_wrist"), rng.uniform()
    if drawn < _HEAD_ONLY:
        return _without(observation, hands)
    drawn -= _HEAD_ONLY
    if drawn < _ONE_HAND:
        observation = _without(observation, (hands[int(rng.integers(2))],))
        return hide_hands(observation, _GAPS_PER_MINUTE, rng)
    drawn -= _ONE_HAND
    if drawn < _NO_TURN:
        turned = observation.has_rotation & (np.array(observation.points) == "head")
        return replace(observation, has_rotation=turned)
    return hide_hands(observation, _GAPS_PER_MINUTE, rng) if drawn - _NO_TURN < _GAPS else observation


def _without(observation: Observation, points: Sequence[str]) -> Observation:
    hidden = np.isin(np.array(observation.points), points)
    return hide(observation, np.broadcast_to(hidden, observation.has_position.shape))


_FRAMES = ("features", "rotation", "position", "travel", "contact")


@dataclass(frozen=True, eq=False)
class Corpus:
    """Episodes, their frames one after the other."""

    frames: dict[str, np.ndarray]  # by field of an episode, (N, …)
    length: np.ndarray  # (C,)
    start: np.ndarray  # (C,)
    rest_offset: np.ndarray  # (C, 22, 3)
    interval: np.ndarray  # (C,) s
    category: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.length)

    @property
    def minutes(self) -> float:
        """Of motion."""
        return float((self.length * self.interval).sum() / 60)

    def batch(self, clip: np.ndarray, first: np.ndarray, chunk: int, begins: np.ndarray) -> ThreePointBatch:
        """`chunk` frames of episodes `clip` (B,) from their frames `first` (B,); past the end the last one repeats."""
        frame = first[:, None] + np.arange(chunk)
        row = self.start[clip][:, None] + np.minimum(frame, self.length[clip][:, None] - 1)
        taken = {name: torch.from_numpy(self.frames[name][row]) for name in _FRAMES}
        return ThreePointBatch(
            features=taken["features"].float(),
            rotation=taken["rotation"].float(),
            position=taken["position"],
            travel=taken["travel"],
            contact=taken["contact"],
            rest_offset=torch.from_numpy(self.rest_offset[clip]),
            interval=torch.from_numpy(self.interval[clip]),
            valid=torch.from_numpy(frame < self.length[clip][:, None]),
            begins=torch.from_numpy(begins),
        )

    def lanes(self, lane_count: int, chunk: int, rng: np.random.Generator) -> Iterator[ThreePointBatch]:
        """Endless chunks of whole episodes, side by side, whose state carries over except where `begins`."""
        for clip, first, begins in walk(self.length, np.ones(len(self)), lane_count, chunk, rng):
            yield self.batch(clip, first, chunk, begins)

    def whole(self, clip: int) -> ThreePointBatch:
        """One episode."""
        one = np.array([clip])
        return self.batch(one, np.zeros(1, dtype=int), int(self.length[clip]), np.ones(1, dtype=bool))


def corpus_of(episodes: list[ThreePointEpisode]) -> Corpus:
    """Put episodes one after the other."""
    length = np.array([len(episode) for episode in episodes])
    return Corpus(
        frames={name: np.concatenate([getattr(episode, name) for episode in episodes]) for name in _FRAMES},
        length=length,
        start=np.cumsum(length) - length,
        rest_offset=np.stack([episode.rest_offset for episode in episodes]),
        interval=np.array([episode.interval for episode in episodes], dtype=np.float32),
        category=tuple(episode.category for episode in episodes),
    )


def world_turn(travel: Tensor) -> Tensor:
    """(..., 3, 3): turns row vectors from the heading's frame, of `travel` (..., 5), into the world."""
    return turn_about_up(travel[..., 3], travel[..., 4]).mT
