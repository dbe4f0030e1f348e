"""The paper's continuity of markers that are found again, marker by marker (two-hands, section 3.2.2, Figure 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bodysense.devices.gloves.gap_fillers import MARKER_COUNT, GapFiller, missing


class ContinuityState(NamedTuple):
    """State of the filler, markers known in the last frame, and offsets of the output."""

    filler: Any
    known: np.ndarray  # (H, 9) bool
    offset: np.ndarray  # (H, 9, 3) m


@dataclass(frozen=True, eq=False)
class Continuity:
    """A filler whose markers do not jump when they are found again.

    The output of a found marker starts at its prediction. The offset from there to the measured marker decays linearly
    at `speed` m/s. If the marker is hidden meanwhile, its offset stays. `filler` keeps the offset of a newly hidden
    marker, as `NetworkGapFiller` with `fading=None` does. A marker without prediction is output where it is measured.
    """

    filler: GapFiller
    speed: float = 0.25

    def start(self, hands: int) -> ContinuityState:
        """Return the state without offsets."""
        known = np.ones((hands, MARKER_COUNT), dtype=bool)
        return ContinuityState(self.filler.start(hands), known, np.zeros((hands, MARKER_COUNT, 3)))

    def fill(self, markers: np.ndarray, interval: float, state: ContinuityState) -> tuple[np.ndarray, ContinuityState]:
        """See `GapFiller`."""
        known, offset = ~missing(markers), state.offset
        found = (known & ~state.known)[..., None]
        filled, filler = self.filler.fill(markers, interval, state.filler)
        if found.any():
            predicted, _ = self.filler.fill(np.where(found, np.nan, markers), interval, state.filler)
            offset = np.where(found, np.nan_to_num(predicted + offset - markers), offset)
        length = np.linalg.norm(offset, axis=-1, keepdims=True)
        shorter = np.maximum(length - self.speed * interval, 0.0) / np.maximum(length, 1e-12)
        offset = np.where(known[..., None], offset * shorter, offset)
        return filled + offset, ContinuityState(filler, known, offset)
