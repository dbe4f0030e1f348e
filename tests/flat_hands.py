"""A network that takes every hand for flat, and its filler, to test how offsets of markers go on."""

from __future__ import annotations

from typing import Any

import numpy as np

from bodysense.body.glove import default_glove, template
from bodysense.body.hand import hand_skeleton
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.devices.gloves.fillers import FADING, Filler, LastShape, NetworkFiller, Stack

INTERVAL = 1 / 60
FLAT = template(default_glove(), hand_skeleton(default_skeleton(), "left"))


class Flat:
    """A network that takes every hand for flat: as wrong as can be, and jumpy where the registration is."""

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        return np.tile(FLAT.reshape(-1), (len(markers), 1)).astype(np.float32)


def flat_filler(hand: Skeleton, fading: float | None = FADING) -> Filler:
    return Stack((NetworkFiller(Flat(), (hand,), fading=fading), LastShape(FLAT)))


def run(filler: Filler, frames: np.ndarray) -> np.ndarray:
    state: Any = filler.start(frames.shape[1])
    filled = []
    for frame in frames:
        one, state = filler.fill(frame, INTERVAL, state)
        filled.append(one)
    return np.stack(filled)
