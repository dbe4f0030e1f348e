"""Poses: position of the root and rotations of all joints; forward kinematics."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from array_api_compat import device

from bodysense.body.skeleton import Skeleton, chain_to_root
from bodysense.errors import expect
from bodysense.files import load_library
from bodysense.geometry.rotation import (
    Array,
    array_namespace,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)

_Pointer = ctypes.c_void_p


@dataclass(frozen=True, eq=False)
class Pose:
    """A posed skeleton, or many of them along leading batch axes; time is the last batch axis."""

    skeleton: Skeleton
    root_position: Array  # (..., 3) m, world
    rotation: Array  # (..., J, 4) wxyz, parent ← joint; the root's is world ← root

    def __repr__(self) -> str:
        return f"Pose({self.rotation.shape[:-2]}, {self.skeleton!r})"

    def __getitem__(self, key: Any) -> Pose:
        """Index the leading axes: `pose[10]`, `pose[5:20]`."""
        return Pose(self.skeleton, self.root_position[key], self.rotation[key])


def forward_kinematics(pose: Pose, rest_offset: Array | None = None) -> tuple[Array, Array]:
    """Return world positions (..., P, 3) of all points and world rotations (..., J, 4) of all joints of a pose.

    `rest_offset` (..., P, 3) replaces the skeleton's own, so that bodies of different sizes can share a batch. Works on
    NumPy arrays and, differentiably, on PyTorch tensors. Bone lengths are kept exactly.
    """
    expect(pose, Pose, "forward_kinematics", "a Pose")
    skeleton = pose.skeleton
    if isinstance(pose.rotation, np.ndarray) and rest_offset is None and pose.rotation.dtype == np.float64:
        return _kinematics_of_frames(pose)
    xp = array_namespace(pose.rotation)
    joint_levels = []
    for joints, places in skeleton.levels:
        local = pose.rotation[..., joints, :]
        joint_levels.append(quaternion_multiply(joint_levels[-1][..., places, :], local) if joint_levels else local)
    order = np.argsort(np.concatenate([joints for joints, _ in skeleton.levels]))
    rotation = xp.concat(joint_levels, axis=-2)[..., order, :]

    if rest_offset is None:
        rest_offset = skeleton.rest_offset
    offset = as_like(rest_offset, pose.rotation)
    bone = quaternion_rotate(rotation[..., list(skeleton.parents[1:]), :], offset[..., 1:, :])
    path = as_like(np.ascontiguousarray(skeleton.path[:, 1:]), pose.rotation)
    return pose.root_position[..., None, :] + xp.matmul(path, bone), rotation


def _kinematics_of_frames(pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    skeleton = pose.skeleton
    return tree_kinematics(skeleton.parents, skeleton.rest_offset, pose.root_position, pose.rotation)


def tree_kinematics(
    parents: Sequence[int], offset: np.ndarray, root: np.ndarray, rotation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (..., P, 3) and rotations (..., J, 4) of frames of any tree; each is independent of the others.

    Args:
        parents: of the P points, joints before end sites and parents before children; the first point is the root.
        offset: (P, 3) from the parent; the root's is not used.
        root: (..., 3) positions of the root.
        rotation: (..., J, 4) wxyz, parent ← joint.
    """
    points, (*shape, joints, _) = len(parents), rotation.shape
    if rotation.shape != (*shape, joints, 4) or joints > points or offset.shape != (points, 3):
        raise ValueError(f"rotations {rotation.shape} and offsets {offset.shape} are not those of {points} points")
    rotation, offset = np.ascontiguousarray(rotation, np.float64), np.ascontiguousarray(offset, np.float64)
    root = np.ascontiguousarray(np.broadcast_to(root, (*shape, 3)), np.float64)
    position, world = np.empty((*shape, points, 3)), np.empty((*shape, joints, 4))
    above = np.array(parents, np.int32)
    tree = _Tree(joints, points, above.ctypes.data, offset.ctypes.data)
    arrays = (values.ctypes.data for values in (root, rotation, position, world))
    _core().bs_place_frames(ctypes.byref(tree), root.size // 3, *arrays)
    return position, world


class _Tree(ctypes.Structure):
    """`bs_tree`."""

    _fields_ = [("joints", ctypes.c_int32), ("points", ctypes.c_int32), ("parent", _Pointer), ("rest_offset", _Pointer)]


@lru_cache(maxsize=1)
def _core() -> ctypes.CDLL:
    """Return the compiled core, whose function for many frames is not part of `bodysense.h`."""
    loaded = load_library("_core")
    loaded.bs_place_frames.restype = None
    loaded.bs_place_frames.argtypes = [ctypes.POINTER(_Tree), ctypes.c_size_t, *[_Pointer] * 4]
    return loaded


def world_rotation(pose: Pose, joint: int) -> Array:
    """Return the world rotation (..., 4) of one joint of a pose, by its index: that of `forward_kinematics`."""
    chain = chain_to_root(pose.skeleton.parents, joint)
    rotation = pose.rotation[..., chain.pop(), :]
    while chain:
        rotation = quaternion_multiply(rotation, pose.rotation[..., chain.pop(), :])
    return rotation


def local_rotation(skeleton: Skeleton, world_rotation: Array) -> Array:
    """Return parent-relative rotations from world rotations: (..., J, 4) → (..., J, 4)."""
    xp = array_namespace(world_rotation)
    parents = list(skeleton.parents[1 : len(skeleton.joints)])
    child = quaternion_multiply(quaternion_conjugate(world_rotation[..., parents, :]), world_rotation[..., 1:, :])
    return xp.concat([world_rotation[..., :1, :], child], axis=-2)


def rest_pose(skeleton: Skeleton, batch: tuple[int, ...] = ()) -> Pose:
    """Return the T-pose at the skeleton's own root offset, with the given leading axes (NumPy, float64)."""
    rotation = np.zeros((*batch, len(skeleton.joints), 4))
    rotation[..., 0] = 1
    return Pose(skeleton, np.broadcast_to(skeleton.rest_offset[0], (*batch, 3)).copy(), rotation)


def as_like(values: Any, like: Array) -> Array:
    """Convert `values` to an array of the library, dtype and device of `like`."""
    if hasattr(like, "detach"):
        if hasattr(values, "detach"):
            return values.to(like)
        values = np.array(values)  # a copy, because PyTorch cannot share a read-only array
    xp = array_namespace(like)
    return xp.asarray(values, dtype=like.dtype, device=device(like))


def standing_pose(skeleton: Skeleton) -> Pose:
    """Return a standing pose with hanging arms and slightly curled fingers: the prior for an unseen body."""
    pose = rest_pose(skeleton)
    turns = {"shoulder": 1.25, "elbow": 0.1}
    turns |= {f"{finger}{k}": 0.3 for finger in ("index", "middle", "ring", "pinky") for k in (1, 2, 3)}
    about_z = {
        f"{side}_{joint}": sign * angle for joint, angle in turns.items() for side, sign in (("left", -1), ("right", 1))
    }
    known = [joint for joint in about_z if joint in skeleton.joints]
    pose.rotation[skeleton.indices(known)] = quaternion_exp(np.array([[0.0, 0.0, about_z[joint]] for joint in known]))
    return pose
