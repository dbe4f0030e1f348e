"""A network and motion small enough to train on in a test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from bodysense.body.skeleton import default_skeleton
from bodysense.data.clip import Clip
from bodysense.models.body_gru import BodyGru, BodyGruConfig
from bodysense.training.episodes import Episode, Variation, make_episode


@pytest.fixture
def network() -> BodyGru:
    torch.manual_seed(3)
    return BodyGru(BodyGruConfig(hidden=16, branch=(16,)), default_skeleton())


@pytest.fixture(scope="session")
def few_episodes(waving_clip: Clip) -> list[Episode]:
    """The waving clip as it is, mirrored, and without fingers."""
    rng, network = np.random.default_rng(0), BodyGru(BodyGruConfig(hidden=16, branch=(16,)), default_skeleton())
    bare = replace(waving_clip, name="bare", has_fingers=False)
    return [
        make_episode(waving_clip, network, Variation(), rng),
        make_episode(waving_clip, network, Variation(mirrored=True), rng),
        make_episode(bare, network, Variation(limb_spread=0.05, hand_dropouts_per_minute=20), rng),
    ]
