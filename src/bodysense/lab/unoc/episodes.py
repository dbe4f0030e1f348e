"""Episodes: motion seen through a simulated device and turned into what a network reads and should say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from bodysense.body.pose import forward_kinematics
from bodysense.data.augment import mirrored, with_limb_proportions
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.lab.unoc.network import BodyNetwork, tracked_of
from bodysense.occlusion.dropout import hide_hands
from bodysense.occlusion.headset_camera import HeadsetCamera, observe

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
