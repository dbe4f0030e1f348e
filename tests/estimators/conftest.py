"""Observations of a few named points, written out by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest

from bodysense.observation import Observation, check_observation

Seen = Mapping[str, Sequence[float]]
MakeObservation = Callable[..., Observation]


@pytest.fixture(scope="session")
def make_observation() -> MakeObservation:
    """One dictionary a frame, point → position, and the head's rotation in each; what is not named is hidden."""

    def make(
        frames: Sequence[Seen], time: Sequence[float], turn: Sequence[Sequence[float]] | None = None
    ) -> Observation:
        points = tuple(dict.fromkeys(["head", *(name for frame in frames for name in frame)]))
        position, rotation = (
            np.full((len(frames), len(points), 3), np.nan),
            np.full((len(frames), len(points), 4), np.nan),
        )
        for t, frame in enumerate(frames):
            for name, place in frame.items():
                position[t, points.index(name)] = place
            if turn is not None:
                rotation[t, 0] = turn[t]
        seen, turned = np.isfinite(position[..., 0]), np.isfinite(rotation[..., 0])
        accuracy = np.full(seen.shape, 0.001)
        return check_observation(
            Observation(points, position, rotation, seen, turned, accuracy, np.array(time, dtype=float))
        )

    return make
