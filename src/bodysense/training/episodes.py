"""Episodes: motion seen through a simulated device and turned into what a network reads and should say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from bodysense.body.pose import forward_kinematics
from bodysense.data.augment import mirrored, with_limb_proportions
from bodysense.data.clip import Clip
from bodysense.data.resample import resample
from bodysense.models.body_gru import BodyGru, Tracked
from bodysense.occlusion.dropout import hide_hands
from bodysense.occlusion.headset_camera import HeadsetCamera, observe


@dataclass(frozen=True)
class Variation:
    """How a pass over the data differs from the recording."""

    mirrored: bool = False
    limb_spread: float = 0.0  # standard deviation of the factors of limb lengths
    hand_dropouts_per_minute: float = 0.0


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


def make_episode(clip: Clip, model: BodyGru, variation: Variation, rng: np.random.Generator) -> Episode:
    """See a canonical clip through the headset's cameras at 30 Hz and prepare it for `model`."""
    clip = resample(clip, 30.0)
    if variation.mirrored:
        clip = mirrored(clip)
    if variation.limb_spread:
        # The network scales bodies to one stature itself: vary the proportions only.
        clip = with_limb_proportions(clip, variation.limb_spread, rng)
    observation = observe(clip.pose, clip.time, HeadsetCamera())
    if variation.hand_dropouts_per_minute:
        observation = hide_hands(observation, variation.hand_dropouts_per_minute, rng)
    position, _ = forward_kinematics(clip.pose)
    skeleton = clip.pose.skeleton
    visible = torch.from_numpy(observation.has_position)[None]
    tracked = Tracked(
        position=_tensor(position),
        visible=visible,
        head_position=_tensor(position[:, model.head]),
        head_rotation=_tensor(observation.rotation[:, observation.points.index("head")]),
        interval=torch.full((1, len(clip)), 1 / 30),
        bone_length=_tensor(skeleton.bone_length),
        height=torch.tensor([skeleton.height], dtype=torch.float32),
    )
    with torch.no_grad():
        features, known, turn, _ = model.prepare(tracked, model.start(1))
        offset = model.offsets(tracked.position, turn, tracked.head_position, tracked.height)
    return Episode(
        name=clip.name,
        category=clip.category,
        features=features[0].numpy(),
        known=known[0].numpy(),
        offset=offset[0].numpy(),
        visible=observation.has_position,
        fingers=clip.has_fingers,
    )


def _tensor(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))[None]
