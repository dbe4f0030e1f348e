"""Frames of gloves that a gap filler fills in order."""

from __future__ import annotations

from typing import Any

import numpy as np

from bodysense.devices.gloves.gap_fillers import GapFiller


def filled_frames(gap_filler: GapFiller, frames: np.ndarray, interval: float = 1 / 60) -> np.ndarray:
    """Fill frames (T, H, 9, 3), `interval` seconds apart."""
    state: Any = gap_filler.start(frames.shape[1])
    filled = []
    for frame in frames:
        one, state = gap_filler.fill(frame, interval, state)
        filled.append(one)
    return np.stack(filled)
