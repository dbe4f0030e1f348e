"""The wearer of the markers."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bodysense.demo import performance_of_unseen_body
from bodysense.io.clip import Clip


@pytest.fixture(scope="module")
def unseen_body() -> Clip:
    """A body of unseen proportions: 60 frames of standing, sitting and steps."""
    clip = performance_of_unseen_body()
    return replace(clip, pose=clip.pose[:: len(clip) // 60], frame_rate=10.0)
