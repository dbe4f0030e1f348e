"""Bodies that are bent until their points meet targets: inverse kinematics on what an estimator says."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.ik import IkSettings, InverseKinematics
from bodysense.body.pose import Pose
from bodysense.body.products import world_rotation
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.observation import Observation, observed_points

MEASURED_ERROR = 0.002  # m: expected error of a tracked point
HEAD_WEIGHT = 0.05  # m²/rad²: pull of a measured rotation in IK
_DOUBT = 0.03  # m, expected error at which a predicted point pulls half as much in IK
_MEASURED_WEIGHT = 10.0  # pull of a tracked point in IK, relative to a certain prediction's 1
_FINGER_WEIGHT = 0.05  # factor on the pull of every point of a finger
_POSE_WEIGHT = 1e-3  # m²/rad²: pull of each rotation of the estimator
# Predictions are centimetres off: IK need not place them to hundredths of a millimetre.
COARSE = IkSettings(tolerance=1e-4)


@dataclass(frozen=True)
class TargetIk:
    """Inverse kinematics of a skeleton whose points pull by how certain they are."""

    skeleton: Skeleton
    settings: IkSettings = COARSE

    @cached_property
    def ik(self) -> InverseKinematics:
        """The solver of one frame."""
        return InverseKinematics(self.skeleton, self.settings)

    @cached_property
    def is_finger(self) -> np.ndarray:
        """(P,) bool."""
        return self.skeleton.wrist_of >= 0

    @cached_property
    def wrist_or_self(self) -> np.ndarray:
        """(P,) the wrist of a finger's point; any other point itself."""
        return np.where(self.is_finger, self.skeleton.wrist_of, np.arange(len(self.is_finger)))

    def weight(self, expected_error: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Return the pull of every point in IK, (T, P)."""
        # A finger's own error is that of its offset; its wrist's error is added.
        squared = (expected_error / _DOUBT) ** 2
        squared = squared + squared.take(self.wrist_or_self, axis=1) * self.is_finger
        weight = np.where(measured, _MEASURED_WEIGHT, 1 / (1 + squared))
        # The twenty points of a hand rotate it about its wrist; together they must not outweigh the wrist's position.
        return np.where(self.is_finger, weight * _FINGER_WEIGHT, weight)

    def bent(self, estimate: PointEstimate, pose: Pose, observation: Observation) -> Pose:
        """Return the poses (T, …) of an estimate, bent until tracked points are in place.

        Rotations keep all freedoms of inverse kinematics, such as twists and the spine. Measured rotations have more
        weight, which the estimator may have moved slightly when one was lost or found again.
        """
        has_rotation = observed_points(observation, self.skeleton)[3][:, : len(self.skeleton.joints)]
        aim_weight = np.where(has_rotation, HEAD_WEIGHT, _POSE_WEIGHT)
        # Such an estimator reports what it took as tracked, by gloves too.
        weight = self.weight(estimate.confidence, estimate.occluded < 0.5)
        solved: list[Pose] = []
        for t, local in enumerate(pose.rotation):
            aim = world_rotation(self.skeleton, local)
            start = self.ik.at(pose.root_position[t], aim)
            solved.append(self.ik.solve(estimate.position[t], weight[t], aim, aim_weight[t], start)[0])
        roots, rotations = (np.stack([getattr(one, name) for one in solved]) for name in ("root_position", "rotation"))
        return Pose(self.skeleton, roots, rotations)
