"""Tracking by a headset and two hand-held controllers: three points with orientation (UNOC, section 5.2).

Also the headset alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_canonical, quaternion_multiply, quaternion_rotate
from bodysense.errors import BodysenseError
from bodysense.observation import EXACT_ACCURACY, UNIT_TOLERANCE, Observation, accuracy_like

POINTS = ("head", "left_wrist", "right_wrist")


@dataclass(frozen=True)
class ThreePoint:
    """A headset and two controllers, rigidly held.

    A controller's frame is its wrist's, shifted and turned by a constant grip. The grip is the left hand's; the right
    hand's is its mirror image. Zero by default: the points are then head and wrists themselves. Estimators treat them
    as wrists in both cases, so a grip represents a device with an uncorrected offset.
    """

    grip_position: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, of the controller in the left wrist's frame
    grip_rotation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)  # wxyz, left wrist ← controller
    hands: bool = True  # False: the headset alone; the hands are points that are always hidden

    def __post_init__(self) -> None:
        length = float(np.linalg.norm(self.grip_rotation))
        if not abs(length - 1) < UNIT_TOLERANCE:
            raise BodysenseError(f"grip_rotation has length {length:g}; give a unit quaternion w, x, y, z")
        if not np.isfinite(self.grip_position).all():
            raise BodysenseError(f"grip_position {self.grip_position} is not finite; give metres")


def observe(pose: Pose, time: np.ndarray, device: ThreePoint = ThreePoint()) -> Observation:
    """The three points of a motion (..., T) at `time` (T,) s: positions (m) and rotations, hidden by `hands` only.

    Raises BodysenseError for a skeleton without head or wrists.
    """
    places = pose.skeleton.indices(POINTS)
    position, rotation = (values[..., places, :] for values in forward_kinematics(pose))
    shift, turn = np.array([np.zeros(3), device.grip_position, device.grip_position]), np.zeros((3, 4))
    turn[0, 0], turn[1:] = 1, device.grip_rotation
    # Mirroring flips the x of an offset, and the sense of a rotation about every axis but x.
    shift[2] *= [-1, 1, 1]
    turn[2] *= [1, 1, -1, -1]
    seen = np.broadcast_to([True, device.hands, device.hands], position.shape[:-1])
    position = position + quaternion_rotate(rotation, np.broadcast_to(shift, position.shape))
    return Observation(
        points=POINTS,
        position=np.where(seen[..., None], position, np.nan),
        rotation=np.where(seen[..., None], quaternion_canonical(quaternion_multiply(rotation, turn)), np.nan),
        has_position=seen.copy(),
        has_rotation=seen.copy(),
        accuracy=accuracy_like(seen, EXACT_ACCURACY),
        time=np.asarray(time, dtype=float),
    )
