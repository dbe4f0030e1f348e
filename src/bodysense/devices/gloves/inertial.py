"""Fingers by inertial sensors: the pose of joints whose markers are hidden, with drift corrected while they are seen.

A glove may have a sensor on the back of the hand and sensors on segments of fingers (two-hands, section 2.2). In an
observation a sensor is the rotation of a joint without a position: `left_wrist`, `left_index2` … Only rotations of a
segment relative to the one before it are used, and of these only the flexion, as in the paper.

The flexion by two sensors is wrong by an offset (straps) and by the difference of the sensors' headings, times the
vertical part of the hinge's axis: gravity corrects the rest. A Kalman filter of each joint estimates both errors from
the solved pose while the joint's markers are seen. When they are hidden, the joint goes from the solved flexion to the
corrected one. Its abduction and twist stay, and slowly return to rest: those by predicted markers are worse.
A joint whose sensors stop returns to the solved pose.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from bodysense.body.hand import HAND_JOINTS, joint_angles, joint_rotations
from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply, quaternion_rotate
from bodysense.devices.gloves.fingers import HandPoses, HandShape, place_hands
from bodysense.errors import BodysenseError

_SEGMENTS = len(HAND_JOINTS) - 1
# Parent of each segment among the 16: the back of the hand, then the fingers' segments.
_BEFORE = [0 if joint.endswith("1") else place for place, joint in enumerate(HAND_JOINTS[1:])]
_RETURN = 0.1  # s, half-life of the change where a sensor stops or is found


@dataclass(frozen=True)
class InertialSettings:
    """Settings of inertial sensors. `aside` is chosen by `bodysense evaluate gloves-settings`.

    From `offset` on they are the sizes of errors that the Kalman filter expects.
    """

    ramp: float = 0.1  # s after its markers are hidden in which a joint's pose becomes the sensors'
    aside: float = 3.0  # s, half-life of the abduction and twist of a joint with hidden markers
    offset: float = 3.0  # °, of the flexion, at the start
    offset_walk: float = 0.3  # °/√s by which it changes
    heading: float = 10.0  # ° between two sensors, at the start
    heading_walk: float = 0.7  # °/√s by which it changes
    solved: float = 5.0  # °, error of the solved flexion of a joint with seen markers
    solved_time: float = 0.5  # s in which that error is forgotten

    def __post_init__(self) -> None:
        for name in (field.name for field in fields(self)):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"inertial sensors: {name} is {getattr(self, name):g}; it must be positive")


class Sensed(NamedTuple):
    """Flexion that sensors measure, NaN where a sensor is missing, and the vertical part of the hinges' axes."""

    flexion: np.ndarray  # (…, H, 15) rad
    vertical: np.ndarray  # (…, H, 15) −1 to 1


class InertialState(NamedTuple):
    """State for the next frame."""

    error: np.ndarray  # (H, 15, 2) rad: offset of the flexion, and difference of the headings
    covariance: np.ndarray  # (H, 15, 2, 2) rad²
    aside: np.ndarray  # (H, 15, 2) rad, abduction and twist of joints when their markers were last seen
    turn: np.ndarray  # (H, 15, 3) rad, added to the solved flexion, abduction and twist
    returning: np.ndarray  # (H, 15, 3) rad, remaining change where a sensor stopped or was found
    sensed: np.ndarray  # (H, 15) bool


def sense(rotation: np.ndarray, axes: np.ndarray) -> Sensed:
    """Return what sensors measure, from their rotations (…, H, 16, 4), world ← segment, NaN where missing.

    The hands are left ones; `axes` (H, 15, 4, 4) are their joints' own (`hand.own_axes`).
    """
    before = rotation[..., _BEFORE, :]
    local = np.asarray(quaternion_multiply(quaternion_conjugate(before), rotation[..., 1:, :]))
    axis = quaternion_rotate(before, -axes[..., 3, 1:])  # of flexion, −z
    return Sensed(joint_angles(local, axes)[..., 0], np.asarray(axis)[..., 1])


def markers_sensed(sensed: Sensed, shape: HandShape, like: tuple[int, ...]) -> np.ndarray:
    """Return which markers (T, H, 9), a mask of shape `like`, are of fingers whose joints all have sensors."""
    whole = np.asarray(np.isfinite(sensed.flexion).reshape(*like[:-1], 5, 3).all(axis=-1))
    felt = np.zeros(like, dtype=bool)
    felt[..., shape.markers] = whole[..., [0, 1, 2, 3, 4, 0]]
    return felt


