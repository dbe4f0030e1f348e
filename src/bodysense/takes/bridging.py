"""Bridging: interpolation of points that a recording loses for a moment, before it is completed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.geometry.gaps import COASTING, interpolate, interpolate_positions, runs
from bodysense.observing.observation import Observation

Array = np.ndarray
LONGEST = 0.2  # s; longest gap that is bridged
DRIFT = 0.05  # m/s; growth of the expected error of a bridged position with the time from known frames


def bridge_gaps(observation: Observation, seconds: float, longest: float = LONGEST) -> Observation:
    """Interpolate positions and rotations over gaps between two known frames that are no longer than `longest` s.

    Args:
        observation: (T, P).
        seconds: time between frames.
        longest: longest gap, s.
    """
    most, fading = int(longest / seconds + 1e-6), COASTING / seconds
    position, rotation = observation.position.copy(), observation.rotation.copy()
    has_position, has_rotation = observation.has_position.copy(), observation.has_rotation.copy()
    accuracy = observation.accuracy.copy()
    for point in range(len(observation.points)):
        for first, end in _gaps(observation.has_position[:, point], most):
            known, at = _neighbours(observation.has_position[:, point], first, end)
            position[first:end, point] = interpolate_positions(position[known, point], at, at + end - first, fading)
            away = seconds * np.minimum(np.arange(1, end - first + 1), np.arange(end - first, 0, -1))
            beside = max(accuracy[first - 1, point], accuracy[end, point])
            accuracy[first:end, point] = beside + DRIFT * away
            has_position[first:end, point] = True
        for first, end in _gaps(observation.has_rotation[:, point], most):
            known, at = _neighbours(observation.has_rotation[:, point], first, end)
            rotation[first:end, point] = interpolate(rotation[known, point], at, at + end - first, fading)
            has_rotation[first:end, point] = True
    return replace(
        observation,
        position=position,
        rotation=rotation,
        has_position=has_position,
        has_rotation=has_rotation,
        accuracy=accuracy,
    )


def _gaps(known: Array, most: int) -> list[tuple[int, int]]:
    """Return the gaps of a mask (T,) between known frames: those of at most `most` frames."""
    found = runs(~known)
    return [(first, end) for first, end in found if first > 0 and end < len(known) and end - first <= most]


def _neighbours(known: Array, first: int, end: int) -> tuple[slice, int]:
    """Return the slice of a gap with one or two known frames on each side, and the begin of the gap in it."""
    before = 2 if first > 1 and known[first - 2] else 1
    after = 2 if end < len(known) - 1 and known[end + 1] else 1
    return slice(first - before, end + after), before
