"""The estimate: a whole body for every frame of an observation, with its expected errors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.pose import Pose, world_rotation
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical

if TYPE_CHECKING:
    from bodysense.tracking.core import Outputs

CONTACT_POINTS = ("left_ankle", "right_ankle", "left_foot", "right_foot")  # the feet are the balls


class TrackedPose(Pose):
    """A pose on the proportions of its last frame. Its skeleton is made on first use: most frames are not asked."""

    @classmethod
    def of(cls, rest_offset: np.ndarray, root_position: np.ndarray, rotation: np.ndarray) -> TrackedPose:
        """Return the pose of a body with rest offsets (P, 3) m; the other arguments are those of `Pose`."""
        made = object.__new__(cls)
        made.__dict__.update(root_position=root_position, rotation=rotation, _rest_offset=rest_offset)
        return made

    def __getattr__(self, name: str) -> Skeleton:
        """Return the skeleton; called until it is made."""
        if name != "skeleton":
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        made = self.__dict__["skeleton"] = _skeleton_with(self.__dict__["_rest_offset"].tobytes())
        return made


@lru_cache(maxsize=256)
def _skeleton_with(offset: bytes) -> Skeleton:
    """Return the skeleton with rest offsets (P, 3) float64; cached, so that equal proportions share one object."""
    return default_skeleton().with_offsets(np.frombuffer(offset).reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class EstimatedPoint:
    """One point of an estimate, over its frames."""

    name: str
    position: np.ndarray  # (..., T, 3) m, world
    measured: np.ndarray  # (..., T) bool: position is measured
    confidence: np.ndarray  # (..., T) m, expected position error, calibrated
    bound: np.ndarray  # (..., T) m, bound of the position error in 90 % of cases
    pose: Pose = field(repr=False)  # the whole body's

    def __repr__(self) -> str:
        frames = "×".join(map(str, self.measured.shape))
        return f"EstimatedPoint({self.name}, {frames} frames, expected error {100 * self.confidence.mean():.1f} cm)"

    @cached_property
    def rotation(self) -> np.ndarray | None:
        """(..., T, 4) wxyz, world ← joint; None for end sites, which do not turn."""
        skeleton = self.pose.skeleton
        k = skeleton.index(self.name)
        return None if k >= len(skeleton.joints) else np.asarray(quaternion_canonical(world_rotation(self.pose, k)))


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
    notices: tuple[str, ...] = ()  # doubts about the world of a state's first 20 s, each with its fix

    def __getitem__(self, name: str) -> EstimatedPoint:
        """Return a point by its name. Raises BodysenseError, with the nearest names, for an unknown one."""
        k = self.pose.skeleton.index(name)
        return EstimatedPoint(
            name,
            self.points[..., k, :],
            self.measured[..., k],
            self.confidence[..., k],
            self.bound[..., k],
            self.pose,
        )

    def __repr__(self) -> str:
        *people, frames, points = self.measured.shape
        of = "".join(f"{count} people, " for count in people) + ("1 frame" if frames == 1 else f"{frames} frames")
        measured, error = self.measured.mean(), 100 * self.confidence.mean()
        return f"Estimate({of} of {points} points, {measured:.0%} measured, expected error {error:.1f} cm)"

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
