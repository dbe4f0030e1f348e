"""Retargeting: the same motion on a body of other proportions, its feet as high above the floor as they were."""

from __future__ import annotations

from array_api_compat import array_namespace

from bodysense.body.pose import Pose, as_like, forward_kinematics
from bodysense.body.rotation import Array
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError

SOLE_POINTS = tuple(f"{side}_{name}" for side in ("left", "right") for name in ("ankle", "foot", "toe"))


def retargeted(clip_pose: Pose, skeleton: Skeleton) -> Pose:
    """The same motion on another skeleton of the same tree.

    Rotations are kept, the root's path is scaled with the length of the legs, and every frame is then moved
    vertically, so that the lowest sole has its clearance (`sole_clearance`) at that scale.

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


def sole_clearance(position: Array, skeleton: Skeleton) -> Array:
    """Height (...) m of the lowest sole above the floor y = 0, from points (..., P, 3) m of a body; below it negative.

    A sole is as high as the lowest of ankle, ball and toe tip, each measured from its height in the rest pose with the
    soles on the floor.
    """
    xp = array_namespace(position)
    soles = skeleton.indices(SOLE_POINTS)
    resting = skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[soles, 1]
    height = position[..., 1][..., list(soles)] - as_like(resting, position)
    return xp.min(height, axis=-1)


def leg_length(skeleton: Skeleton) -> float:
    """Length of thigh and shin, mean of the two sides, metres."""
    bones = skeleton.indices([f"{side}_{name}" for side in ("left", "right") for name in ("knee", "ankle")])
    return float(skeleton.bone_length[bones].sum() / 2)
