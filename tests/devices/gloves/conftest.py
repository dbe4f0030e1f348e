"""A moving hand, its markers as observations, and untrained networks."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bodysense.body.hands.glove import default_glove, glove_points, marker_positions, side_of
from bodysense.body.hands.hand import mirrored_vectors
from bodysense.body.skeleton import Skeleton
from bodysense.devices.gloves.hands import GloveModels
from bodysense.observing.checks import check_observation
from bodysense.observing.observation import Observation, accuracy_like
from bodysense_lab.synthesis.hands import synthesize_hand
from bodysense_lab.synthesis.motion import HandMotion

MakeGloves = Callable[..., Observation]


@pytest.fixture(scope="session")
def motion(hand: Skeleton) -> HandMotion:
    """Motion of a hand, ten seconds at 60 Hz."""
    return synthesize_hand(hand, 10.0, np.random.default_rng(5))


@pytest.fixture(scope="session")
def markers(motion: HandMotion) -> np.ndarray:
    """Markers (T, 9, 3) m of the motion."""
    return np.asarray(marker_positions(default_glove(), motion.pose))


@pytest.fixture(scope="session")
def observe_gloves() -> MakeGloves:
    """Function that returns an observation of markers (T, 9, 3) of hands as left ones; NaN where hidden."""

    def make(rate: float = 60.0, **hands: np.ndarray) -> Observation:
        position = np.concatenate([mirrored_vectors(rows, side_of(name)) for name, rows in hands.items()], axis=1)
        seen = ~np.isnan(position[..., 0])
        points = tuple(point for name in hands for point in glove_points(name))
        nothing = np.full((*position.shape[:2], 4), np.nan)
        time = np.arange(len(position)) / rate
        accuracy = accuracy_like(seen, 0.001)
        return check_observation(Observation(points, position, nothing, seen, np.zeros_like(seen), accuracy, time))

    return make


class Untrained:
    """A network with random weights. Hands are multiplied one by one, so that rounding is the same in every batch."""

    def __init__(self, outputs: int, scale: float) -> None:
        rng = np.random.default_rng(outputs)
        self.first, self.second = rng.normal(size=(114, 16)), scale * rng.normal(size=(16, outputs))

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        hands = np.concatenate([markers, hand], axis=1)
        return np.stack([np.maximum(one @ self.first, 0.0) @ self.second for one in hands]).astype(np.float32)


@pytest.fixture(scope="session")
def small_models() -> GloveModels:
    """Untrained networks, for properties that hold for every network."""
    return GloveModels(Untrained(27, 0.1), Untrained(26, 0.3))
