"""Stick figures of reports."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bodysense.geometry.rotation import quaternion_exp, quaternion_rotate
from bodysense_conform.report.figure import stick_figure
from bodysense_conform.subject import Subject


def ends(picture: ElementTree.Element) -> np.ndarray:
    """Return the ends (L, 2, 2) of a picture's lines: the floor, then bones."""
    return np.array(
        [[float(line.get(key, "nan")) for key in ("x1", "y1", "x2", "y2")] for line in picture.iter("line")]
    ).reshape(-1, 2, 2)


@settings(max_examples=5)
@given(st.integers(0, 59), st.floats(-3, 3), st.floats(-5, 5), st.floats(-5, 5), st.floats(-2, 2))
def test_a_body_stands_on_the_floor_of_its_picture_wherever_it_is(
    clean: Subject, frame: int, heading: float, x: float, z: float, lift: float
) -> None:
    """Heights are those of the body, and its place and heading in the world do not change the picture."""
    place = quaternion_rotate(quaternion_exp(np.array([0.0, heading, 0.0])), clean.position) + np.array([x, lift, z])
    moved = replace(clean, position=place, floor=clean.ground + lift)
    picture = ElementTree.fromstring(stick_figure(moved, frame))
    lines, still = (ends(one) for one in (picture, ElementTree.fromstring(stick_figure(clean, frame))))
    np.testing.assert_allclose(lines, still, atol=2e-3)
    heights = clean.position[frame, [[clean.points.index(name) for name in bone] for bone in clean.bones], 1]
    np.testing.assert_allclose(lines[0, :, 1] - lines[1:, :, 1], heights - clean.ground, atol=2e-3)
    assert (lines > 0).all() and (lines < [float(size) for size in picture.get("viewBox", "").split()[2:]]).all()
