"""The estimate: a whole body for every frame of an observation, with its expected errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical

if TYPE_CHECKING:
    from bodysense.tracking.core import Outputs

CONTACT_POINTS = ("left_ankle", "right_ankle", "left_foot", "right_foot")  # the feet are the balls


@dataclass(frozen=True, eq=False)
class EstimatedPoint:
    """One point of an estimate, over its frames."""

    name: str
    position: np.ndarray  # (..., T, 3) m, world
    measured: np.ndarray  # (..., T) bool: position is measured
    confidence: np.ndarray  # (..., T) m, expected position error, calibrated
    bound: np.ndarray  # (..., T) m, bound of the position error in 90 % of cases
    rotation: np.ndarray | None  # (..., T, 4) wxyz, world ← joint; None for end sites, which do not turn

    def __repr__(self) -> str:
        frames = "×".join(map(str, self.measured.shape))
        return f"EstimatedPoint({self.name}, {frames} frames, expected error {100 * self.confidence.mean():.1f} cm)"


@dataclass(frozen=True, eq=False)
class Estimate:
    """A whole body for every frame of an observation. P counts all points of the pose's skeleton.

    `estimate["left_elbow"]` is one point of it. Inferred proportions change while the tracker runs: `points` and
    `rest_offset` are those of each frame, and the pose's skeleton has those of the last frame. For several people the
    pose's skeleton is that of the first person; `of` returns the estimate of one person.
    """

    pose: Pose  # (..., T), on the person's skeleton
    points: np.ndarray  # (..., T, P, 3) m, world
    measured: np.ndarray  # (..., T, P) bool: position is measured
    confidence: np.ndarray  # (..., T, P) m, expected position error, calibrated
    bound: np.ndarray  # (..., T, P) m, bound of the position error in 90 % of cases
    contact: np.ndarray  # (..., T, 4) probability that each of `CONTACT_POINTS` rests on something
    rest_offset: np.ndarray  # (..., T, P, 3) m
    memory: Outputs | None = field(default=None, repr=False)  # that a step may reuse (`Tracker.step`)
    notices: tuple[str, ...] = ()  # doubts about the world of the first frames, each with its fix

    def __getitem__(self, name: str) -> EstimatedPoint:
        """Return a point by its name. Raises BodysenseError, with the nearest names, for an unknown one."""
        skeleton = self.pose.skeleton
        k = skeleton.index(name)
        return EstimatedPoint(
            name,
            self.points[..., k, :],
            self.measured[..., k],
            self.confidence[..., k],
            self.bound[..., k],
            self._world_rotation[..., k, :] if k < len(skeleton.joints) else None,
        )

    def __repr__(self) -> str:
        *people, frames, points = self.measured.shape
        of = "".join(f"{count} people, " for count in people) + ("1 frame" if frames == 1 else f"{frames} frames")
        measured, error = self.measured.mean(), 100 * self.confidence.mean()
        return f"Estimate({of} of {points} points, {measured:.0%} measured, expected error {error:.1f} cm)"

    @cached_property
    def _world_rotation(self) -> np.ndarray:
        """(..., T, J, 4) wxyz, world ← joint."""
        return np.asarray(quaternion_canonical(forward_kinematics(self.pose)[1]))

    def of(self, person: int) -> Estimate:
        """Return the estimate of one person from one that leads with an axis of people."""
        if self.measured.ndim < 3:
            raise BodysenseError("estimate: of one person alone, so that it is that person's; leave of() out")
        offset = self.rest_offset[person]
        pose = Pose(
            self.pose.skeleton.with_offsets(offset[-1]), self.pose.root_position[person], self.pose.rotation[person]
        )
        return Estimate(
            pose=pose,
            points=self.points[person],
            measured=self.measured[person],
            confidence=self.confidence[person],
            bound=self.bound[person],
            contact=self.contact[person],
            rest_offset=offset,
        )
