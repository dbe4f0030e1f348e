"""Retargeting: a motion on a body of other proportions, with the feet's heights above the floor preserved."""

from __future__ import annotations

import numpy as np

from bodysense.body.footing import sole_clearance
from bodysense.body.pose import Pose, as_like, forward_kinematics
from bodysense.body.reach import reach
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError


def retarget(clip_pose: Pose, skeleton: Skeleton) -> Pose:
    """Transfer a motion to another skeleton of the same tree.

    Rotations are unchanged. The root's path is scaled with the length of the legs. Then every frame is moved
    vertically, so that the clearance of the lowest sole (`sole_clearance`) is that of the source at this scale.

    Args:
        clip_pose: poses (..., T), world, with y = 0 as the floor.
        skeleton: the other body; its root offset puts its soles on the floor in the rest pose.

    Returns:
        Poses (..., T) of `skeleton`.

    Raises BodysenseError for a skeleton of another tree.
    """
    source = clip_pose.skeleton
    if (skeleton.points, skeleton.parents) != (source.points, source.parents):
        raise BodysenseError("retargeting keeps every rotation, but the two skeletons differ in names or parents")
    if (skeleton.rest_offset == source.rest_offset).all():
        return Pose(skeleton, clip_pose.root_position, clip_pose.rotation)
    scale = leg_length(skeleton) / leg_length(source)
    wanted = scale * sole_clearance(forward_kinematics(clip_pose)[0], source)
    moved = Pose(skeleton, clip_pose.root_position * scale, clip_pose.rotation)
    rise = wanted - sole_clearance(forward_kinematics(moved)[0], skeleton)
    return Pose(skeleton, moved.root_position + rise[..., None] * as_like([0.0, 1.0, 0.0], rise), clip_pose.rotation)


def transfer_motion(pose: Pose, skeleton: Skeleton) -> Pose:
    """Transfer a motion to another body of the same tree, with feet on the floor and hands in place.

    The world is scaled with the length of the legs. In the scaled world ankles and wrists keep their positions, as far
    as legs and arms reach, so hands that touched still touch. Feet and hands keep their rotations.

    Args:
        pose: poses (..., T), NumPy.
        skeleton: the other body.
    """
    scale = leg_length(skeleton) / leg_length(pose.skeleton)
    place = scale * forward_kinematics(pose)[0]
    moved = retarget(pose, skeleton)
    # The height of an ankle above the floor follows from the foot, not from the legs.
    thicker = _ankle_height(skeleton) - scale * _ankle_height(pose.skeleton)
    for part, rise in (("ankle", thicker), ("wrist", 0.0)):
        for end in (f"left_{part}", f"right_{part}"):
            target = place[..., skeleton.index(end), :] + np.array([0.0, rise, 0.0])
            moved = reach(moved, end, target)
    return moved


def _ankle_height(skeleton: Skeleton) -> float:
    """Return the height of the ankles over the floor in the rest pose, metres."""
    height = skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[:, 1]
    return float(height[skeleton.indices(["left_ankle", "right_ankle"])].mean())


def leg_length(skeleton: Skeleton) -> float:
    """Return the length of thigh and shin, mean of the two sides, metres."""
    bones = skeleton.indices([f"{side}_{name}" for side in ("left", "right") for name in ("knee", "ankle")])
    return float(skeleton.bone_length[bones].sum() / 2)
