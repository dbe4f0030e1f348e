"""A motion's own joints beside ours: which is which, and how each is turned against ours.

In the world a joint of the motion is turned as ours is, after one constant turn: T-poses differ, joints do not. So what
was estimated on our joints can be said in the motion's own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import normalize, quaternion_conjugate, quaternion_multiply
from bodysense.body.skeleton import Skeleton, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.bvh_stream import BvhLines
from bodysense.io.rigs.rigged import Rigged


@dataclass(frozen=True, eq=False)
class SourceJoints:
    """The joints of a motion, parents before children."""

    joints: tuple[str, ...]
    parents: tuple[int, ...]  # -1 for the root
    ours: Mapping[str, int]  # our joint → its index here
    sites: Mapping[str, int]  # our end site, where the motion has it → the joint that it hangs on here
    turn: Mapping[str, np.ndarray]  # by our joint (4,): this rig's world rotation is up⁻¹ · ours · turn
    up: np.ndarray  # (4,) rotation of our world ← the motion's

    def above(self, joint: int) -> list[int]:
        """A joint and those above it, up to the root."""
        chain = [joint]
        while self.parents[chain[-1]] >= 0:
            chain.append(self.parents[chain[-1]])
        return chain

    @cached_property
    def trunk(self) -> list[int]:
        """The lowest joint on which the whole body hangs, and those above it, up to the root."""
        shared = set.intersection(*(set(self.above(joint)) for joint in self.ours.values()))
        return sorted(shared, reverse=True)

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
        for site, joint in self.sites.items():
            has_position[:, skeleton.index(site)] = turned[:, joint]
        return has_position, has_rotation


def own_joints(skeleton: Skeleton, lacking: Sequence[str] = ()) -> SourceJoints:
    """Return the joints of a motion on our skeleton, without those that it is `lacking`."""
    count, unturned = len(skeleton.joints), np.array([1.0, 0.0, 0.0, 0.0])
    ours = {name: k for k, name in enumerate(skeleton.joints) if name not in lacking}
    ends = ((name, skeleton.parents[k]) for k, name in enumerate(skeleton.points) if k >= count)
    sites = {name: joint for name, joint in ends if skeleton.joints[joint] in ours}
    turn = dict.fromkeys(skeleton.joints, unturned)
    return SourceJoints(skeleton.joints, skeleton.parents[:count], ours, sites, turn, unturned)


def joints_of_file(file: BvhLines, rigged: Rigged) -> SourceJoints:
    """The joints of a file, from what was read of it."""
    figure, rig, pose = rigged.figure, rigged.rig, rigged.clip.pose
    place = {node: joint for joint, node in enumerate(file.nodes)}
    index = {name: point for point, name in enumerate(figure.points)}
    ours, sites, turn = {}, {}, {}
    rotation = np.asarray(forward_kinematics(pose)[1])
    world = rig.turned_to_world(world_rotation(file.rotation, file.parents))
    for name, given in rig.joints.items():
        point = index[given]
        if name in pose.skeleton.end_sites or figure.nodes[point] not in place:  # an end site cannot turn
            sites[name] = place[figure.nodes[figure.parents[point]]]
            continue
        joint = ours[name] = place[figure.nodes[point]]
        mine = rotation[:, pose.skeleton.index(name)]
        turn[name] = mean_rotation(np.asarray(quaternion_multiply(quaternion_conjugate(mine), world[:, joint])))
    flat = any(figure.parents[k] > 0 and file.parents[place[figure.nodes[k]]] <= 0 for k in range(len(figure.joints)))
    if flat or (not figure.turns and len(figure.position) > 1):
        raise BodysenseError(
            f"{file.path}: its joints do not hang on one another, or do not turn, so that no other motion fits it; "
            f"write it anew: bodysense.write('hung.bvh', bodysense.read('{file.path.name}'))"
        )
    return SourceJoints(file.joints, file.parents, ours, sites, turn, rig.turn)


def world_rotation(rotation: np.ndarray, parents: Sequence[int]) -> np.ndarray:
    """World rotations (T, J, 4) of joints, parents first, from local ones."""
    world = np.array(rotation)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            world[:, joint] = quaternion_multiply(world[:, parent], rotation[:, joint])
    return world


def mean_rotation(rotation: np.ndarray) -> np.ndarray:
    """Return the mean (..., 4) of rotations (T, ..., 4) that differ little."""
    sign = np.where((rotation * rotation[:1]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    return np.asarray(normalize((sign * rotation).sum(axis=0)))
