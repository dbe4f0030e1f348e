"""A network that predicts flat hands, and its gap filler, to test the continuity of hidden markers."""

from __future__ import annotations

from typing import Any

import numpy as np

from bodysense.body.hands.glove import default_glove, template
from bodysense.body.hands.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.gloves.gap_fillers import FADING, GapFiller, GapFillerStack, NetworkGapFiller, RigidGapFiller

INTERVAL = 1 / 60
FLAT = template(default_glove(), hand_skeleton(default_skeleton(), "left"))


class Flat:
    """A network that predicts a flat hand for all markers: it has large errors, and jumps with the registration."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.tile(FLAT.reshape(-1), (len(markers), 1)).astype(np.float32)


def flat_gap_filler(hand: Skeleton, fading: float | None = FADING) -> GapFiller:
    return GapFillerStack((NetworkGapFiller(Flat(), (hand,), fading=fading), RigidGapFiller(FLAT)))


def run(gap_filler: GapFiller, frames: np.ndarray) -> np.ndarray:
    state: Any = gap_filler.start(frames.shape[1])
    filled = []
    for frame in frames:
        one, state = gap_filler.fill(frame, INTERVAL, state)
        filled.append(one)
    return np.stack(filled)
