"""Motion of named channels as a sum of smooth moves, each from a begin to an end time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from bodysense.geometry.rotation import smooth_step

_SHORTEST = 1e-3  # s, duration of a move that sets a channel whose value has no effect at that time


@dataclass(frozen=True)
class Draw:
    """Random choices of a script. A margin leaves out both ends of every range, so that data sets can differ."""

    rng: np.random.Generator
    margin: float = 0.0  # share of a range that is left out at each end, 0 to 0.5

    def between(self, low: float, high: float) -> float:
        """Draw a number between `low` and `high`, uniformly, without the margins."""
        return low + (high - low) * float(self.rng.uniform(self.margin, 1 - self.margin))

    def chance(self, share: float) -> bool:
        """Return True in a `share` of draws."""
        return bool(self.rng.uniform() < share)

    def side(self) -> int:
        """Draw 0, the left side, or 1, the right side."""
        return int(self.rng.integers(2))


@dataclass(eq=False)
class Moves:
    """Additive moves of channels. A channel is its start plus the sum of its moves, each eased with minimum jerk."""

    value: dict[str, float]  # value of each channel after all moves so far
    _start: dict[str, float] = field(init=False)
    _eases: list[tuple[float, float, str, float]] = field(init=False, default_factory=list)
    _brisk: list[tuple[float, float, str, float]] = field(init=False, default_factory=list)
    _bumps: list[tuple[float, float, str, float]] = field(init=False, default_factory=list)

    def __post_init__(self) -> None:
        self._start = dict(self.value)

    def to(self, begin: float, end: float, **values: float) -> None:
        """Move channels to values within `begin` to `end`, s."""
        for name, value in values.items():
            self.add(begin, end, **{name: value - self.value[name]})

    def add(self, begin: float, end: float, **differences: float) -> None:
        """Move channels by differences within `begin` to `end`, s."""
        for name, difference in differences.items():
            if difference != 0.0:
                self._eases.append((begin, max(end, begin + _SHORTEST), name, difference))
                self.value[name] += difference

    def swing(self, begin: float, end: float, **values: float) -> None:
        """Move channels to values within `begin` to `end`, s, with less time for the start and the end."""
        for name, value in values.items():
            self._brisk.append((begin, end, name, value - self.value[name]))
            self.value[name] = value

    def pulse(self, begin: float, risen: float, falls: float, end: float, **differences: float) -> None:
        """Move channels by differences within `begin` to `risen`, and back within `falls` to `end`, s."""
        self.add(begin, risen, **differences)
        self.add(falls, end, **{name: -difference for name, difference in differences.items()})

    def bump(self, begin: float, end: float, **heights: float) -> None:
        """Move channels by heights and back within `begin` to `end`, s."""
        self._bumps += [(begin, end, name, height) for name, height in heights.items()]

    def at(self, time: np.ndarray) -> dict[str, np.ndarray]:
        """Return the channels (T,) at times (T,), s."""
        names = list(self.value)
        values = np.tile([self._start[name] for name in names], (len(time), 1))
        for rows, shape in ((self._eases, ease), (self._brisk, smooth_step), (self._bumps, _bump)):
            if rows:
                begin, end, difference = (np.array([row[k] for row in rows]) for k in (0, 1, 3))
                active = begin < time[-1]
                spread = np.zeros((len(rows), len(names)))
                spread[np.arange(len(rows)), [names.index(row[2]) for row in rows]] = difference
                share = np.clip((time[:, None] - begin[active]) / (end - begin)[active], 0.0, 1.0)
                values += shape(share) @ spread[active]
        return {name: values[:, k] for k, name in enumerate(names)}


def ease(share: np.ndarray) -> np.ndarray:
    """Return the minimum-jerk path from 0 at `share` ≤ 0 to 1 at `share` ≥ 1. Flash and Hogan 1985."""
    s = np.clip(share, 0.0, 1.0)
    return s * s * s * (10 + s * (6 * s - 15))


def _bump(share: np.ndarray) -> np.ndarray:
    return 64 * (share * (1 - share)) ** 3


def waves(time: np.ndarray, count: int, slowest: float, fastest: float, rng: np.random.Generator) -> np.ndarray:
    """Return smooth noise (T, count) of standard deviation 1 from five sines between two frequencies, Hz."""
    frequency = np.exp(rng.uniform(np.log(slowest), np.log(fastest), (5, count)))
    amplitude = np.sqrt(slowest / frequency)
    amplitude *= np.sqrt(2.0 / (amplitude**2).sum(axis=0))
    phase = rng.uniform(0, 2 * np.pi, (5, count))
    return (amplitude * np.sin(2 * np.pi * frequency * time[:, None, None] + phase)).sum(axis=1)
