"""Files of every rig are read without options, to the millimetre; spoilt ones are righted and said, or refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rig_files import Layout, held_still, mapped, motion, read_plainly, write
from rig_layouts import LAYOUTS

from bodysense.body.pose import forward_kinematics
from bodysense.data.clip import Clip
from bodysense.data.rigged import Rigged, read_rigged

NEEDED = ["pelvis", "head"] + [
    f"{side}_{part}" for side in ("left", "right") for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
]


def of(text: str, name: str = "take.bvh", **options) -> Rigged:
    from bodysense.io.rigs.options import ReadingOptions

    return read_rigged(text.encode(), Path(name), ReadingOptions(**options))


def worst(rigged: Rigged, clip: Clip, layout: Layout) -> float:
    """Largest distance, m, between points that stand in the rig and the same in the motion that was written."""
    points = [name for name in mapped(layout) if name in rigged.rig.joints]
    assert set(NEEDED) - set(layout.lacks) <= set(points)
    ours = clip.pose.skeleton.indices(points)
    found = forward_kinematics(rigged.clip.pose)[0][:, ours]
    return float(np.linalg.norm(found - forward_kinematics(clip.pose)[0][:, ours], axis=-1).max())


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_rig_is_read_without_options(name: str) -> None:
    layout = LAYOUTS[name]
    clip = held_still(motion(), layout)
    text = write(layout, clip)
    rigged = of(text, **({} if layout.told_unit else {"unit": str(layout.unit)}))
    rig = rigged.rig
    expected = {ours: given for ours, given in mapped(layout).items() if ours in rig.joints}
    plain = read_plainly(text)
    there = {ours: rig.to_world(plain[given]) for ours, given in expected.items() if given in plain}
    position = forward_kinematics(rigged.clip.pose)[0]
    for ours, place in there.items():  # an independent reader finds our joints where we do
        error = np.linalg.norm(position[:, rigged.clip.pose.skeleton.index(ours)] - place, axis=-1).max()
        assert error < 1e-3, (ours, rig.joints[ours], error)
    assert worst(rigged, clip, layout) < 1e-3, rig.line()
    assert rig.up == layout.up and rig.unit == pytest.approx(layout.unit)
    assert rig.lift == 0
    assert rig.confidence > 0.4, rig.line()
