"""Limbs of two bones: where they begin, how they turn to reach a place, and the pose of turns in the world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import BODY, default_skeleton


@dataclass(frozen=True)
class BonePair:
    """Two bones, and the hinge between them."""

    first: int  # the joint that carries the upper bone
    second: int
    end: int
    upper: np.ndarray  # (3,) m, from the first to the second at rest
    lower: np.ndarray  # (3,) m
    hinge: np.ndarray  # (3,) about which the lower bone bends

    @property
    def front(self) -> np.ndarray:
        """(3,) toward where the middle joint goes when the limb bends, at rest."""
        return np.cross(self.upper, self.hinge) / np.linalg.norm(self.upper)


def limb_of(kind: str, side: str, offset: np.ndarray) -> BonePair:
    """A leg or an arm of a body with offsets (65, 3)."""
    names = ("hip", "knee", "ankle") if kind == "leg" else ("shoulder", "elbow", "wrist")
    first, second, end = (BODY.index(f"{side}_{name}") for name in names)
    upper, lower = offset[default_skeleton().indices([BODY[second], BODY[end]])]
    # Knees bend about the axis to the left, elbows about one that is tilted by 30°.
    hinge = np.array([1.0, 0, 0] if kind == "leg" else [0.0, -0.87, 0.5] if side == "left" else [0.0, 0.87, -0.5])
    return BonePair(first, second, end, upper, lower, hinge)


def bend_limb(limb: BonePair, start: np.ndarray, end: np.ndarray, pole: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turns (T, 3, 3) of both bones of a limb from `start` to `end` (T, 3), the middle joint toward the `pole`."""
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
    """Turns (T, 3, 3) that take a bone and its hinge at rest to a direction and an axis at right angles to it."""
    bone = bone / np.linalg.norm(bone)
    hinge = hinge - (hinge @ bone) * bone
    hinge = hinge / np.linalg.norm(hinge)
    rest = np.stack([bone, hinge, np.cross(bone, hinge)], axis=-1)
    return np.stack([direction, axis, np.cross(direction, axis)], axis=-1) @ rest.T


def hips_of(pelvis: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """(T, 2, 3) m: both hips from the pelvis, whose turn (T, 3, 3) is given."""
    places = default_skeleton().indices(["left_hip", "right_hip"])
    return np.einsum("tij,kj->tki", pelvis, offset[places])


def with_changed_body(pose: Pose, change: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]) -> Pose:
    """Return the pose (T,) with changed world rotations (T, 22, 4) of `BODY` and another path (T, 3) m of its root.

    `change` gives both for those of the pose. Fingers keep their local rotations.
    """
    joints = len(BODY)
    world, root = change(np.asarray(forward_kinematics(pose)[1])[:, :joints], np.asarray(pose.root_position))
    local = np.array(pose.rotation, dtype=float)
    local[:, 0] = world[:, 0]
    parents = list(pose.skeleton.parents[1:joints])
    local[:, 1:joints] = quaternion_multiply(quaternion_conjugate(world[:, parents]), world[:, 1:])
    return Pose(pose.skeleton, root, local)
