"""People who lie, crawl or stand on their hands in a BVH file stay so, and mirrored files are noticed, on every rig."""

from __future__ import annotations

from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from further_layouts import FURTHER
from more_layouts import MORE
from people.made import LYING, lying_clip
from rig_files import held_still, mapped, motion, write
from rig_layouts import LAYOUTS

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.io.reading_options import ReadingOptions
from bodysense.io.rigged import Rigged, read_rigged

EVERY = LAYOUTS | MORE | FURTHER
STANDING = [
    name
    for name, layout in EVERY.items()
    if layout.rest in ("T", "A") and layout.up == "y" and not layout.has_positions
]


def of(text: str, **options: Any) -> Rigged:
    return read_rigged(text.encode(), Path("take.bvh"), ReadingOptions(**options))


@pytest.mark.parametrize(("name", "how"), list(zip(STANDING[::2], cycle(LYING), strict=False)))
def test_a_lying_body_stays(name: str, how: str) -> None:
    layout = EVERY[name]
    clip = held_still(lying_clip(how), layout)
    options: dict[str, Any] = {} if layout.has_known_unit else {"unit": str(layout.unit)}
    text = write(layout, clip)
    rigged = read_rigged(text.encode(), Path("take.bvh"), ReadingOptions(**options))
    points = [point for point in mapped(layout) if point in rigged.rig.joints and point in BODY]
    ours = clip.pose.skeleton.indices(points)
    found, there = (np.asarray(forward_kinematics(one.pose)[0])[:, ours] for one in (rigged.clip, clip))
    lift = float((found - there)[..., 1].mean())  # a rig without hands or toes does not tell the floor closely
    assert abs(lift) < 0.15 and rigged.rig.up == "y", rigged.rig.line()
    assert np.abs(found - there - [0.0, lift, 0.0]).max() < 1e-3
    assert rigged.clip.warnings, "it is said that the body lies"


@pytest.mark.parametrize("name", ["Mixamo", "cgspeed", "Vicon Blade"])
def test_a_mirrored_file_is_told_and_mended(name: str) -> None:
    layout = EVERY.get(name, EVERY["Mixamo"])
    clip = held_still(motion(80, 6), layout)
    right = of(write(layout, clip))
    assert not any("mirror" in line for line in right.clip.warnings)
    lines = []
    head, _, rows = write(layout, clip).partition("Frame Time:")
    for line in head.splitlines():  # numbers of a left-handed program, unchanged
        words = line.split()
        lines.append(f"OFFSET {-float(words[1])} {words[2]} {words[3]}" if words[:1] == ["OFFSET"] else line)
    channels = [word for line in lines if "CHANNELS" in line for word in line.split()[2:]]
    signs = [-1.0 if word in ("Xposition", "Yrotation", "Zrotation") else 1.0 for word in channels]
    first, *numbers = rows.strip().splitlines()
    flipped = [
        " ".join(f"{sign * float(x):.7f}" for sign, x in zip(signs, row.split(), strict=True)) for row in numbers
    ]
    text = "\n".join([*lines, f"Frame Time: {first}", *flipped]) + "\n"
    assert any("--left-handed" in line for line in of(text).clip.warnings)
    mended = of(text, left_handed=True)
    assert not mended.clip.warnings
    found, there = (np.asarray(forward_kinematics(one.clip.pose)[0]) for one in (mended, right))
    np.testing.assert_allclose(found, there, atol=1e-4)
