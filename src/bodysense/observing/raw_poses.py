"""Conversion of raw poses of a headset and its controllers to joints of the body.

In WebXR and OpenXR a headset looks along −Z, with +Y up. A grip's −Z points to the thumb's end of a held rod, and its
+X out of the back of a right hand (WebXR device API, `gripSpace`). Our joints have the identity in the T-pose, which
faces +Z, with the left hand toward +X and palms down.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from bodysense.body.skeleton import Skeleton, default_body, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    matrix_to_quaternion,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.observing.observation import RAW_POINTS, Observation

# Axes of each device, as columns, while the body is in the T-pose.
AXES = {
    "headset": [[-1.0, 0, 0], [0, 1, 0], [0, 0, -1]],
    "left_controller": [[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]],
    "right_controller": [[0.0, 1, 0], [1, 0, 0], [0, 0, -1]],
}
# The joint that carries each device, and the landmark of the joint at which the device is.
_CARRIED = {
    "headset": ("head", "between_eyes"),
    "left_controller": ("left_wrist", "left_palm"),
    "right_controller": ("right_wrist", "right_palm"),
}


def with_joints(observation: Observation, skeleton: Skeleton) -> Observation:
    """Convert raw points of an observation to the joints that carry the devices; other points are unchanged.

    Args:
        observation: points (..., T, P), some of which may be `RAW_POINTS`.
        skeleton: the wearer's skeleton; its height scales the distance of joints from devices. Without a known rotation
            the joint gets the position of the device.

    Raises BodysenseError if the joint of a raw point is tracked, too.
    """
    raw = [k for k, name in enumerate(observation.points) if name in RAW_POINTS]
    points = tuple(_CARRIED[name][0] if name in _CARRIED else name for name in observation.points)
    for k in raw:
        if points.count(points[k]) > 1:
            raise BodysenseError(
                f"observation: {observation.points[k]!r} and {points[k]!r} are the same point; give one of them"
            )
    turn, shift = (np.stack(part) for part in zip(*(_mount(observation.points[k]) for k in raw), strict=True))
    shift = shift * skeleton.extent / default_skeleton().extent
    position, rotation = observation.position.copy(), observation.rotation.copy()
    turned = quaternion_multiply(rotation[..., raw, :], np.broadcast_to(turn, rotation[..., raw, :].shape))
    rotation[..., raw, :] = quaternion_canonical(turned)
    moved = quaternion_rotate(turned, np.broadcast_to(shift, position[..., raw, :].shape))
    position[..., raw, :] += np.where(observation.has_rotation[..., raw, None], moved, 0.0)
    return replace(observation, points=points, position=position, rotation=rotation)


@lru_cache(maxsize=len(AXES))
def _mount(name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the rotation (4,) device ← joint, and the offset (3,) m of the joint from the device in its own axes."""
    _, landmark = _CARRIED[name]
    offset = next(np.array(row["offset"]) for row in default_body()["landmarks"] if row["name"] == landmark)
    return quaternion_conjugate(matrix_to_quaternion(np.array(AXES[name]))), -offset
