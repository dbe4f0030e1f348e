"""No jump if a marker is hidden or found again (two-hands, section 3.2.2, Figure 8): a wrapper of any filler.

A hidden marker keeps its offset from the filler's prediction; half of it fades in `FADING` s. The paper keeps all of
it (`fading=None`). On hands like the network's training hands an offset that fades in 1 s is slightly better, on all
others it is far worse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from bodysense.devices.gloves.fillers import MARKER_COUNT, Filler, any_of, missing
from bodysense.errors import BodysenseError

FADING = 8.0  # s, half-life of an offset


class ContinuousState(NamedTuple):
    """Last measured and output markers, and the offsets of output markers from the filler's or the cameras'.

    Offsets turn with the hand.
    """

    filler: Any
    measured: np.ndarray  # (H, 9, 3) m, NaN where it was missing
    shown: np.ndarray  # (H, 9, 3) m
    known: np.ndarray  # (H, 9) bool
    never: np.ndarray | None  # (H,) bool, hands that were never seen; None: all were seen
    offset: np.ndarray  # (H, 9, 3) m
    closing: np.ndarray | None  # (H, 9, 1) m/s: speed at which the offsets of known markers shrink; None: no offsets
    away: bool  # whether any offset is not 0


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
        _check_fading(self.fading)

    def start(self, hands: int) -> ContinuousState:
        """Return the initial state without any output."""
        shape = (hands, MARKER_COUNT, 3)
        nothing, none = np.full(shape, np.nan), np.zeros(shape[:2], dtype=bool)
        never = np.ones(hands, dtype=bool)
        return ContinuousState(self.filler.start(hands), nothing, nothing, none, never, np.zeros(shape), None, False)

    def fill(self, markers: np.ndarray, interval: float, state: ContinuousState) -> tuple[np.ndarray, ContinuousState]:
        """See `Filler`."""
        known = ~missing(markers)
        shown, filler = self.filler.fill(markers, interval, state.filler)
        offset, closing, away = state.offset, state.closing, state.away
        if known.tobytes() != state.known.tobytes():
            offset, closing = self._changed(markers, known, shown, filler, interval, state)
        elif away:
            offset, closing = self._shrunk(known, interval, state)
        if offset is not state.offset:
            away = bool(offset.any())
        if away:
            shown = shown + _turned(self.filler.axes(markers, filler), offset)
        never = state.never
        if never is not None:
            never = never & ~known.any(axis=1)
            never = never if never.any() else None
        return shown, ContinuousState(filler, markers, shown, known, never, offset, closing, away)

    def _shrunk(
        self, known: np.ndarray, interval: float, state: ContinuousState
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return offsets (H, 9, 3) m and closing speeds (H, 9, 1) m/s while the known markers are unchanged."""
        offset, closing = state.offset, state.closing
        if self.fading is not None:
            kept = np.where(known, 1.0, 0.5 ** (interval / self.fading))[..., None]
            if abs(offset).max() > 0.8 * self.speed * self.fading:  # rare: few markers turned the hand wrongly
                kept = np.maximum(kept, 1 - self.speed * interval / np.maximum(_length(offset), 1e-12))
            offset = offset * kept
        if closing is not None:
            length = _length(offset)
            offset = offset * np.maximum(1 - closing * interval / np.maximum(length, 1e-12), 0.0)
            closing = closing if (offset.any(axis=-1) & known).any() else None
        return offset, closing

    def _changed(
        self,
        markers: np.ndarray,
        known: np.ndarray,
        filled: np.ndarray,
        filler: Any,
        interval: float,
        state: ContinuousState,
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Return offsets (H, 9, 3) m and closing speeds (H, 9, 1) m/s after a change of the known markers."""
        # The frame before, from markers known in both: the filler's error.
        common = (known & state.known)[..., None]
        before, was = self.filler.fill(np.where(common, state.measured, np.nan), 0.0, state.filler)
        axes = self.filler.axes(before, was)
        offset = _turned_back(axes, state.shown - before)
        # This frame from the same markers: the output if no marker had come back.
        fewer = np.where(common, markers, np.nan)
        expected, now = self.filler.fill(fewer, interval, state.filler)
        expected = expected + _turned(self.filler.axes(fewer, now), offset)
        offset = _turned_back(self.filler.axes(markers, filler), expected - filled)
        fresh = np.isnan(offset) if state.never is None else np.isnan(offset) | state.never[:, None, None]
        offset = np.where(fresh, 0.0, offset)
        length = _length(offset)
        closing = np.maximum(self.speed, length / self.longest)
        if state.closing is not None:  # offsets that already shrink keep their speed
            closing = np.where((known & state.known)[..., None], state.closing, closing)
        closing = closing * known[..., None]
        return offset, closing if (closing * length).any() else None

    def axes(self, markers: np.ndarray, state: ContinuousState) -> np.ndarray | None:
        """Return the filler's axes."""
        return self.filler.axes(markers, state.filler)


def _length(vector: np.ndarray) -> np.ndarray:
    """(..., 3) → (..., 1)."""
    return np.sqrt((vector * vector).sum(axis=-1, keepdims=True))


class RememberedState(NamedTuple):
    """Last measured and filled markers, and the offsets of hidden ones from the filler's."""

    filler: Any
    measured: np.ndarray  # (H, 9, 3) m, NaN where it was missing
    filled: np.ndarray  # (H, 9, 3) m
    known: np.ndarray  # (H, 9) bool
    offset: np.ndarray | None  # (H, 9, 3) m, in axes that turn with the hand; None: 0


@dataclass(frozen=True)
class Remembered:
    """A filler that remembers its errors: nothing jumps if markers are hidden.

    Hidden markers keep their offsets from the filler's prediction; these halve in `fading` s (None: constant). Markers
    that are found again are output where they are found. Their effect on other markers is kept, except if it undoes an
    offset.
    """

    filler: Filler
    fading: float | None = FADING

    def __post_init__(self) -> None:
        _check_fading(self.fading)

    def start(self, hands: int) -> RememberedState:
        """Return the initial state without any output."""
        nothing = np.full((hands, MARKER_COUNT, 3), np.nan)
        return RememberedState(self.filler.start(hands), nothing, nothing, ~missing(nothing), None)

    def fill(self, markers: np.ndarray, interval: float, state: RememberedState) -> tuple[np.ndarray, RememberedState]:
        """See `Filler`."""
        known, offset = ~missing(markers), state.offset
        filled, filler = self.filler.fill(markers, interval, state.filler)
        if offset is not None and self.fading is not None:
            offset = offset * 0.5 ** (interval / self.fading)
        if known.tobytes() != state.known.tobytes():
            offset = self._changed(markers, known, filled, filler, interval, state._replace(offset=offset))
        if offset is not None:
            filled = filled + _turned(self.filler.axes(markers, filler), offset)
        return filled, RememberedState(filler, markers, filled, known, offset)

    def _changed(
        self,
        markers: np.ndarray,
        known: np.ndarray,
        filled: np.ndarray,
        filler: Any,
        interval: float,
        state: RememberedState,
    ) -> np.ndarray | None:
        """Return offsets (H, 9, 3) m if known markers differ from the frame before."""
        offset = np.zeros(markers.shape) if state.offset is None else state.offset
        common = (known & state.known)[..., None]
        if any_of(lost := state.known & ~known):
            before, was = self.filler.fill(np.where(common, state.measured, np.nan), 0.0, state.filler)
            kept = _turned_back(self.filler.axes(before, was), state.filled - before)
            offset = np.where(np.any(lost, axis=1, keepdims=True)[..., None], kept, offset)
        if offset.any() and any_of(known & ~state.known):
            fewer = np.where(common, markers, np.nan)
            there, now = self.filler.fill(fewer, interval, state.filler)
            there = there + _turned(self.filler.axes(fewer, now), offset)
            kept = _turned_back(self.filler.axes(markers, filler), there - filled)
            shorter = (kept * kept).sum(axis=-1) < (offset * offset).sum(axis=-1)
            offset = np.where(shorter[..., None], kept, offset)
        offset = np.where(known[..., None] | np.isnan(offset), 0.0, offset)
        return offset if offset.any() else None

    def axes(self, markers: np.ndarray, state: RememberedState) -> np.ndarray | None:
        """Return the filler's axes."""
        return self.filler.axes(markers, state.filler)


def _check_fading(fading: float | None) -> None:
    if fading is not None and not fading > 0:
        raise BodysenseError(f"continuity: fading is {fading:g}; it must be positive, or None")


def _turned(axes: np.ndarray | None, vectors: np.ndarray) -> np.ndarray:
    """Rotate vectors (H, 9, 3) from the hand's axes to the world's."""
    return vectors if axes is None else vectors @ axes.swapaxes(1, 2)


def _turned_back(axes: np.ndarray | None, vectors: np.ndarray) -> np.ndarray:
    return vectors if axes is None else vectors @ axes
