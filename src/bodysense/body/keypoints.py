"""Key-points of a person in a video: 3-D arms, rotation of the torso, and 2-D hands.

Axes are those of the camera: +x to the picture's right, +y up, +z toward the camera. A person who faces the camera
faces +z, with the left hand toward +x. Left and right are the person's.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from bodysense.body.arms import ARM_JOINTS, ARM_POINTS, HAND_POINTS, SIDES, arm_rotations
from bodysense.body.pose import Pose, forward_kinematics, rest_pose
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    cross,
    dot,
    matrix_to_quaternion,
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
)

_UNIT = 0.01  # largest difference of the length of a direction or quaternion from 1


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera, or a batch of them. Its axes: x to the picture's right, y up, z away from the scene."""

    position: np.ndarray  # (..., 3) m, world
    axes: np.ndarray  # (..., 3, 3) world ← camera: its axes as columns
    focal: np.ndarray  # (...) focal length in heights of the picture
    aspect: np.ndarray  # (...) width / height of the picture


@dataclass(frozen=True, eq=False)
class ArmKeypoints:
    """Arms, torso and hands over time. Values are arbitrary if their mask is False."""

    time: np.ndarray  # (T,) s, increasing
    arm: np.ndarray  # (..., T, 2, 2, 3) unit directions of left and right: upper arm, forearm
    has_arm: np.ndarray  # (..., T, 2) bool: both directions of an arm
    torso: np.ndarray  # (..., T, 4) wxyz, axes above ← torso (`torso_rotation`)
    has_torso: np.ndarray  # (..., T) bool
    hand: np.ndarray  # (..., T, 2, 21, 2) `HAND_POINTS`, pixels / picture height from the picture's centre, y up
    has_hand: np.ndarray  # (..., T, 2) bool

    def __getitem__(self, key: slice) -> ArmKeypoints:
        """Return the frames `key` (a slice) of key-points without batch axes."""
        return ArmKeypoints(**{field.name: getattr(self, field.name)[key] for field in fields(self)})

    def __len__(self) -> int:
        return len(self.time)


def arm_directions(points: np.ndarray) -> np.ndarray:
    """Return unit directions (..., 2, 3) of upper arm and forearm from shoulder, elbow and wrist (..., 3, 3)."""
    return np.asarray(normalize(points[..., 1:, :] - points[..., :-1, :]))


def torso_rotation(shoulders: np.ndarray, hips: np.ndarray) -> np.ndarray:
    """Return the rotation (..., 4) of the torso from left and right shoulder (..., 2, 3) and hip (..., 2, 3).

    Its +y points from the middle of the hips to the middle of the shoulders, its +x from right to left shoulder.
    """
    up = normalize(shoulders.mean(axis=-2) - hips.mean(axis=-2))
    across = shoulders[..., 0, :] - shoulders[..., 1, :]
    across = normalize(across - dot(across, up) * up)
    return np.asarray(matrix_to_quaternion(np.stack([across, up, cross(across, up)], axis=-1)))


def body_torso(pose: Pose) -> np.ndarray:
    """Return the rotation (..., 4) of the torso of a posed body in the world (`torso_rotation`)."""
    position = np.asarray(forward_kinematics(pose)[0])
    shoulders, hips = (
        position[..., pose.skeleton.indices([f"{side}_{name}" for side in SIDES]), :] for name in ("shoulder", "hip")
    )
    return torso_rotation(shoulders, hips)


def arms_from_torso(pose: Pose) -> np.ndarray:
    """Return `arm_rotations` (..., 38, 4) with collars relative to a chest that is at rest in the torso.

    Key-points determine the torso, but not how the chest leans in it.
    """
    rotation = np.array(arm_rotations(pose))
    world = np.asarray(forward_kinematics(pose)[1])
    at_rest = body_torso(rest_pose(pose.skeleton))
    into = quaternion_multiply(at_rest, quaternion_conjugate(body_torso(pose)))
    for side in SIDES:
        place = ARM_JOINTS.index(f"{side}_collar")
        turn = quaternion_multiply(into, world[..., pose.skeleton.index(f"{side}_collar"), :])
        rotation[..., place, :] = quaternion_canonical(turn)
    return rotation


def check_keypoints(keypoints: ArmKeypoints, name: str = "key-points") -> ArmKeypoints:
    """Return the key-points if shapes, masks and times agree; raise BodysenseError, naming the fix, if not."""
    if keypoints.time.ndim != 1:
        raise BodysenseError(f"{name}: time has shape {keypoints.time.shape}; give one number a frame, in seconds")
    frames, batch = len(keypoints.time), keypoints.has_torso.shape[:-1]
    tails = {"arm": (2, len(ARM_POINTS) - 1, 3), "has_arm": (2,), "torso": (4,), "has_torso": ()}
    tails |= {"hand": (2, len(HAND_POINTS), 2), "has_hand": (2,)}
    for field, tail in tails.items():
        shape, wanted = getattr(keypoints, field).shape, (*batch, frames, *tail)
        if shape != wanted:
            raise BodysenseError(f"{name}: {field} has shape {shape}; {frames} frames need {wanted}")
    if not np.isfinite(keypoints.time).all():
        raise BodysenseError(f"{name}: a time is not a number; give seconds, increasing")
    backwards = np.flatnonzero(np.diff(keypoints.time) <= 0)
    if backwards.size:
        k = int(backwards[0]) + 1
        before, after = keypoints.time[k - 1], keypoints.time[k]
        raise BodysenseError(
            f"{name}: time goes from {before:g} s to {after:g} s at frame {k}; sort the frames and drop repeats"
        )
    for mask, field in (("has_arm", "arm"), ("has_torso", "torso"), ("has_hand", "hand")):
        present, values = getattr(keypoints, mask), getattr(keypoints, field)
        axes = tuple(range(present.ndim, values.ndim))
        if (present & ~np.isfinite(values).all(axis=axes)).any():
            raise BodysenseError(f"{name}: {mask} is set where {field} is not finite; clear the mask there")
    for mask, field in (("has_arm", "arm"), ("has_torso", "torso")):
        length = np.linalg.norm(getattr(keypoints, field), axis=-1)
        wrong = np.abs(length - 1) > _UNIT
        if (getattr(keypoints, mask) & (wrong.any(axis=-1) if field == "arm" else wrong)).any():
            raise BodysenseError(f"{name}: {field} has length {length[wrong].flat[0]:g} somewhere; give unit length")
    return keypoints
