"""Two-bone inverse kinematics: arms bend so that hands reach their targets, legs so that feet do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
)

STRAIGHT = 0.9999  # longest stretch of a limb, as a share of the length of both bones
_FLAT = 0.02  # sine of the bend; below it the limb counts as straight
# Axis of the middle joint about which a limb flexes, in the T-pose.
_HINGES = {"knee": (1.0, 0.0, 0.0), "left_elbow": (0.0, -1.0, 0.0), "right_elbow": (0.0, 1.0, 0.0)}


def reach(pose: Pose, end: str, target: np.ndarray) -> Pose:
    """Bend a limb so that its wrist or ankle `end` is at `target` (..., 3) m, world, or as near as possible.

    The limb bends in its plane; a straight limb bends about the hinge of its elbow or knee. The hand or foot keeps its
    world rotation. Return the pose (...).
    """
    return reach_all(pose, {end: target})


def reach_all(
    pose: Pose, targets: Mapping[str, np.ndarray], placed: tuple[np.ndarray, np.ndarray] | None = None
) -> Pose:
    """Bend several limbs like `reach`; `targets` are by wrist or ankle.

    `placed` is `forward_kinematics` of the pose, if it is known.
    """
    skeleton, rotation = pose.skeleton, np.array(pose.rotation)
    position, world = (np.asarray(part) for part in placed or forward_kinematics(pose))
    for end, target in targets.items():
        tip = skeleton.index(end)
        middle = skeleton.parents[tip]
        first = skeleton.parents[middle]
        upper = position[..., middle, :] - position[..., first, :]
        lower = position[..., tip, :] - position[..., middle, :]
        a, b = np.linalg.norm(upper, axis=-1), np.linalg.norm(lower, axis=-1)
        way = target - position[..., first, :]
        distance = np.clip(np.linalg.norm(way, axis=-1), np.abs(a - b) + 1e-6, STRAIGHT * (a + b))
        wanted = np.arccos(np.clip((distance**2 - a**2 - b**2) / (2 * a * b), -1, 1))
        hinge = np.array(_HINGES.get(skeleton.joints[middle], _HINGES["knee"]))  # flexes the elbow or knee
        axis, bend = _plane(upper, lower, quaternion_rotate(world[..., middle, :], np.broadcast_to(hinge, upper.shape)))
        flexed = quaternion_exp((wanted - bend)[..., None] * axis)
        swung = shortest_arc(upper + quaternion_rotate(flexed, lower), way)
        above = quaternion_multiply(swung, world[..., first, :])
        below = quaternion_multiply(swung, quaternion_multiply(flexed, world[..., middle, :]))
        parent = world[..., skeleton.parents[first], :]
        chain = ((first, parent, above), (middle, above, below), (tip, below, world[..., tip, :]))
        for joint, base, turned in chain:
            rotation[..., joint, :] = quaternion_canonical(quaternion_multiply(quaternion_conjugate(base), turned))
    return Pose(skeleton, pose.root_position, rotation)


def _plane(upper: np.ndarray, lower: np.ndarray, hinge: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the axis (..., 3) about which a limb bends, and its angle (...) in radians; 0 for a straight limb."""
    normal = np.cross(upper, lower)
    size = np.linalg.norm(normal, axis=-1)
    along = (upper * lower).sum(axis=-1)
    flat = size < _FLAT * np.hypot(size, along)
    axis = np.where(flat[..., None], hinge, normal / np.maximum(size, 1e-12)[..., None])
    return axis, np.where(flat, 0.0, np.arctan2(size, along))
