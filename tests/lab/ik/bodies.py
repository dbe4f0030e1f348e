"""Bodies whose points are targets of inverse kinematics."""

from __future__ import annotations

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.geometry.rotation import quaternion_exp
from bodysense_lab.papers.ik.ik import IkSettings, InverseKinematics

BODY = default_skeleton()
IK = InverseKinematics(BODY)
EXACT = InverseKinematics(BODY, IkSettings(tolerance=1e-14, max_iterations=200))
ONE_STEP = InverseKinematics(BODY, IkSettings(max_iterations=1))


def random_pose(rng: np.random.Generator, spread: float = 0.4, skeleton: Skeleton = BODY) -> Pose:
    """A pose with every joint turned at random (radians), anywhere, facing anywhere."""
    turn = rng.normal(0, spread, (len(skeleton.joints), 3))
    turn[0] = rng.normal(0, 2, 3)
    return Pose(skeleton, rng.normal(0, 2, 3), quaternion_exp(turn))


def bent(**degrees: tuple[float, float, float]) -> Pose:
    """The rest pose with some joints turned, rotation vectors in degrees."""
    turn = np.zeros((len(BODY.joints), 3))
    for joint, vector in degrees.items():
        turn[BODY.index(joint)] = np.radians(vector)
    return Pose(BODY, np.array([0.0, 1.0, 0.0]), quaternion_exp(turn))


def points(pose: Pose) -> np.ndarray:
    return forward_kinematics(pose)[0]


def distance(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.linalg.norm(a - b, axis=-1).max())
