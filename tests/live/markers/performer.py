"""Input of the twins of marker servers: a person in a marker set with two gloves, at any time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from virtual_markers import PLUG_IN_GAIT, marker_positions

from bodysense.body.pose import forward_kinematics
from bodysense.demo import performance_of_unseen_body
from bodysense.devices.simulated.glove import observe
from bodysense.io.clip import Clip
from bodysense.io.resample import resample

SUBJECT, RATE = "Anna", 100.0  # Hz
BODIES = ("Hips", "Prop")  # rigid bodies: one on the pelvis, one that lies in the room


@dataclass(frozen=True)
class Captured:
    """A capture of T frames in our world (m, +Y up). It is played forward, then back, and so on."""

    clip: Clip
    labels: tuple[str, ...]  # M
    position: np.ndarray  # (T, M, 3)
    body_position: np.ndarray  # (T, 2, 3) of `BODIES`
    body_rotation: np.ndarray  # (T, 2, 4) wxyz
    rate: float  # Hz

    def index(self, frame: int) -> int:
        """Return the frame of the capture that is played as a server's frame."""
        count = len(self.position)
        at = frame % (2 * count - 2)
        return at if at < count else 2 * count - 2 - at


@cache
def captured(gloves: bool = True, body: bool = True) -> Captured:
    """Return a performance in the markers of Plug-in Gait and of two gloves."""
    clip = resample(performance_of_unseen_body(), RATE)
    places = marker_positions(clip.pose, PLUG_IN_GAIT) if body else {}
    if gloves:
        hands = observe(clip.pose, clip.time)
        places |= dict(zip(hands.points, np.moveaxis(hands.position, 1, 0), strict=True))
    position, rotation = (np.asarray(values) for values in forward_kinematics(clip.pose))
    pelvis = clip.pose.skeleton.index("pelvis")
    prop = np.broadcast_to([1.5, 0.5, 0.0], (len(clip), 3)), np.broadcast_to([1.0, 0, 0, 0], (len(clip), 4))
    return Captured(
        clip,
        tuple(places),
        np.stack(list(places.values()), axis=1),
        np.stack([position[:, pelvis], prop[0]], axis=1),
        np.stack([rotation[:, pelvis], prop[1]], axis=1),
        RATE,
    )
