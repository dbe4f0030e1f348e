"""A network and motion small enough to train on in a test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from bodysense.body.skeleton import default_skeleton
from bodysense.io.clip import Clip
from bodysense_lab.papers.unoc.network.network import BodyNetwork, BodyNetworkConfig
from bodysense_lab.papers.unoc.sequences.body_sequences import Augmentation, BodySequence, make_body_sequence

# Without layers of the fingers' own and their dropout, so that few steps suffice.
SMALL = BodyNetworkConfig(hidden=16, branch=(16,), finger_branch=None, judge_branch=(16,))


@pytest.fixture
def network() -> BodyNetwork:
    torch.manual_seed(3)
    return BodyNetwork(SMALL, default_skeleton())


@pytest.fixture(scope="session")
def few_sequences(waving_clip: Clip) -> list[BodySequence]:
    """The waving clip plain, mirrored, and without fingers."""
    rng, network = np.random.default_rng(0), BodyNetwork(SMALL, default_skeleton())
    bare = replace(waving_clip, name="bare", has_fingers=False)
    return [
        make_body_sequence(waving_clip, network, Augmentation(), rng),
        make_body_sequence(waving_clip, network, Augmentation(mirrored=True), rng),
        make_body_sequence(bare, network, Augmentation(limb_spread=0.05, hand_dropouts_per_minute=20), rng),
    ]
