"""Joints of a scripted body: rotations, positions, and rotations from angles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.skeleton import BODY, default_skeleton

INDEX = {name: k for k, name in enumerate(BODY)}


@dataclass(frozen=True, eq=False)
class Motion:
    """World rotations (T, 22, 3, 3) of the joints of `BODY` and path (T, 3) m of the pelvis."""

    rotation: np.ndarray
    root: np.ndarray


def euler(yaw: np.ndarray, pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Return rotations (T, 3, 3): roll about +Z, then pitch about +X (forward), then yaw about +Y; degrees (T,)."""
    (cy, sy), (cx, sx), (cz, sz) = ((np.cos(a), np.sin(a)) for a in map(np.radians, (yaw, pitch, roll)))
    turned = np.empty((len(cy), 3, 3))
    turned[:, 0, 0], turned[:, 0, 1], turned[:, 0, 2] = cy * cz + sy * sx * sz, -cy * sz + sy * sx * cz, sy * cx
    turned[:, 1, 0], turned[:, 1, 1], turned[:, 1, 2] = cx * sz, cx * cz, -sx
    turned[:, 2, 0], turned[:, 2, 1], turned[:, 2, 2] = -sy * cz + cy * sx * sz, sy * sz + cy * sx * cz, cy * cx
    return turned


def joint_position(motion: Motion, offset: np.ndarray, name: str) -> np.ndarray:
    """Return positions (T, 3) m of a point of the body in a motion."""
    skeleton = default_skeleton()
    place, point = motion.root.copy(), skeleton.index(name)
    while skeleton.parents[point] >= 0:
        place += motion.rotation[:, skeleton.parents[point]] @ offset[point]
        point = skeleton.parents[point]
    return place
