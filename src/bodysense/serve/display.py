"""What is shown of a completed pose: as it is, or calmer and later, and never with a jump where settings changed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.products import CONJUGATE, exp, log, multiply
from bodysense.body.skeleton import Skeleton
from bodysense.body.spring import spring_step
from bodysense.completion.inertialiser import Inertialiser, Offset

INERTIALISER = Inertialiser()
LONGEST_GAP = 1.0  # s, after which a pose is shown as it is


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A pose in motion."""

    time: float  # s
    root: np.ndarray  # (3,) m
    rotation: np.ndarray  # (J, 4) wxyz, parent ← joint
    velocity: np.ndarray  # (3,) m/s
    spin: np.ndarray  # (J, 3) rad/s


@dataclass(frozen=True, eq=False)
class Display:
    """What the next pose is shown after."""

    smoothed: Smoothed | None = None  # the pose before, ahead of the offset
    shown: Pose | None = None  # before
    offset: Offset | None = None  # of what is shown from what is completed
    breaks: bool = False  # with the next pose, which no jump may show

    def broken(self) -> Display:
        """The next pose is by other settings; it is led to from the one that is shown."""
        return replace(self, breaks=True)

    def unsmoothed(self) -> Display:
        """The next pose has nothing to do with the one before."""
        return replace(self, smoothed=None)

    def step(self, pose: Pose, time: float, half_life: float) -> tuple[Pose, Display]:
        """What is shown of a pose at `time` s, behind it by a smoother of this half-life, and what comes after."""
        before, shown, offset = self.smoothed, self.shown, self.offset
        if before is None or time - before.time > LONGEST_GAP:
            before = shown = offset = None
        root, rotation = pose.root_position, pose.rotation
        if before is None or half_life == 0:
            smoothed = at_rest(time, root, rotation)
        else:
            smoothed = followed(before, time, root, rotation, half_life)
            pose = Pose(pose.skeleton, smoothed.root, smoothed.rotation)
        if self.breaks and shown is not None:
            offset = INERTIALISER.start(shown, pose, offset or INERTIALISER.rest(pose))
        if offset is not None and before is not None:
            pose, offset = INERTIALISER.apply(pose, time - before.time, offset)
            offset = offset if offset.root.any() or offset.rotation.any() else None
        return pose, Display(smoothed, pose, offset)


def mirrored(skeleton: Skeleton, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A pose with left and right swapped, across the plane x = 0."""
    partner = skeleton.mirror[: len(rotation)]
    return root * [-1, 1, 1], rotation[partner] * [1, 1, -1, -1]


def at_rest(time: float, root: np.ndarray, rotation: np.ndarray) -> Smoothed:
    """A pose that does not move."""
    return Smoothed(time, root, rotation, np.zeros(3), np.zeros((len(rotation), 3)))


def followed(before: Smoothed, time: float, root: np.ndarray, rotation: np.ndarray, half_life: float) -> Smoothed:
    """The pose at `time` s on its way to another one: half a jump is closed after `half_life` s, at any rate."""
    turn = log(multiply(before.rotation, rotation * CONJUGATE))
    offset = np.concatenate([turn, [before.root - root]])
    velocity = np.concatenate([before.spin, [before.velocity]])
    offset, velocity = spring_step(offset, velocity, half_life, time - before.time)
    turned = multiply(exp(offset[:-1]), rotation)
    turned *= np.copysign(1.0, turned[:, :1])
    return Smoothed(time, root + offset[-1], turned, velocity[-1], velocity[:-1])
