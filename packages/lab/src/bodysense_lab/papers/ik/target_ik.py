"""Inverse kinematics that bends an estimated body until its points meet their targets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.devices.estimate import PointEstimate
from bodysense.geometry.products import world_rotation
from bodysense.observing.observation import Observation
from bodysense.observing.points import observed_points
from bodysense_lab.papers.ik.ik import IkSettings, InverseKinematics

MEASURED_ERROR = 0.002  # m: expected error of a tracked point
HEAD_WEIGHT = 0.05  # m²/rad²: weight of a measured rotation in IK
_HALF_WEIGHT_ERROR = 0.03  # m, expected error at which a predicted point has half the weight in IK
_MEASURED_WEIGHT = 10.0  # weight of a tracked point in IK; that of a certain prediction is 1
_FINGER_WEIGHT = 0.05  # factor on the weight of every point of a finger
_POSE_WEIGHT = 1e-3  # m²/rad²: weight of each rotation of the estimator
# Predictions have errors of centimetres, so IK need not converge to hundredths of a millimetre.
COARSE = IkSettings(tolerance=1e-4)


@dataclass(frozen=True)
class TargetIk:
    """Inverse kinematics of a skeleton with weights of points by their certainty."""

    skeleton: Skeleton
    settings: IkSettings = COARSE

    @cached_property
    def ik(self) -> InverseKinematics:
        """Solver of one frame."""
        return InverseKinematics(self.skeleton, self.settings)

    @cached_property
    def is_finger(self) -> np.ndarray:
        """(P,) bool: the point belongs to a finger."""
        return self.skeleton.wrist_of >= 0

    @cached_property
    def wrist_or_self(self) -> np.ndarray:
        """(P,) for each point of a finger its wrist, for others the point itself."""
        return np.where(self.is_finger, self.skeleton.wrist_of, np.arange(len(self.is_finger)))

    def weight(self, expected_error: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """Return the weights (T, P) of points in IK from expected errors (T, P) m and the mask of measured points."""
        # The expected error of a finger is that of its offset, so add the error of its wrist.
        squared = (expected_error / _HALF_WEIGHT_ERROR) ** 2
        squared = squared + squared.take(self.wrist_or_self, axis=1) * self.is_finger
        weight = np.where(measured, _MEASURED_WEIGHT, 1 / (1 + squared))
        # The twenty points of a hand rotate it about its wrist. Together they must not outweigh the wrist's position.
        return np.where(self.is_finger, weight * _FINGER_WEIGHT, weight)

    def bend(self, estimate: PointEstimate, pose: Pose, observation: Observation) -> Pose:
        """Return the poses (T, …) of an estimate, bent until tracked points are at their measured positions.

        The rotations of `pose` decide what positions leave open, such as twists and the spine. Measured rotations have
        more weight, because the estimator may have changed them slightly when one was lost or found again.
        """
        has_rotation = observed_points(observation, self.skeleton)[3][:, : len(self.skeleton.joints)]
        aim_weight = np.where(has_rotation, HEAD_WEIGHT, _POSE_WEIGHT)
        # The estimator marks the points that it used as tracked, also those of gloves, by `occluded`.
        weight = self.weight(estimate.confidence, estimate.occluded < 0.5)
        solved: list[Pose] = []
        for t, local in enumerate(pose.rotation):
            aim = world_rotation(self.skeleton.parents, self.skeleton.levels, local)
            start = self.ik.at(pose.root_position[t], aim)
            solved.append(self.ik.solve(estimate.position[t], weight[t], aim, aim_weight[t], start)[0])
        roots, rotations = (np.stack([getattr(one, name) for one in solved]) for name in ("root_position", "rotation"))
        return Pose(self.skeleton, roots, rotations)
