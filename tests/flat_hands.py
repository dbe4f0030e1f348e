"""A network that takes every hand for flat, and its filler, to test how offsets of markers go on."""

from __future__ import annotations

from typing import Any

import numpy as np

from bodysense.body.glove import default_glove, template
from bodysense.body.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.gloves.gap_fillers import FADING, GapFiller, GapFillerStack, NetworkGapFiller, RigidGapFiller

INTERVAL = 1 / 60
FLAT = template(default_glove(), hand_skeleton(default_skeleton(), "left"))


class Flat:
    """A network that takes every hand for flat: as wrong as can be, and jumpy where the registration is."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.tile(FLAT.reshape(-1), (len(markers), 1)).astype(np.float32)


def flat_gap_filler(hand: Skeleton, fading: float | None = FADING) -> GapFiller:
    return GapFillerStack((NetworkGapFiller(Flat(), (hand,), fading=fading), RigidGapFiller(FLAT)))


def run(filler: GapFiller, frames: np.ndarray) -> np.ndarray:
    state: Any = filler.start(frames.shape[1])
    shown = []
    for frame in frames:
        one, state = filler.fill(frame, INTERVAL, state)
        shown.append(one)
    return np.stack(shown)
