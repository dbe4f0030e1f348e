"""Fixtures of the tests of takes."""

from __future__ import annotations

import pytest

from bodysense.body.pose import Pose
from bodysense.io.clip import Clip


@pytest.fixture(scope="package")
def pose(waving_clip: Clip) -> Pose:
    """Return three seconds of standing, swaying and waving."""
    return waving_clip.pose
