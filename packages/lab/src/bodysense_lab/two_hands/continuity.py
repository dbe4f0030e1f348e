"""The paper's way to avoid jumps if a marker is hidden or found again (two-hands, section 3.2.2, Figure 8).

A wrapper of any filler, for its tables; `bodysense` itself blends poses (`devices.gloves.settling`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bodysense.devices.gloves.continuity import FADING, check_fading, turned, turned_back
from bodysense.devices.gloves.fillers import MARKER_COUNT, Filler, missing
from bodysense.errors import BodysenseError


class ContinuousState(NamedTuple):
    """Last measured and output markers, and the offsets of output markers from the filler's or the cameras'.

    Offsets turn with the hand.
    """

    filler: Any
    measured: np.ndarray  # (H, 9, 3) m, NaN where it was missing
    shown: np.ndarray  # (H, 9, 3) m
    known: np.ndarray  # (H, 9) bool
    never: np.ndarray  # (H,) bool, hands that were never seen
    offset: np.ndarray  # (H, 9, 3) m
    closing: np.ndarray  # (H, 9, 1) m/s: speed at which the offsets of known markers shrink


@dataclass(frozen=True)
class Continuous:
    """A filler without jumps.

    A hidden marker keeps its offset from the filler's prediction; it halves in `fading` s, but no faster than `speed`
    (None: all of it, as in the paper). A marker that is found again keeps the offset to its last output, which shrinks
    at `speed` m/s, faster only if that would take more than `longest` s. An unseen hand is output where it is found.
    """

    filler: Filler
    speed: float = 0.25
    longest: float = 0.5
    fading: float | None = FADING

    def __post_init__(self) -> None:
        for name in ("speed", "longest"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"continuity: {name} is {getattr(self, name):g}; it must be positive")
        check_fading(self.fading)

    def start(self, hands: int) -> ContinuousState:
        """Return the initial state without any output."""
        shape = (hands, MARKER_COUNT, 3)
        nothing, none, still = np.full(shape, np.nan), np.zeros(shape[:2], dtype=bool), np.zeros(shape)
        never = np.ones(hands, dtype=bool)
        return ContinuousState(self.filler.start(hands), nothing, nothing, none, never, still, still[..., :1])

    def fill(self, markers: np.ndarray, interval: float, state: ContinuousState) -> tuple[np.ndarray, ContinuousState]:
        """See `Filler`."""
        known = ~missing(markers)
        shown, filler = self.filler.fill(markers, interval, state.filler)
        if (known != state.known).any():
            offset, closing = self._changed(markers, known, shown, filler, interval, state)
        else:
            offset, closing = self._shrunk(known, interval, state), state.closing
        if offset.any():
            shown = shown + turned(self.filler.axes(markers, filler), offset)
        never = state.never & ~known.any(axis=1)
        return shown, ContinuousState(filler, markers, shown, known, never, offset, closing)

    def _shrunk(self, known: np.ndarray, interval: float, state: ContinuousState) -> np.ndarray:
        """Return offsets (H, 9, 3) m while the known markers are unchanged."""
        offset = state.offset
        if self.fading is not None:
            kept = np.where(known, 1.0, 0.5 ** (interval / self.fading))[..., None]
            if abs(offset).max() > 0.8 * self.speed * self.fading:  # rare: few markers turned the hand wrongly
                kept = np.maximum(kept, 1 - self.speed * interval / np.maximum(_length(offset), 1e-12))
            offset = offset * kept
        return offset * np.maximum(1 - state.closing * interval / np.maximum(_length(offset), 1e-12), 0.0)

    def _changed(
        self,
        markers: np.ndarray,
        known: np.ndarray,
        filled: np.ndarray,
        filler: Any,
        interval: float,
        state: ContinuousState,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return offsets (H, 9, 3) m and closing speeds (H, 9, 1) m/s after a change of the known markers."""
        # The frame before, from markers known in both: the filler's error.
        common = (known & state.known)[..., None]
        before, was = self.filler.fill(np.where(common, state.measured, np.nan), 0.0, state.filler)
        axes = self.filler.axes(before, was)
        offset = turned_back(axes, state.shown - before)
        # This frame from the same markers: the output if no marker had come back.
        fewer = np.where(common, markers, np.nan)
        expected, now = self.filler.fill(fewer, interval, state.filler)
        expected = expected + turned(self.filler.axes(fewer, now), offset)
        offset = turned_back(self.filler.axes(markers, filler), expected - filled)
        offset = np.where(np.isnan(offset) | state.never[:, None, None], 0.0, offset)
        # Offsets that already shrink keep their speed.
        fresh = np.maximum(self.speed, _length(offset) / self.longest)
        return offset, np.where((known & state.known)[..., None], state.closing, fresh) * known[..., None]

    def axes(self, markers: np.ndarray, state: ContinuousState) -> np.ndarray | None:
        """Return the filler's axes."""
        return self.filler.axes(markers, state.filler)


def _length(vector: np.ndarray) -> np.ndarray:
    """(..., 3) → (..., 1)."""
    return np.sqrt((vector * vector).sum(axis=-1, keepdims=True))
