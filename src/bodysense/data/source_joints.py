"""A motion's own joints beside ours: which is which, and how each is turned against ours.

In the world a joint of the motion is turned as ours is, after one constant turn: T-poses differ, joints do not. So what
was estimated on our joints can be said in the motion's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import normalize, quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.data.bvh_file import BvhFile
from bodysense.data.clip import Clip


@dataclass(frozen=True, eq=False)
class SourceJoints:
    """The joints of a motion, parents before children."""

    joints: tuple[str, ...]
    parents: tuple[int, ...]  # -1 for the root
    ours: Mapping[str, int]  # our joint → its index here
    sites: tuple[str, ...]  # our end sites that the motion has
    turn: Mapping[str, np.ndarray]  # by our joint (4,): this rig's world rotation is up⁻¹ · ours · turn
    up: np.ndarray  # (4,) rotation of our world ← the motion's

    def world(self, pose: Pose) -> np.ndarray:
        """World rotations (T, J, 4) that a pose of ours gives these joints; NaN for those that we do not have."""
        rotation = np.asarray(forward_kinematics(pose)[1])
        world = np.full((*rotation.shape[:-2], len(self.joints), 4), np.nan)
        back = quaternion_conjugate(self.up)
        for name, joint in self.ours.items():
            turned = quaternion_multiply(rotation[..., pose.skeleton.index(name), :], self.turn[name])
            world[..., joint, :] = quaternion_multiply(np.broadcast_to(back, turned.shape), turned)
        return world

    def ours_world(self, rotation: np.ndarray) -> dict[str, np.ndarray]:
        """World rotations (T, 4) of our joints, by name, that local ones (T, J, 4) of these joints give."""
        world = world_rotation(rotation, self.parents)
        found = {}
        for name, joint in self.ours.items():
            turned = quaternion_multiply(np.broadcast_to(self.up, world[:, joint].shape), world[:, joint])
            found[name] = np.asarray(quaternion_multiply(turned, quaternion_conjugate(self.turn[name])))
        return found

    def seen(self, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which of our points (T, 65) have a place in the world, and which joints (T, 52) a rotation.

        `known` (T, J) are the joints whose own turn is known. A joint has a place where all above it are known, and a
        rotation where it is known too. What the motion does not have is never seen.
        """
        turned = known.copy()
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                turned[:, joint] &= turned[:, parent]
        skeleton = default_skeleton()
        has_position = np.zeros((len(known), len(skeleton.points)), dtype=bool)
        has_rotation = np.zeros((len(known), len(skeleton.joints)), dtype=bool)
        for name, joint in self.ours.items():
            parent, place = self.parents[joint], skeleton.index(name)
            has_position[:, place] = True if parent < 0 else turned[:, parent]
            has_rotation[:, place] = turned[:, joint]
        for site in self.sites:
            place = skeleton.index(site)
            has_position[:, place] = has_rotation[:, skeleton.parents[place]]
        return has_position, has_rotation


def own_joints(skeleton: Skeleton) -> SourceJoints:
    """The rig of a motion that is on our joints."""
    joints, unturned = skeleton.joints, np.array([1.0, 0.0, 0.0, 0.0])
    ours = {name: k for k, name in enumerate(joints)}
    turn = dict.fromkeys(joints, unturned)
    return SourceJoints(joints, skeleton.parents[: len(joints)], ours, skeleton.end_sites, turn, unturned)


def source_joints_of(
    file: BvhFile, clip: Clip, ours: Mapping[str, int], sites: tuple[str, ...], up: np.ndarray
) -> SourceJoints:
    """The rig of a file, from what was read of it.

    Args:
        file: the file.
        clip: its motion on our joints.
        ours: our joint → the file's.
        sites: our end sites that the file has.
        up: (4,) rotation of our world ← the file's.
    """
    rotation = np.asarray(forward_kinematics(clip.pose)[1])
    world = world_rotation(file.rotation, file.parents)
    turn = {}
    for name, joint in ours.items():
        theirs = quaternion_multiply(np.broadcast_to(up, world[:, joint].shape), world[:, joint])
        mine = rotation[:, clip.pose.skeleton.index(name)]
        turn[name] = _mean(np.asarray(quaternion_multiply(quaternion_conjugate(mine), theirs)))
    return SourceJoints(file.joints, file.parents, dict(ours), sites, turn, up)


def world_rotation(rotation: np.ndarray, parents: Sequence[int]) -> np.ndarray:
    """World rotations (T, J, 4) of joints, parents first, from local ones."""
    world = np.array(rotation)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            world[:, joint] = quaternion_multiply(world[:, parent], rotation[:, joint])
    return world


def _mean(rotation: np.ndarray) -> np.ndarray:
    """The mean of rotations (T, 4) that differ little."""
    sign = np.sign(rotation @ rotation[0])[:, None]
    return np.asarray(normalize((np.where(sign == 0, 1, sign) * rotation).sum(axis=0)))