def joints_hidden(hidden: np.ndarray, shape: HandShape) -> np.ndarray:
    """Return the time (H, 15) s for which no marker that determines a joint has been seen, from the markers' (H, 9) s.

    A joint is determined by the marker of its fingertip, the base of the thumb also by the thumb's middle one.
    """
    joints = hidden.take(shape.markers[:5], axis=1).repeat(3, axis=1)
    joints[:, 0] = np.minimum(joints[:, 0], hidden[:, shape.markers[5]])
    return joints


@dataclass(frozen=True, eq=False)
class Fusion:
    """Markers and inertial sensors of H hands; `axes` (H, 15, 4, 4) are their joints' own (`hand.own_axes`)."""

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
        self, poses: HandPoses, sensed: Sensed, hidden: np.ndarray, interval: float, state: InertialState
    ) -> tuple[HandPoses, InertialState]:
        """Return hands whose joints without seen markers are posed by sensors, and the state after them.

        Args:
            poses: solved hands.
            sensed: (H, 15), of the frame.
            hidden: (H, 9) s for which each marker has been hidden; 0 if seen.
            interval: seconds since the frame before.
            state: after the frame before.
        """
        lost, present = joints_hidden(hidden, self.shape), np.isfinite(sensed.flexion)
        solved = joint_angles(poses.rotation[:, 1:], self.axes)
        more = _wrapped(np.where(present, sensed.flexion, 0.0) - solved[..., 0])
        facing = np.stack([np.ones_like(more), np.where(present, sensed.vertical, 0.0)], axis=-1)
        error, covariance = self._corrected(state, more, facing, present & (lost == 0), interval)
        aside = np.where((lost == 0)[..., None], solved[..., 1:], state.aside)
        kept = aside * 0.5 ** (lost / self.settings.aside)[..., None]
        change = np.concatenate([(more - (facing * error).sum(axis=-1))[..., None], kept - solved[..., 1:]], axis=-1)
        wanted = (np.minimum(lost / self.settings.ramp, 1.0) * present)[..., None] * _wrapped(change)
        returning = state.returning * 0.5 ** (interval / _RETURN)
        returning = np.where((present == state.sensed)[..., None], returning, state.turn - wanted)
        returning = returning * (lost > interval)[..., None]
        turn = wanted + returning
        after = InertialState(error, covariance, aside, turn, returning, present)
        return (self._turned(poses, solved, turn) if turn.any() else poses), after

    def _turned(self, poses: HandPoses, solved: np.ndarray, turn: np.ndarray) -> HandPoses:
        """Return hands whose joints have the angles `solved` + `turn` (H, 15, 3) rad."""
        local = joint_rotations(solved + turn, self.axes)
        rotation, still = poses.rotation.copy(), np.asarray(~turn.any(axis=-1))
        rotation[:, 1:] = np.where(still[..., None], rotation[:, 1:], local)
        placed, whole = place_hands(self.shape, poses.root, rotation), np.asarray(still.all(axis=1))[:, None, None]
        return placed._replace(position=np.where(whole, poses.position, placed.position))

    def _corrected(
        self, state: InertialState, more: np.ndarray, facing: np.ndarray, seen: np.ndarray, interval: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the errors (H, 15, 2) rad and their covariance after a frame: one step of a Kalman filter where seen.

        Args:
            state: after the frame before.
            more: (H, 15) rad by which the sensors' flexion is larger than the solved one.
            facing: (H, 15, 2) how much each error changes the flexion.
            seen: (H, 15) bool: joints with sensors and seen markers.
            interval: seconds since the frame before.
        """
        settings = self.settings
        walk = np.diag(np.radians([settings.offset_walk, settings.heading_walk]) ** 2)
        covariance = state.covariance + walk * interval
        noise = np.radians(settings.solved) ** 2 * settings.solved_time / interval  # as of independent frames
        toward = (covariance @ facing[..., None])[..., 0]
        gain = toward / ((toward * facing).sum(axis=-1) + noise)[..., None] * seen[..., None]
        missed = _wrapped(more - (facing * state.error).sum(axis=-1))
        return state.error + gain * missed[..., None], covariance - gain[..., None] * toward[..., None, :]


def _wrapped(angle: np.ndarray) -> np.ndarray:
    """Return angles in −π to π."""
    return (angle + np.pi) % (2 * np.pi) - np.pi
