"""The displayed body: still regions, mirroring, smoothing, and blending when settings change."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import Pose, standing_pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.products import CONJUGATE, exp, log, multiply
from bodysense.geometry.spring import spring_step
from bodysense.io.formats.protocol import PoseFrame, SignalFrame
from bodysense.observing.observation import Observation
from bodysense.tracking.estimate import CONTACT_POINTS, Estimate
from bodysense_live.server.messages import Region, Settings

LONGEST_GAP = 1.0  # s; after a longer gap the pose is neither smoothed nor blended
BLEND_HALF_LIFE = 0.08  # s in which half of a jump decays
_NEGLIGIBLE = 1e-7  # m, rad, m/s and rad/s; smaller offsets end


@dataclass(frozen=True, eq=False)
class Offset:
    """Difference of a pose from its target, which a critically damped spring takes to zero.

    The output continues from its last pose, and the old motion is not blended in (Bollo, *Inertialization*, GDC 2018).
    """

    value: np.ndarray  # (J + 1, 3) rotation vectors, rad, in the axes of the parent, and last the root's offset, m
    velocity: np.ndarray  # (J + 1, 3) of it, a second

    def after(self, interval: float, half_life: float) -> Offset:
        """Return the offset `interval` s later. At rest it halves within `half_life` s, at any frame rate."""
        return Offset(*spring_step(self.value, self.velocity, half_life, interval))

    def applied(self, target: Pose) -> Pose:
        """Return the pose at this offset from a target."""
        rotation = multiply(exp(self.value[:-1]), np.asarray(target.rotation))
        rotation *= np.copysign(1.0, rotation[:, :1])
        return Pose(target.skeleton, target.root_position + self.value[-1], rotation)

    @property
    def is_over(self) -> bool:
        """Whether the offset is negligible, and stays so."""
        return max(np.abs(self.value).max(), np.abs(self.velocity).max()) < _NEGLIGIBLE


def offset_at_rest(pose: Pose, target: Pose) -> Offset:
    """Return the offset of a pose from its target, without velocity."""
    turn = log(multiply(np.asarray(pose.rotation), np.asarray(target.rotation) * CONJUGATE))
    value = np.concatenate([turn, [np.asarray(pose.root_position) - np.asarray(target.root_position)]])
    return Offset(value, np.zeros_like(value))


@dataclass(frozen=True, eq=False)
class DisplayState:
    """The state of smoothing and blending before the next pose."""

    time: float = 0.0  # s, of the last pose
    smoothed: Pose | None = None  # last pose, before blending
    velocity: np.ndarray | float = 0.0  # (J + 1, 3) of the smoothed pose, as of an `Offset`
    displayed: Pose | None = None  # last pose
    blend: Offset | None = None  # offset of the displayed pose from the smoothed one
    blends: bool = False  # start a new blend with the next pose, so that it does not jump

    def blending(self) -> DisplayState:
        """Return the state that blends from the displayed pose to the next one."""
        return replace(self, blends=True)

    def unsmoothed(self) -> DisplayState:
        """Return the state that displays the next pose at once."""
        return replace(self, smoothed=None)

    def step(self, pose: Pose, time: float, half_life: float) -> tuple[Pose, DisplayState]:
        """Return the pose to display at `time` s, smoothed with a half-life in s, and the state after it."""
        before, displayed, blend, interval = self.smoothed, self.displayed, self.blend, time - self.time
        if before is None or interval > LONGEST_GAP:
            before = displayed = blend = None
        velocity: np.ndarray | float = 0.0
        if before is not None and half_life:
            start = offset_at_rest(before, pose)
            behind = replace(start, velocity=start.velocity + self.velocity).after(interval, half_life)
            pose, velocity = behind.applied(pose), behind.velocity
        smoothed = pose
        if self.blends and displayed is not None:
            blend = offset_at_rest(displayed, pose)
        if blend is not None:
            blend = blend.after(interval, BLEND_HALF_LIFE)
            pose, blend = (pose, None) if blend.is_over else (blend.applied(pose), blend)
        return pose, DisplayState(time, smoothed, velocity, pose, blend)


def mirrored(skeleton: Skeleton, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mirror a pose across the plane x = 0: root (3,) m and rotations (J, 4)."""
    partner = skeleton.mirror[: len(rotation)]
    return root * [-1, 1, 1], rotation[partner] * [1, 1, -1, -1]


