"""Episodes: what the network reads and should say agrees with what it does at run time."""

from __future__ import annotations

import numpy as np
import torch

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensors import HEADSET_CAMERA, observe
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.augment import mirrored
from bodysense_lab.unoc.episodes import Variation, make_episode
from bodysense_lab.unoc.network import BodyNetwork, BodyPrediction, TrackedBody


def test_the_truth_in_the_networks_frame_is_the_truth_in_the_world(waving_clip: Clip, network: BodyNetwork) -> None:
    """Said exactly, the offsets of an episode are the clip's own positions."""
    episode = make_episode(waving_clip, network, Variation(), np.random.default_rng(0))
    position, rotation = forward_kinematics(waving_clip.pose)
    head = network.head
    skeleton = waving_clip.pose.skeleton
    tracked = TrackedBody(
        position=torch.zeros(1, *position.shape),
        visible=torch.from_numpy(episode.visible)[None],
        head_position=torch.tensor(position[None, :, head], dtype=torch.float32),
        head_rotation=torch.tensor(rotation[None, :, head], dtype=torch.float32),
        interval=torch.full((1, len(waving_clip)), 1 / 30),
        bone_length=torch.tensor(skeleton.bone_length[None], dtype=torch.float32),
        height=torch.tensor([skeleton.height], dtype=torch.float32),
    )
    offset = torch.from_numpy(episode.offset)[None]
    said = BodyPrediction(offset, torch.zeros(offset.shape[:-1]), torch.ones(offset.shape[:-1]))
    completed = network.place_in_world(said, network.facing(tracked.head_rotation)[1], tracked)
    np.testing.assert_allclose(completed.position[0].numpy(), position, atol=1e-5)


def test_what_is_seen_is_known(waving_clip: Clip, network: BodyNetwork) -> None:
    """Where a point is seen (a finger: with its wrist), its last known offset is the true one; else an earlier one."""
    episode = make_episode(waving_clip, network, Variation(), np.random.default_rng(0))
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    np.testing.assert_array_equal(episode.visible, observation.has_position)
    seen = episode.visible & episode.visible[:, network.origin]
    assert seen.any() and not seen.all()
    np.testing.assert_allclose(episode.known[seen], episode.offset[seen], atol=1e-6)
    kept = ~seen[1:]
    np.testing.assert_array_equal(episode.known[1:][kept], episode.known[:-1][kept])


def test_episodes_are_at_30_frames_a_second(waving_clip: Clip, network: BodyNetwork) -> None:
    fast = resample(waving_clip, 120.0)
    episode = make_episode(fast, network, Variation(), np.random.default_rng(0))
    assert len(episode) == len(waving_clip)
    assert episode.features.shape == (len(waving_clip), network.features)
    slow = make_episode(waving_clip, network, Variation(), np.random.default_rng(0))
    np.testing.assert_allclose(episode.features, slow.features, atol=1e-4)


def test_variations(waving_clip: Clip, network: BodyNetwork) -> None:
    def made(variation: Variation, clip: Clip = waving_clip, seed: int = 0) -> np.ndarray:
        return make_episode(clip, network, variation, np.random.default_rng(seed)).features

    plain = made(Variation())
    np.testing.assert_array_equal(made(Variation(mirrored=True)), made(Variation(), mirrored(waving_clip)))
    assert not np.allclose(plain, made(Variation(mirrored=True)))
    spread = Variation(limb_spread=0.05)
    np.testing.assert_array_equal(made(spread), made(spread))
    assert not np.allclose(made(spread), made(spread, seed=1))
    lost = make_episode(waving_clip, network, Variation(hand_dropouts_per_minute=60), np.random.default_rng(0))
    seen = make_episode(waving_clip, network, Variation(), np.random.default_rng(0))
    assert lost.visible.sum() < seen.visible.sum() and not (lost.visible & ~seen.visible).any()
