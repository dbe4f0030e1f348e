"""Inverse kinematics of limbs of two bones, and poses from world rotations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import BODY, default_skeleton
from bodysense.geometry.rotation import quaternion_conjugate, quaternion_multiply


@dataclass(frozen=True)
class BonePair:
    """Two bones and the hinge between them."""

    first: int  # the joint that carries the upper bone
    second: int  # the joint that carries the lower bone
    end: int  # the joint at the end of the lower bone
    upper: np.ndarray  # (3,) m, from the first to the second joint in the rest pose
    lower: np.ndarray  # (3,) m, from the second to the end joint in the rest pose
    hinge: np.ndarray  # (3,) axis about which the lower bone bends

    @property
    def front(self) -> np.ndarray:
        """Direction (3,) in which the middle joint moves when the limb bends, in the rest pose."""
        return np.cross(self.upper, self.hinge) / np.linalg.norm(self.upper)


def limb_of(kind: str, side: str, offset: np.ndarray) -> BonePair:
    """Return a leg or an arm of a body with rest offsets (65, 3) m."""
    names = ("hip", "knee", "ankle") if kind == "leg" else ("shoulder", "elbow", "wrist")
    first, second, end = (BODY.index(f"{side}_{name}") for name in names)
    upper, lower = offset[default_skeleton().indices([BODY[second], BODY[end]])]
    # Knees bend about the axis to the left, elbows about one that is tilted by 30°.
    hinge = np.array([1.0, 0, 0] if kind == "leg" else [0.0, -0.87, 0.5] if side == "left" else [0.0, 0.87, -0.5])
    return BonePair(first, second, end, upper, lower, hinge)


def bend_limb(limb: BonePair, start: np.ndarray, end: np.ndarray, pole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return rotations (T, 3, 3) of both bones of a limb from `start` to `end` (T, 3) m.

    The middle joint is on the side of the direction `pole` (T, 3).
    """
    upper, lower = float(np.linalg.norm(limb.upper)), float(np.linalg.norm(limb.lower))
    way = end - start
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    along = way / np.maximum(length, 1e-6)
    length = np.clip(length, abs(upper - lower) + 0.02, 0.999 * (upper + lower))
    across = pole - (pole * along).sum(axis=-1, keepdims=True) * along
    across = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-6)
    near = (upper**2 - lower**2 + length**2) / (2 * length)
    high = np.sqrt(np.maximum(upper**2 - near**2, 0.0))
    first = (near * along + high * across) / upper
    second = ((length - near) * along - high * across) / lower
    axis = np.cross(across, along)
    return _turning(limb.upper, limb.hinge, first, axis), _turning(limb.lower, limb.hinge, second, axis)


def _turning(bone: np.ndarray, hinge: np.ndarray, direction: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Return rotations (T, 3, 3) that turn a bone and its hinge in the rest pose to a direction and a normal axis."""
    bone = bone / np.linalg.norm(bone)
    hinge = hinge - (hinge @ bone) * bone
    hinge = hinge / np.linalg.norm(hinge)
    rest = np.stack([bone, hinge, np.cross(bone, hinge)], axis=-1)
    return np.stack([direction, axis, np.cross(direction, axis)], axis=-1) @ rest.T


def hips_of(pelvis: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return both hips (T, 2, 3) m relative to the pelvis, for its rotations `pelvis` (T, 3, 3)."""
    places = default_skeleton().indices(["left_hip", "right_hip"])
    return np.einsum("tij,kj->tki", pelvis, offset[places])


def with_changed_body(pose: Pose, change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> Pose:
    """Return the pose (T,) with other world rotations of the body and another path of its root.

    `change` maps world rotations (T, 22, 4) of `BODY` and the root's path (T, 3) m to new ones. Local rotations of
    fingers are unchanged.
    """
    joints = len(BODY)
    world, root = change(np.asarray(forward_kinematics(pose)[1])[:, :joints], np.asarray(pose.root_position))
    local = np.array(pose.rotation, dtype=float)
    local[:, 0] = world[:, 0]
    parents = list(pose.skeleton.parents[1:joints])
    local[:, 1:joints] = quaternion_multiply(quaternion_conjugate(world[:, parents]), world[:, 1:])
    return Pose(pose.skeleton, root, local)
