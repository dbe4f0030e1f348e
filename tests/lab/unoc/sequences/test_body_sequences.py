"""Training sequences: inputs and targets agree with those at run time."""

from __future__ import annotations

import numpy as np
import torch

from bodysense.body.pose import forward_kinematics
from bodysense.devices.simulated.sensing import observe
from bodysense.devices.simulated.sensors import HEADSET_CAMERA
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.data.augment import mirrored
from bodysense_lab.papers.unoc.network.network import BodyNetwork, BodyPrediction, TrackedBody
from bodysense_lab.papers.unoc.sequences.body_sequences import Augmentation, make_body_sequence


def test_the_truth_in_the_networks_frame_is_the_truth_in_the_world(waving_clip: Clip, network: BodyNetwork) -> None:
    """If predicted exactly, the offsets of a sequence give the positions of the clip."""
    sequence = make_body_sequence(waving_clip, network, Augmentation(), np.random.default_rng(0))
    position, rotation = forward_kinematics(waving_clip.pose)
    head = network.head
    skeleton = waving_clip.pose.skeleton
    tracked = TrackedBody(
        position=torch.zeros(1, *position.shape),
        visible=torch.from_numpy(sequence.visible)[None],
        head_position=torch.tensor(position[None, :, head], dtype=torch.float32),
        head_rotation=torch.tensor(rotation[None, :, head], dtype=torch.float32),
        interval=torch.full((1, len(waving_clip)), 1 / 30),
        bone_length=torch.tensor(skeleton.bone_length[None], dtype=torch.float32),
        height=torch.tensor([skeleton.extent], dtype=torch.float32),
    )
    offset = torch.from_numpy(sequence.offset)[None]
    predicted = BodyPrediction(offset, torch.zeros(offset.shape[:-1]), torch.ones(offset.shape[:-1]))
    completed = network.place_in_world(predicted, network.facing(tracked.head_rotation)[1], tracked)
    np.testing.assert_allclose(completed.position[0].numpy(), position, atol=1e-5)


def test_visible_points_are_known(waving_clip: Clip, network: BodyNetwork) -> None:
    """Where a point is seen (a finger: with its wrist), its last known offset is the true one; else an earlier one."""
    sequence = make_body_sequence(waving_clip, network, Augmentation(), np.random.default_rng(0))
    observation = observe(waving_clip.pose, waving_clip.time, HEADSET_CAMERA)
    np.testing.assert_array_equal(sequence.visible, observation.has_position)
    seen = sequence.visible & sequence.visible[:, network.origin]
    assert seen.any() and not seen.all()
    np.testing.assert_allclose(sequence.known[seen], sequence.offset[seen], atol=1e-6)
    kept = ~seen[1:]
    np.testing.assert_array_equal(sequence.known[1:][kept], sequence.known[:-1][kept])


def test_sequences_have_30_frames_a_second(waving_clip: Clip, network: BodyNetwork) -> None:
    fast = resample(waving_clip, 120.0)
    sequence = make_body_sequence(fast, network, Augmentation(), np.random.default_rng(0))
    assert len(sequence) == len(waving_clip)
    assert sequence.features.shape == (len(waving_clip), network.features)
    slow = make_body_sequence(waving_clip, network, Augmentation(), np.random.default_rng(0))
    np.testing.assert_allclose(sequence.features, slow.features, atol=1e-4)


def test_augmentations(waving_clip: Clip, network: BodyNetwork) -> None:
    def made(augmentation: Augmentation, clip: Clip = waving_clip, seed: int = 0) -> np.ndarray:
        return make_body_sequence(clip, network, augmentation, np.random.default_rng(seed)).features

    plain = made(Augmentation())
    np.testing.assert_array_equal(made(Augmentation(mirrored=True)), made(Augmentation(), mirrored(waving_clip)))
    assert not np.allclose(plain, made(Augmentation(mirrored=True)))
    spread = Augmentation(limb_spread=0.05)
    np.testing.assert_array_equal(made(spread), made(spread))
    assert not np.allclose(made(spread), made(spread, seed=1))
    lost = make_body_sequence(waving_clip, network, Augmentation(hand_dropouts_per_minute=60), np.random.default_rng(0))
    seen = make_body_sequence(waving_clip, network, Augmentation(), np.random.default_rng(0))
    assert lost.visible.sum() < seen.visible.sum() and not (lost.visible & ~seen.visible).any()
