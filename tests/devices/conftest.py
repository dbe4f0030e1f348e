"""Networks that were never trained: what holds of every network holds of them."""

from __future__ import annotations

import numpy as np
import pytest

from bodysense.estimators.gloves.hands import GloveModels


class Untrained:
    """A network with weights by chance."""

    def __init__(self, outputs: int, scale: float) -> None:
        rng = np.random.default_rng(outputs)
        self.first, self.second = rng.normal(size=(114, 16)), scale * rng.normal(size=(16, outputs))

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        hidden = np.maximum(np.concatenate([markers, hand], axis=1) @ self.first, 0.0)
        return (hidden @ self.second).astype(np.float32)


@pytest.fixture(scope="session")
def small_gloves() -> GloveModels:
    return GloveModels(Untrained(27, 0.1), Untrained(26, 0.3))
