"""The paper's baselines: a hidden marker stays, moves on, or is made of the others (two-hands, section 3.2.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from bodysense.devices.gloves.fillers import MARKER_COUNT, any_of, missing


@dataclass(frozen=True)
class LastKnown:
    """A hidden marker stays where it was last known."""

    def start(self, hands: int) -> np.ndarray:
        """Nothing known: all NaN."""
        return np.full((hands, MARKER_COUNT, 3), np.nan)

    def fill(self, markers: np.ndarray, interval: float, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `Filler`."""
        filled = np.where(np.isnan(markers), state, markers)
        return filled, filled

    def axes(self, markers: np.ndarray, state: np.ndarray) -> None:
        """The world's."""


class AverageState(NamedTuple):
    """Markers as last shown, their velocity, and steps of the last moments: (interval, step, whether known)."""

    place: np.ndarray  # (H, 9, 3) m
    velocity: np.ndarray  # (H, 9, 3) m/s
    known: np.ndarray  # (H, 9) bool
    steps: tuple[tuple[float, np.ndarray, np.ndarray], ...]


@dataclass(frozen=True)
class MovingAverage:
    """A hidden marker moves on with its mean velocity over the last `seconds` in which it was known."""

    seconds: float = 1 / 3

    def start(self, hands: int) -> AverageState:
        """Nothing known."""
        shape = (hands, MARKER_COUNT, 3)
        return AverageState(np.full(shape, np.nan), np.zeros(shape), np.zeros(shape[:2], dtype=bool), ())

    def fill(self, markers: np.ndarray, interval: float, state: AverageState) -> tuple[np.ndarray, AverageState]:
        """See `Filler`."""
        known = ~missing(markers)
        filled = np.where(known[..., None], markers, state.place + interval * state.velocity)
        both = (known & state.known)[..., None]
        steps = (*state.steps, (interval, np.where(both, filled - state.place, 0.0), both))
        while len(steps) > 1 and sum(step[0] for step in steps) > self.seconds + 1e-9:
            steps = steps[1:]
        time = sum(step[0] * step[2] for step in steps)
        mean = sum(step[1] for step in steps) / np.where(time > 0, time, 1.0)
        return filled, AverageState(filled, np.where(known[..., None], mean, state.velocity), known, steps)

    def axes(self, markers: np.ndarray, state: AverageState) -> None:
        """The world's."""


class AffineState(NamedTuple):
    """The last complete frame, which markers were known in it and in the one before, and the weights in use."""

    place: np.ndarray  # (H, 9, 3) m
    known: np.ndarray  # (H, 9) bool
    before: np.ndarray  # (H, 9) bool
    weights: np.ndarray  # (H, 9, 9)


@dataclass(frozen=True)
class AffineCombination:
    """A hidden marker is the affine combination of the known ones that it was in the frame before it was hidden.

    Equations 3 to 8. Weights are those of the frame before the last change of what is known; a marker that comes back
    takes part from its second frame on. Coordinates are taken from the known markers' mean, so that nothing depends on
    the origin. Needs one known marker.
    """

    regularization: float = 1e-8  # m², λ

    def start(self, hands: int) -> AffineState:
        """Nothing known."""
        known = np.zeros((hands, MARKER_COUNT), dtype=bool)
        place = np.full((hands, MARKER_COUNT, 3), np.nan)
        return AffineState(place, known, known, np.zeros((hands, MARKER_COUNT, MARKER_COUNT)))

    def fill(self, markers: np.ndarray, interval: float, state: AffineState) -> tuple[np.ndarray, AffineState]:
        """See `Filler`."""
        hidden = missing(markers)
        known = ~hidden
        if not any_of(hidden):
            return markers, AffineState(markers, known, state.known, state.weights)
        used = known & state.known
        changed = ((known != state.known) | (state.known & ~state.before)).any(axis=1)
        weights = state.weights
        if changed.any():
            weights = np.where(changed[:, None, None], self._weights(state.place, used), weights)
        center = _mean(markers, used)
        guess = weights @ np.where(used[..., None], markers - center, 0.0) + center
        guess[~used.any(axis=1) | np.isnan(state.place[..., 0]).any(axis=1)] = np.nan
        filled = np.where(known[..., None], markers, guess)
        return filled, AffineState(filled, known, state.known, weights)

    def _weights(self, place: np.ndarray, used: np.ndarray) -> np.ndarray:
        """(H, 9, 9): what every marker is made of, 0 for those not used; equation 8 in its 4 × 4 form."""
        of = np.concatenate([np.nan_to_num(place - _mean(place, used)), np.ones_like(place[..., :1])], axis=-1)
        by = of * used[..., None]
        normal = by.swapaxes(1, 2) @ by + self.regularization * np.eye(4)
        return of @ np.linalg.solve(normal, by.swapaxes(1, 2))

    def axes(self, markers: np.ndarray, state: AffineState) -> None:
        """The world's."""


def _mean(markers: np.ndarray, used: np.ndarray) -> np.ndarray:
    """(H, 1, 3) of the markers used; 0 where none is."""
    weight = used / np.maximum(used.sum(axis=1), 1)[:, None]
    return weight[:, None] @ np.where(used[..., None], markers, 0.0)
