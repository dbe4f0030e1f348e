"""Fusion of markers and inertial sensors: sensors pose fingers with hidden markers; seen markers correct their drift.

A glove may have a sensor on the back of the hand and sensors on segments of fingers (two-hands, section 2.2). In an
observation a sensor is the rotation of a joint without a position: `left_wrist`, `left_index2` … Only the rotation of a
segment relative to the one before it is used, and of this only the flexion, as in the paper.

The flexion that two sensors measure has two errors: an offset (straps), and the difference of the sensors' headings
times the vertical component of the hinge's axis. Gravity corrects the rest. A Kalman filter of each joint estimates
both errors from the solved pose while the joint's markers are seen. When they are hidden, the joint goes from the
solved flexion to the corrected one. Its abduction and twist keep their last values and slowly return to rest, because
those from predicted markers are worse. A joint returns to the solved pose when its sensors stop.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from bodysense.body.hands.hand import HAND_JOINTS, joint_angles, joint_rotations
from bodysense.devices.gloves.fingers import HandPoses, HandShape, place_hands
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate

_SEGMENTS = len(HAND_JOINTS) - 1
# Parent of each segment among the 16: the back of the hand, then the fingers' segments.
_BEFORE = [0 if joint.endswith("1") else place for place, joint in enumerate(HAND_JOINTS[1:])]
_RETURN = 0.1  # s, half-life of the change after a sensor stopped or was found


@dataclass(frozen=True)
class InertialSettings:
    """Settings of inertial sensors. `aside` is chosen by `bodysense evaluate gloves-settings`.

    From `offset` on they are standard deviations of errors in the Kalman filter.
    """

    ramp: float = 0.1  # s after markers are hidden in which a joint's pose changes to that of its sensors
    aside: float = 3.0  # s, half-life of the abduction and twist of a joint with hidden markers
    offset: float = 3.0  # °, initial offset of the flexion
    offset_walk: float = 0.3  # °/√s, random walk of the offset
    heading: float = 10.0  # °, initial difference of the headings of two sensors
    heading_walk: float = 0.7  # °/√s, random walk of this difference
    solved: float = 5.0  # °, error of the solved flexion of a joint with seen markers
    solved_time: float = 0.5  # s, correlation time of that error

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"inertial sensors: {name} is {getattr(self, name):g}; it must be positive")


class SensorFlexion(NamedTuple):
    """Flexion of joints as sensors measure it, NaN if a sensor is missing."""

    flexion: np.ndarray  # (…, H, 15) rad
    vertical: np.ndarray  # (…, H, 15) vertical component of the hinges' axes, −1 to 1


class InertialState(NamedTuple):
    """State for the next frame."""

    error: np.ndarray  # (H, 15, 2) rad: offset of the flexion, and difference of the headings
    covariance: np.ndarray  # (H, 15, 2, 2) rad²
    aside: np.ndarray  # (H, 15, 2) rad, abduction and twist of joints when their markers were last seen
    turn: np.ndarray  # (H, 15, 3) rad, added to the solved flexion, abduction and twist
    remaining: np.ndarray  # (H, 15, 3) rad, part of `turn` that remains after a sensor stopped or was found
    sensed: np.ndarray  # (H, 15) bool: the joint has sensors


def sensor_flexion(rotation: np.ndarray, axes: np.ndarray) -> SensorFlexion:
    """Return the flexion from sensors' rotations (…, H, 16, 4), world ← segment, NaN where missing.

    The hands are left ones; `axes` (H, 15, 4, 4) are the joints' own axes (`hand.own_axes`).
    """
    before = rotation[..., _BEFORE, :]
    local = np.asarray(quaternion_multiply(quaternion_conjugate(before), rotation[..., 1:, :]))
    axis = quaternion_rotate(before, -axes[..., 3, 1:])  # of flexion, −z
    return SensorFlexion(joint_angles(local, axes)[..., 0], np.asarray(axis)[..., 1])


def sensed_markers(sensed: SensorFlexion, shape: HandShape, like: tuple[int, ...]) -> np.ndarray:
    """Return a mask of shape `like`, (T, H, 9): markers of fingers with sensors on all joints."""
    whole = np.asarray(np.isfinite(sensed.flexion).reshape(*like[:-1], 5, 3).all(axis=-1))
    is_sensed = np.zeros(like, dtype=bool)
    is_sensed[..., shape.markers] = whole[..., [0, 1, 2, 3, 4, 0]]
    return is_sensed


def joints_hidden(hidden: np.ndarray, shape: HandShape) -> np.ndarray:
    """Return the times (H, 15) s for which each joint's markers have been hidden, from those of markers (H, 9) s.

    A joint's marker is that of its fingertip. The base of the thumb also has the thumb's middle marker; the time is
    then the shorter one.
    """
    joints = hidden.take(shape.markers[:5], axis=1).repeat(3, axis=1)
    joints[:, 0] = np.minimum(joints[:, 0], hidden[:, shape.markers[5]])
    return joints


@dataclass(frozen=True, eq=False)
class Fusion:
    """Fusion of markers and inertial sensors of H hands; `axes` (H, 15, 4, 4) are joints' own (`hand.own_axes`)."""

    shape: HandShape
    axes: np.ndarray
    settings: InertialSettings = InertialSettings()

    def start(self) -> InertialState:
        """Return the state before the first frame."""
        hands = len(self.axes)
        deviation = np.radians([self.settings.offset, self.settings.heading])
        covariance = np.tile(np.diag(deviation**2), (hands, _SEGMENTS, 1, 1))
        error, turn = (np.zeros((hands, _SEGMENTS, count)) for count in (2, 3))
        return InertialState(error, covariance, error, turn, turn, np.zeros((hands, _SEGMENTS), dtype=bool))

    def fuse(
        self, poses: HandPoses, sensed: SensorFlexion, hidden: np.ndarray, interval: float, state: InertialState
    ) -> tuple[HandPoses, InertialState]:
        """Pose joints with hidden markers by sensors; return the hands and the state for the next frame.

        Args:
            poses: solved hands.
            sensed: flexion (H, 15) that sensors measure in this frame.
            hidden: (H, 9) s for which each marker has been hidden; 0 if seen.
            interval: seconds since the frame before.
            state: after the frame before.
        """
        lost, present = joints_hidden(hidden, self.shape), np.isfinite(sensed.flexion)
        solved = joint_angles(poses.rotation[:, 1:], self.axes)
        difference = _wrap(np.where(present, sensed.flexion, 0.0) - solved[..., 0])
        sensitivity = np.stack([np.ones_like(difference), np.where(present, sensed.vertical, 0.0)], axis=-1)
        error, covariance = self._update_filter(state, difference, sensitivity, present & (lost == 0), interval)
        aside = np.where((lost == 0)[..., None], solved[..., 1:], state.aside)
        fading = aside * 0.5 ** (lost / self.settings.aside)[..., None]
        change = np.concatenate(
            [(difference - (sensitivity * error).sum(axis=-1))[..., None], fading - solved[..., 1:]], axis=-1
        )
        target = (np.minimum(lost / self.settings.ramp, 1.0) * present)[..., None] * _wrap(change)
        remaining = state.remaining * 0.5 ** (interval / _RETURN)
        remaining = np.where((present == state.sensed)[..., None], remaining, state.turn - target)
        remaining = remaining * (lost > interval)[..., None]
        turn = target + remaining
        after = InertialState(error, covariance, aside, turn, remaining, present)
        return (self._apply(poses, solved, turn) if turn.any() else poses), after

    def _apply(self, poses: HandPoses, solved: np.ndarray, turn: np.ndarray) -> HandPoses:
        """Return hands with joint angles `solved` + `turn` (H, 15, 3) rad."""
        local = joint_rotations(solved + turn, self.axes)
        rotation, still = poses.rotation.copy(), np.asarray(~turn.any(axis=-1))
        rotation[:, 1:] = np.where(still[..., None], rotation[:, 1:], local)
        posed, whole = place_hands(self.shape, poses.root, rotation), np.asarray(still.all(axis=1))[:, None, None]
        return posed._replace(position=np.where(whole, poses.position, posed.position))

    def _update_filter(
        self, state: InertialState, difference: np.ndarray, sensitivity: np.ndarray, seen: np.ndarray, interval: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run one step of the Kalman filter; return the errors (H, 15, 2) rad and their covariance.

        Args:
            state: after the frame before.
            difference: (H, 15) rad, the sensors' flexion minus the solved one.
            sensitivity: (H, 15, 2) derivative of the flexion by each error.
            seen: (H, 15) bool: joints with sensors and seen markers, which are corrected.
            interval: seconds since the frame before.
        """
        settings = self.settings
        walk = np.diag(np.radians([settings.offset_walk, settings.heading_walk]) ** 2)
        covariance = state.covariance + walk * interval
        noise = np.radians(settings.solved) ** 2 * settings.solved_time / interval  # equivalent for independent frames
        cross = (covariance @ sensitivity[..., None])[..., 0]
        gain = cross / ((cross * sensitivity).sum(axis=-1) + noise)[..., None] * seen[..., None]
        residual = _wrap(difference - (sensitivity * state.error).sum(axis=-1))
        return state.error + gain * residual[..., None], covariance - gain[..., None] * cross[..., None, :]


def _wrap(angle: np.ndarray) -> np.ndarray:
    """Return angles in −π to π."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
