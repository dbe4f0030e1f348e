"""Stature from the height of a headset."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.body.skeleton import default_skeleton
from bodysense.body.stature import height_from_headset
from bodysense.errors import BodysenseError

SKELETON = default_skeleton()
HEAD = SKELETON.index("head")


@pytest.mark.parametrize("height", [1.5, 1.7, 2.0])
def test_the_height_of_a_wearer_is_that_of_their_headset(height: float) -> None:
    """Standing, with a crouch, a jump and frames without tracking among it."""
    wearer = SKELETON.scaled(height)
    rest = (wearer.path @ wearer.rest_offset)[:, 1]
    standing = rest[HEAD] - rest.min()
    rng = np.random.default_rng(0)
    heights = standing + rng.normal(scale=0.01, size=2000)
    heights[300:900] -= 0.5
    heights[1000:1020] += 0.4
    heights[::7] = np.nan
    assert height_from_headset(heights, SKELETON) == pytest.approx(height, rel=0.02)


def test_heights_that_tell_nothing() -> None:
    with pytest.raises(BodysenseError, match="the headset was tracked in no frame"):
        height_from_headset(np.full(5, np.nan), SKELETON)
    with pytest.raises(BodysenseError, match=r"0\.20 m over the floor is that of a body of 0\.22 m"):
        height_from_headset(np.full(5, 0.2), SKELETON)
