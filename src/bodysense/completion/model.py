"""The packaged completion network: one step of B people.

What a completion network's file names as its format.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from bodysense.completion.inputs import Frames
from bodysense.completion.network import Network, NetworkFormat
from bodysense.completion.proportions import Proportions

FORMAT = "bodysense-completion-1"


PACKAGED = "completion.onnx"


@dataclass(frozen=True, eq=False)
class Completed:
    """One frame of B whole bodies."""

    root_position: np.ndarray  # (B, 3) m
    rotation: np.ndarray  # (B, 52, 4) wxyz, parent ← joint
    points: np.ndarray  # (B, 65, 3) m, world
    confidence: np.ndarray  # (B, 65) m, expected position error
    bound: np.ndarray  # (B, 65) m, within which nine of ten errors are
    contact: np.ndarray  # (B, 4) probability


@dataclass(frozen=True, eq=False)
class CompletionModel:
    """A completion network at run time."""

    network: Network

    def start(self, people: int) -> dict[str, np.ndarray]:
        """The graph's state before the first frame, (people, …) by input."""
        return self.network.start(people)

    def step(
        self,
        frame: Frames,
        interval: np.ndarray,
        proportions: Proportions,
        floor: float,
        hold_feet: bool,
        state: Mapping[str, np.ndarray],
    ) -> tuple[Completed, dict[str, np.ndarray]]:
        """Complete one frame of B people, `interval` (B,) s after the one before."""
        count = len(interval)
        inputs = {
            "position": frame.position,
            "rotation": frame.rotation,
            "has_position": frame.has_position,
            "has_rotation": frame.has_rotation,
            "accuracy": frame.accuracy,
            "interval": interval.astype(np.float32),
            "rest_offset": proportions.rest_offset.astype(np.float32),
            "certainty": proportions.deviation.astype(np.float32),
            "floor": np.full(count, floor, dtype=np.float32),
            "hold": np.full(count, hold_feet, dtype=np.float32),
            "acceleration": frame.acceleration,
            "has_acceleration": frame.has_acceleration,
        }
        outputs, after = self.network.step(inputs, state)
        return (
            Completed(
                outputs["root_position"],
                outputs["local_rotation"],
                outputs["points"],
                outputs["confidence"],
                outputs["bound"],
                outputs["contact"],
            ),
            after,
        )


NETWORK = NetworkFormat(
    name=FORMAT,
    kind="completion network",
    command="bodysense train completion",
    fields=("points", "joints", "state"),
    packaged=PACKAGED,
)


def load_completion(path: str | Path) -> CompletionModel:
    """Open a completion network's file. Raises BodysenseError where it is none."""
    return CompletionModel(Network.open(path, NETWORK))


@lru_cache(maxsize=1)
def packaged_model() -> CompletionModel:
    """The network that comes with the package, loaded once."""
    return CompletionModel(Network.open(None, NETWORK))
