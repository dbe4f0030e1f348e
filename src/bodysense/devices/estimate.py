"""Interface of point estimators and their results; the tracker's own `Estimate` is in `observation.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.observation import Observation


@dataclass(frozen=True, eq=False)
class PointEstimate:
    """Positions of all points of a body, for every frame of an observation."""

    skeleton: Skeleton
    position: np.ndarray  # (..., T, P, 3) m, world: every point of the skeleton, before IK
    occluded: np.ndarray  # (..., T, P) probability that the point was hidden
    confidence: np.ndarray  # (..., T, P) expected position error, m
    pose: Pose | None = None  # rotations, from methods that give them; otherwise inverse kinematics finds them


class Estimator(Protocol):
    """A method that completes a body. State is an argument, so streaming, batches and replay are the same code."""

    @property
    def skeleton(self) -> Skeleton:
        """The body that is completed."""
        ...

    def start(self) -> Any:
        """The state before the first frame."""
        ...

    def step(self, observation: Observation, state: Any) -> tuple[PointEstimate, Any]:
        """Complete the next T ≥ 1 frames: one call with T frames equals T calls with one."""
        ...