JUMP = 0.03  # m per frame; a larger step of any coordinate is a jump
_OTHER_FOOT = [CONTACT_POINTS.index(name) for name in ("right_ankle", "left_ankle", "right_foot", "left_foot")]
_BLENDED_SETTINGS = ("regions", "smoothing", "hold_feet")  # settings whose changes are blended
_PARTS: dict[str, Region] = {
    **dict.fromkeys(("spine1", "spine2", "spine3"), "torso"),
    **dict.fromkeys(("neck", "head"), "head"),
    **dict.fromkeys(("collar", "shoulder", "elbow", "wrist"), "arms"),
    **dict.fromkeys(("hip", "knee", "ankle", "foot"), "legs"),
}


class BodyDisplay:
    """The displayed body of one person. `eased`: blend if the body would jump because a tracker is lost or found."""

    def __init__(self, skeleton: Skeleton, settings: Settings, eased: bool) -> None:
        self._eased, self._state = eased, DisplayState()
        self._seen_before: tuple[list[str], np.ndarray] | None = None  # tracked points; body's points (P, 3) m
        self._standing = standing_pose(skeleton).rotation
        self._joints, self._mirror = skeleton.joints, skeleton.mirror  # equal for all bodies
        self._set_regions(settings)

    def _set_regions(self, settings: Settings) -> None:
        self._settings = settings
        parts = [name.removeprefix("left_").removeprefix("right_") for name in self._joints]
        # The pelvis belongs to no region: it always moves.
        still = [part != "pelvis" and _PARTS.get(part, "fingers") not in settings.regions for part in parts]
        self._still = np.array(still)
        self._keeps_still = bool(self._still.any())

    def apply(self, settings: Settings) -> None:
        """Apply settings to the next pose."""
        before = self._settings
        self._set_regions(settings)
        if settings.mirror != before.mirror:
            self._state = self._state.unsmoothed()
        if any(getattr(settings, name) != getattr(before, name) for name in _BLENDED_SETTINGS):
            self.blend_next()

    def blend_next(self) -> None:
        """Blend to the next pose."""
        self._state = self._state.blending()

    def step(
        self, skeleton: Skeleton, observation: Observation, estimate: Estimate, frame: SignalFrame
    ) -> tuple[Pose, PoseFrame, np.ndarray | None]:
        """Return the pose to display, the frame to send, and points (P, 3) m, or None if the pose was changed."""
        root, rotation = np.asarray(estimate.pose.root_position[0]), np.asarray(estimate.pose.rotation[0])
        moment = float(observation.time[0])
        if self._eased:
            seen = [name for k, name in enumerate(observation.points) if observation.has_position[0, k]]
            points = estimate.points[0]
            before, self._seen_before = self._seen_before, (seen, points)
            if before is not None and before[0] != seen and np.abs(points - before[1]).max() > JUMP:
                self.blend_next()  # the body jumps because a point is lost or found
        error, hidden, contact = estimate.confidence[0], 1.0 - estimate.measured[0], estimate.contact[0]
        before = root, rotation
        if self._keeps_still:
            rotation = np.where(self._still[:, None], self._standing, rotation)
        if self._settings.mirror:
            root, rotation = mirrored(skeleton, root, rotation)
            error, hidden, contact = error[self._mirror], hidden[self._mirror], contact[_OTHER_FOOT]
        pose, self._state = self._state.step(Pose(skeleton, root, rotation), moment, self._settings.smoothing)
        root, rotation = np.asarray(pose.root_position), np.asarray(pose.rotation)
        is_unchanged = root is before[0] and rotation is before[1]
        sent = PoseFrame(frame.sequence, frame.time, root, rotation, error, hidden, contact)
        return pose, sent, estimate.points[0] if is_unchanged else None

    def truth(self, skeleton: Skeleton, root: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a true pose, (3,) m and (J, 4), mirrored as the answer is."""
        return mirrored(skeleton, root, rotation) if self._settings.mirror else (root, rotation)
