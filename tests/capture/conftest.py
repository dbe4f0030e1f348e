"""Gloves on a moving body."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.data.clip import Clip
from bodysense.observation import Observation
from bodysense.occlusion.dropout import hide
from bodysense.occlusion.glove import observe


@pytest.fixture(scope="session")
def gloves(waving_clip: Clip) -> Observation:
    """Both gloves of somebody who waves, every marker seen."""
    return observe(waving_clip.pose, waving_clip.time)


@pytest.fixture(scope="session")
def hidden_gloves(gloves: Observation) -> Observation:
    """The same with a fifth of the markers hidden at random, and one frame with none."""
    hidden = np.random.default_rng(0).random(gloves.has_position.shape) < 0.2
    hidden[7] = True
    return hide(gloves, hidden)
