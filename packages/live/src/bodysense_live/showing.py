"""The displayed body: regions that are kept still, a mirror, smoothing, and changes of settings without jumps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import Pose, standing_pose
from bodysense.body.products import CONJUGATE, exp, log, multiply
from bodysense.body.skeleton import Skeleton
from bodysense.body.spring import spring_step
from bodysense.completion.inertialiser import Inertialiser, Offset
from bodysense.estimate import CONTACT_POINTS, Estimate
from bodysense.io.protocol import PoseFrame, SignalFrame
from bodysense.observation import Observation
from bodysense_live.messages import Region, Settings

INERTIALISER = Inertialiser()
LONGEST_GAP = 1.0  # s, after which a pose is displayed at once


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
    """The state of smoothing and blending before the next pose."""

    smoothed: Smoothed | None = None  # the pose before, ahead of the offset
    shown: Pose | None = None  # before
    offset: Offset | None = None  # of the displayed body from the completed one
    breaks: bool = False  # continuity with the next pose, which must not jump

    def broken(self) -> Display:
        """The next pose is by other settings; it is led to from the one that is shown."""
        return replace(self, breaks=True)

    def unsmoothed(self) -> Display:
        """The next pose has nothing to do with the one before."""
        return replace(self, smoothed=None)

    def step(self, pose: Pose, time: float, half_life: float) -> tuple[Pose, Display]:
        """Return the pose to display at `time` s, smoothed with this half-life, and the state after it."""
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


LEAP = 0.03  # m from one frame to the next
_OTHER_FOOT = [CONTACT_POINTS.index(name) for name in ("right_ankle", "left_ankle", "right_foot", "left_foot")]
_LED_OVER = ("regions", "smoothing", "hold_feet")  # settings that change without a jump
_PARTS: dict[str, Region] = {
    **dict.fromkeys(("spine1", "spine2", "spine3"), "torso"),
    **dict.fromkeys(("neck", "head"), "head"),
    **dict.fromkeys(("collar", "shoulder", "elbow", "wrist"), "arms"),
    **dict.fromkeys(("hip", "knee", "ankle", "foot"), "legs"),
}


class Showing:
    """The display of one person. `eased`: ease the body if it would leap because a tracker is lost or found."""

    def __init__(self, skeleton: Skeleton, settings: Settings, eased: bool) -> None:
        self._eased, self._display = eased, Display()
        self._seen_before: tuple[list[str], np.ndarray] | None = None  # tracked points, and (P, 3) m of the body
        self._standing = standing_pose(skeleton).rotation
        self._joints, self._mirror = skeleton.joints, skeleton.mirror  # those of all bodies
        self._choose(settings)

    def _choose(self, settings: Settings) -> None:
        self._settings, regions = settings, set(settings.regions)
        self._still = np.array([_region(name) not in {None, *regions} for name in self._joints])
        self._keeps_still = bool(self._still.any())

    def change(self, settings: Settings) -> None:
        """Show the next pose by other settings."""
        before = self._settings
        self._choose(settings)
        if settings.mirror != before.mirror:
            self._display = self._display.unsmoothed()
        if any(getattr(settings, name) != getattr(before, name) for name in _LED_OVER):
            self.lead_over()

    def lead_over(self) -> None:
        """Let no jump show with the next pose."""
        self._display = self._display.broken()

    def shown(
        self, skeleton: Skeleton, observation: Observation, estimate: Estimate, frame: SignalFrame
    ) -> tuple[Pose, PoseFrame, np.ndarray | None]:
        """Return the pose to display, the frame to send, and points (P, 3) m unless the pose was changed."""
        root, rotation = np.asarray(estimate.pose.root_position[0]), np.asarray(estimate.pose.rotation[0])
        moment = float(observation.time[0])
        if self._eased:
            self._ease(observation, estimate.points[0])
        error, hidden, contact = estimate.confidence[0], 1.0 - estimate.measured[0], estimate.contact[0]
        before = root, rotation
        if self._keeps_still:
            rotation = np.where(self._still[:, None], self._standing, rotation)
        if self._settings.mirror:
            root, rotation = mirrored(skeleton, root, rotation)
            error, hidden, contact = error[self._mirror], hidden[self._mirror], contact[_OTHER_FOOT]
        pose, self._display = self._display.step(Pose(skeleton, root, rotation), moment, self._settings.smoothing)
        root, rotation = np.asarray(pose.root_position), np.asarray(pose.rotation)
        as_completed = root is before[0] and rotation is before[1]
        sent = PoseFrame(frame.sequence, frame.time, root, rotation, error, hidden, contact)
        return pose, sent, estimate.points[0] if as_completed else None

    def truth(self, skeleton: Skeleton, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the true pose, (3,) and (J, 4), in the form that is sent with the answer."""
        return mirrored(skeleton, root, rotation) if self._settings.mirror else (root, rotation)

    def _ease(self, observation: Observation, points: np.ndarray) -> None:
        """Ease the body if it leaps because a point is found or lost."""
        seen = [name for k, name in enumerate(observation.points) if observation.has_position[0, k]]
        before, self._seen_before = self._seen_before, (seen, points)
        if before is not None and before[0] != seen and np.abs(points - before[1]).max() > LEAP:
            self.lead_over()


def _region(joint: str) -> Region | None:
    """The region of a joint; None for the pelvis, which always moves."""
    part = joint.removeprefix("left_").removeprefix("right_")
    if part == "pelvis":
        return None
    return _PARTS.get(part, "fingers")
