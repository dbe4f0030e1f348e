"""Results of point estimators; the tracker's own `Estimate` is in `estimate.py`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class PointEstimate:
    """Positions of all points of a body, for every frame of an observation."""

    skeleton: Skeleton
    position: np.ndarray  # (..., T, P, 3) m, world: every point of the skeleton, before IK
    occluded: np.ndarray  # (..., T, P) probability that the point was hidden
    confidence: np.ndarray  # (..., T, P) expected position error, m
    pose: Pose | None = None  # rotations, from methods that give them; otherwise inverse kinematics finds them
