"""Augmentation: other body shapes and directions from the same motion, on clips in canonical form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.io.clip import Clip

# Bones that grow together, left and right alike, by the joint or end site that ends the bone.
LIMBS = {
    "hips": ("hip",),
    "legs": ("knee", "ankle"),
    "feet": ("foot", "toe"),
    "trunk": ("spine1", "spine2", "spine3"),
    "head": ("neck", "head", "head_top"),
    "shoulders": ("collar", "shoulder"),
    "arms": ("elbow", "wrist"),
    "hands": tuple(f"{f}{k}" for f in ("thumb", "index", "middle", "ring", "pinky") for k in ("1", "2", "3", "_tip")),
}
SPREAD_LIMIT = 2.5  # standard deviations


def mirrored(clip: Clip) -> Clip:
    """Mirror the clip at the plane x = 0: left and right are exchanged, on the mirrored body."""
    pose, skeleton = clip.pose, clip.pose.skeleton
    partner = skeleton.mirror
    flip = np.array([-1.0, 1.0, 1.0])
    other = skeleton.with_offsets(skeleton.rest_offset[partner] * flip)
    # A rotation in a mirror: its axis is mirrored, its sense reversed.
    rotation = pose.rotation[..., partner[: len(skeleton.joints)], :] * np.array([1.0, 1.0, -1.0, -1.0])
    return replace(clip, pose=Pose(other, pose.root_position * flip, rotation))


def with_limb_proportions(clip: Clip, spread: float, rng: np.random.Generator) -> Clip:
    """Scale each group of `LIMBS` by a random factor of its own; rotations are unchanged.

    `spread` is the standard deviation of the factors' logarithm, cut at `SPREAD_LIMIT` of it (0.03 to 0.05 is how
    adults differ in a limb's share of their height). Left and right stay alike. The root's path is scaled with the
    length of the legs, so that feet stay on the ground and slide little; hands that touched something may leave it.
    """
    skeleton = clip.pose.skeleton
    deviation = np.clip(rng.standard_normal(len(LIMBS)), -SPREAD_LIMIT, SPREAD_LIMIT)
    factor = {
        part: scale
        for endings, scale in zip(LIMBS.values(), np.exp(spread * deviation), strict=True)
        for part in endings
    }
    offset = skeleton.rest_offset * np.array([[factor.get(_part(name), 1.0)] for name in skeleton.points])
    longer = _leg_length(skeleton.with_offsets(offset)) / _leg_length(skeleton)
    offset[0] = skeleton.rest_offset[0] * longer
    return replace(clip, pose=Pose(skeleton.with_offsets(offset), clip.pose.root_position * longer, clip.pose.rotation))


def _part(name: str) -> str:
    """A point's name without its side."""
    side, _, rest = name.partition("_")
    return rest if side in ("left", "right") else name


def _leg_length(skeleton: Skeleton) -> float:
    """Return how far the lowest point is below the pelvis in the rest pose, metres."""
    return float(-(skeleton.path @ skeleton.rest_offset)[:, 1].min())
