"""A body pulled to trackers that it wears: inverse kinematics from an estimator's pose to the points that are measured.

The points of a tracker weigh most, head and hands with them; what is guessed weighs the less the less sure it is, so
that hips follow a belt and knees their straps. A tracker sits somewhere about its joint: it moves the body, and its
rotation is not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.ik import IkSettings, InverseKinematics
from bodysense.body.pose import Pose
from bodysense.body.products import world_rotation
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError

# Where trackers are worn. Of a foot, one point moves all.
TRACKERS = (
    *("pelvis", "spine3", "left_knee", "right_knee", "left_ankle", "right_ankle", "left_foot", "right_foot"),
    *("left_elbow", "right_elbow"),
)
TRACKER_ERROR = 0.03  # m: what is expected of a joint that a tracker is worn at
_FEET = [[f"{side}_{part}" for part in ("ankle", "foot", "toe")] for side in ("left", "right")]


@dataclass(frozen=True)
class PullSettings:
    """How hard points pull, beside a certain guess's 1."""

    measured: float = 10.0  # head and hands
    tracker: float = 5.0
    doubt: float = 0.03  # m of expected error at which a guessed point pulls half as much
    finger: float = 0.05  # factor, of every point of a finger
    pose: float = 1e-3  # m²/rad²: of each rotation of the pose
    turned: float = 0.05  # m²/rad²: of the rotations of head and hands
    iterations: int = 6  # at most: each costs as much as all the rest of a frame

    def __post_init__(self) -> None:
        for name in ("measured", "tracker", "doubt", "finger", "pose", "turned"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"pull settings: {name} is {getattr(self, name):g}; it must be positive")


@dataclass(frozen=True)
class Pulled:
    """Pulls bodies of one skeleton."""

    skeleton: Skeleton
    settings: PullSettings = PullSettings()

    @cached_property
    def _ik(self) -> InverseKinematics:
        return InverseKinematics(self.skeleton, IkSettings(tolerance=1e-4, max_iterations=self.settings.iterations))

    @cached_property
    def _feet(self) -> list[np.ndarray]:
        return [self.skeleton.indices(names) for names in _FEET]

    @cached_property
    def _held(self) -> np.ndarray:
        """(3,) head and wrists."""
        return self.skeleton.indices(["head", "left_wrist", "right_wrist"])

    def pull(
        self,
        pose: Pose,
        position: np.ndarray,
        error: np.ndarray,
        measured: np.ndarray,
        tracker: np.ndarray,
        place: np.ndarray,
    ) -> tuple[Pose, np.ndarray]:
        """The pose of one frame with trackers, and where its points are (P, 3) m.

        Args:
            pose: The estimator's, without batch axes.
            position: (P, 3) m, world: the estimator's points.
            error: (P,) m, expected of them.
            measured: (P,) whether a point is one of head and hands that are measured.
            tracker: (P,) whether a tracker is measured there.
            place: (P, 3) m, where.
        """
        settings, target = self.settings, position.copy()
        squared = (error / settings.doubt) ** 2
        weight = np.where(self.skeleton.wrist_of >= 0, settings.finger, 1.0) / (1 + squared)
        for foot in self._feet:
            worn = foot[tracker[foot]]
            if len(worn):
                target[foot] += (place[worn] - position[worn]).mean(axis=0)
        target[tracker] = place[tracker]
        weight[measured], weight[tracker] = settings.measured, settings.tracker
        world = world_rotation(self.skeleton, pose.rotation)
        pull = np.full(len(world), settings.pose)
        pull[self._held[measured[self._held]]] = settings.turned
        solved, state = self._ik.solve(target, weight, world, pull, self._ik.at(pose.root_position, world))
        return solved, state.position
