"""Where the middle is, and how high somebody who sits is raised: placements from what a headset says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bodysense.body.products import rotate
from bodysense.observation import Observation
from bodysense.serve.webxr import Placement


def recentred(placement: Placement, raw: Observation) -> Placement:
    """The placement in which the head of a frame, in the signal's world, is in the middle and faces +Z."""
    head = raw.points.index("head")
    ahead = rotate(raw.rotation[0, [head]], np.array([[0.0, 0, 1]]))[0]
    turned = raw.has_rotation[0, head] and math.hypot(ahead[0], ahead[2]) > 0.1
    heading = -math.atan2(ahead[0], ahead[2]) if turned else 0.0
    moved = Placement(heading).place(raw.position[:, head])[0]
    return Placement(heading, (-float(moved[0]), placement.offset[1], -float(moved[2])))


def raised(placement: Placement, raw: Observation, standing: float | None) -> Placement:
    """The placement in which the head of a frame is as high as standing, m; as high as it is where that is None."""
    up = 0.0 if standing is None else standing - float(raw.position[0, raw.points.index("head"), 1])
    x, _, z = placement.offset
    return replace(placement, offset=(x, up, z))
