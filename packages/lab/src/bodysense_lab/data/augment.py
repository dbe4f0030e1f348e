"""Augmentation of clips in canonical form: mirrored motion and other limb proportions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.io.clip import Clip

# Bones that are scaled together, left and right alike; each is named by the joint or end site at its end.
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
    """Mirror the clip and its body at the plane x = 0; left and right are exchanged."""
    pose, skeleton = clip.pose, clip.pose.skeleton
    partner = skeleton.mirror
    flip = np.array([-1.0, 1.0, 1.0])
    other = skeleton.with_offsets(skeleton.rest_offset[partner] * flip)
    # Mirroring a rotation mirrors its axis and reverses its angle.
    rotation = pose.rotation[..., partner[: len(skeleton.joints)], :] * np.array([1.0, 1.0, -1.0, -1.0])
    return replace(clip, pose=Pose(other, pose.root_position * flip, rotation))


def with_limb_proportions(clip: Clip, spread: float, rng: np.random.Generator) -> Clip:
    """Scale each group of `LIMBS` by its own random factor; rotations are unchanged.

    `spread` is the standard deviation of the factors' logarithm, which is clipped at `SPREAD_LIMIT` standard
    deviations. Adults differ by 0.03 to 0.05 in a limb's share of their height. Left and right remain equal. The
    root's path is scaled with the length of the legs, so that feet stay on the ground and slide little. Hands that
    touched something may no longer do so.
    """
    skeleton = clip.pose.skeleton
    deviation = np.clip(rng.standard_normal(len(LIMBS)), -SPREAD_LIMIT, SPREAD_LIMIT)
    factor = {
        part: scale
        for endings, scale in zip(LIMBS.values(), np.exp(spread * deviation), strict=True)
        for part in endings
    }
    parts = [name.removeprefix("left_").removeprefix("right_") for name in skeleton.points]
    offset = skeleton.rest_offset * np.array([[factor.get(part, 1.0)] for part in parts])
    longer = _leg_length(skeleton.with_offsets(offset)) / _leg_length(skeleton)
    offset[0] = skeleton.rest_offset[0] * longer
    return replace(clip, pose=Pose(skeleton.with_offsets(offset), clip.pose.root_position * longer, clip.pose.rotation))


def _leg_length(skeleton: Skeleton) -> float:
    """Return the height of the pelvis above the lowest point in the rest pose, m."""
    return float(-(skeleton.path @ skeleton.rest_offset)[:, 1].min())
