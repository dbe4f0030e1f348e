"""Networks that were never trained: what holds of every network holds of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bodysense.completion.model import CompletionModel, load_completion
from bodysense.estimators.gloves.hands import GloveModels


class Untrained:
    """A network with weights by chance."""

    def __init__(self, outputs: int, scale: float) -> None:
        rng = np.random.default_rng(outputs)
        self.first, self.second = rng.normal(size=(47, 16)), scale * rng.normal(size=(16, outputs))

    def run(self, markers: np.ndarray, hand: np.ndarray) -> np.ndarray:
        hidden = np.maximum(np.concatenate([markers, hand], axis=1) @ self.first, 0.0)
        return (hidden @ self.second).astype(np.float32)


@pytest.fixture(scope="session")
def small_gloves() -> GloveModels:
    return GloveModels(Untrained(27, 0.1), Untrained(26, 0.3))


@pytest.fixture(scope="session")
def small_completion(tmp_path_factory: pytest.TempPathFactory) -> CompletionModel:
    import torch

    from bodysense.lab.completion.export import write_completion
    from bodysense.lab.completion.fingers import FingerConfig, FingerNetwork
    from bodysense.lab.completion.graph import CompletionStep
    from bodysense.lab.completion.network import CompletionConfig, CompletionNetwork

    torch.manual_seed(0)
    body = CompletionNetwork(CompletionConfig(hidden=16, layers=1, branch=16, judge_branch=16))
    step = CompletionStep(body, FingerNetwork(FingerConfig(hidden=8, branch=8)), torch.ones(65))
    path = Path(tmp_path_factory.mktemp("network")) / "completion.onnx"
    write_completion(step, path, {"licence": "Apache-2.0"})
    return load_completion(path)
