"""Results of point estimators. The tracker's `Estimate` is in `bodysense.tracking.estimate`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton


@dataclass(frozen=True, eq=False)
class PointEstimate:
    """Positions of all points of a body, for every frame of an observation."""

    skeleton: Skeleton
    position: np.ndarray  # (..., T, P, 3) m, world, of every point of the skeleton, before inverse kinematics
    occluded: np.ndarray  # (..., T, P) probability that the point was hidden
    confidence: np.ndarray  # (..., T, P) m, expected error of the position
    pose: Pose | None = None  # rotations if the method gives them; None: inverse kinematics must find them
