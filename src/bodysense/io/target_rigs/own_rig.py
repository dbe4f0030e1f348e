"""The own rig of a BVH or FBX file: how its joints are turned against ours, and motions written on it.

In the world a joint of the file is turned as ours is, after one constant turn: T-poses differ, joints do not. So what
was estimated on our joints can be expressed in the file's own: its hierarchy, names, offsets, channel order, unit and
axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, tree_kinematics
from bodysense.body.retarget import transfer_motion
from bodysense.body.skeleton import Skeleton, chain_to_root, default_skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.io.clip import Clip
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.rigged import Rigged, open_joint_file, rigged_of
from bodysense.io.rigs.figure import positions_in_parent
from bodysense.io.rigs.joint_file import JointFile

_SAMPLE = 2000  # frames over which the constant turn between a file's joints and ours is averaged


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
        return chain_to_root(self.parents, joint)

    @cached_property
    def trunk(self) -> list[int]:
        """The lowest joint on which the whole body hangs, and those above it, up to the root."""
        shared = set.intersection(*(set(self.above(joint)) for joint in self.ours.values()))
        return sorted(shared, reverse=True)

    def world(self, pose: Pose, joints: Sequence[int] | None = None) -> np.ndarray:
        """World rotations (T, J, 4) that a pose of ours gives all or some joints; NaN for those that we do not have."""
        rotation, chosen = (
            np.asarray(forward_kinematics(pose)[1]),
            range(len(self.joints)) if joints is None else joints,
        )
        world = np.full((*rotation.shape[:-2], len(chosen), 4), np.nan)
        names = {joint: name for name, joint in self.ours.items()}
        places = [place for place, joint in enumerate(chosen) if joint in names]
        if places:
            known = [names[chosen[place]] for place in places]
            turn = np.stack([self.turn[name] for name in known])
            turned = quaternion_multiply(rotation[..., pose.skeleton.indices(known), :], turn)
            world[..., places, :] = quaternion_multiply(quaternion_conjugate(self.up), turned)
        return world

    def ours_world(self, rotation: np.ndarray) -> dict[str, np.ndarray]:
        """World rotations (T, 4) of our joints, by name, that local ones (T, J, 4) of these joints give."""
        world = world_rotation(rotation, self.parents)[:, list(self.ours.values())]
        back = quaternion_conjugate(np.stack([self.turn[name] for name in self.ours]))
        found = quaternion_multiply(quaternion_multiply(self.up, world), back)
        return {name: found[:, place] for place, name in enumerate(self.ours)}

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


def joints_of_file(file: JointFile, rigged: Rigged) -> SourceJoints:
    """The joints of a file, from what was read of it. Raises BodysenseError for a file that was read mirrored."""
    if rigged.is_mirrored:
        raise BodysenseError(
            f"{file.path}: --left-handed is not for holes or a file's own rig; write it on ours first: bodysense "
            f"convert {file.path.name} -o whole.bvh --left-handed"
        )
    figure, rig, pose = rigged.figure, rigged.rig, rigged.clip.pose
    place = {node: joint for joint, node in enumerate(file.nodes)}
    index = {name: point for point, name in enumerate(figure.points)}
    ours, sites = {}, {}
    frames = np.unique(np.linspace(0, len(rigged.clip) - 1, _SAMPLE).astype(int))
    rotation = np.asarray(forward_kinematics(pose[frames])[1])
    world = rig.turned_to_world(world_rotation(file.rotation_in(frames), file.parents))
    for name, given in rig.joints.items():
        point = index[given]
        if name in pose.skeleton.end_sites or figure.nodes[point] not in place:  # an end site cannot turn
            sites[name] = place[figure.nodes[figure.parents[point]]]
            continue
        ours[name] = place[figure.nodes[point]]
    mine, theirs = rotation[:, pose.skeleton.indices(list(ours))], world[:, list(ours.values())]
    apart = mean_rotation(quaternion_multiply(quaternion_conjugate(mine), theirs))
    turn = dict(zip(ours, apart, strict=True))
    flat = any(figure.parents[k] > 0 and file.parents[place[figure.nodes[k]]] <= 0 for k in range(len(figure.joints)))
    if flat or (not figure.turns and len(figure.position) > 1):
        raise BodysenseError(
            f"{file.path}: its joints do not hang on one another, or do not turn, so that no other motion fits it; "
            f"write it anew: bodysense.write('hung.bvh', bodysense.read('{file.path.name}'))"
        )
    return SourceJoints(file.joints, file.parents, ours, sites, turn, rig.turn)


def world_rotation(rotation: np.ndarray, parents: Sequence[int]) -> np.ndarray:
    """World rotations (T, J, 4) of joints, parents first, from local ones."""
    if all(parent >= 0 for parent in parents[1:]):
        return tree_kinematics(parents, np.zeros((len(parents), 3)), np.zeros(3), rotation)[1]
    world = np.array(rotation)
    for joint, parent in enumerate(parents):
        if parent >= 0:
            world[:, joint] = quaternion_multiply(world[:, parent], rotation[:, joint])
    return world


def mean_rotation(rotation: np.ndarray) -> np.ndarray:
    """Return the mean (..., 4) of rotations (T, ..., 4) that differ little."""
    sign = np.where((rotation * rotation[:1]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    return np.asarray(normalize((sign * rotation).sum(axis=0)))


# --- motions written on it ---


def write_on_rig_of(path: Path, clip: Clip, source: Path, options: ReadingOptions = AS_FOUND) -> None:
    """Write a clip on the rig of a BVH or FBX file, as a file of this kind.

    On a body of other proportions feet stay on the floor and hands keep their positions, in a world scaled with the
    legs (`transfer_motion`). Joints of the rig that we lack keep their mean rotation and position. Raises
    BodysenseError if the rig's file cannot be read, or is not a humanoid.
    """
    file = open_joint_file(source, options)
    on_rig(file, rigged_of(file.mended, options), clip).write(path)


def on_rig(file: JointFile, rigged: Rigged, clip: Clip) -> JointFile:
    """Return the clip as a file like `file`, from which `rigged` was read."""
    joints, body = joints_of_file(file, rigged), rigged.clip.pose.skeleton
    pose = (
        clip.pose if np.allclose(clip.pose.skeleton.rest_offset, body.rest_offset) else transfer_motion(clip.pose, body)
    )
    anchor = next(name for name in ("pelvis", "left_hip") if name in joints.ours)
    wanted, place = joints.world(pose), np.asarray(forward_kinematics(pose)[0])[:, body.index(anchor)]
    frames, rest = len(clip), mean_rotation(file.rotation)
    local, world = np.zeros((2, frames, len(file.joints), 4))
    for joint, parent in enumerate(file.parents):
        above = world[:, parent] if parent >= 0 else np.broadcast_to([1.0, 0.0, 0.0, 0.0], (frames, 4))
        known = np.isfinite(wanted[:, joint]).all()
        local[:, joint] = quaternion_multiply(quaternion_conjugate(above), wanted[:, joint]) if known else rest[joint]
        world[:, joint] = quaternion_multiply(above, local[:, joint])
    blank = file.with_frames(np.median(file.mended.values, axis=0), frames, clip.frame_rate)
    whole = np.ones(local.shape[:2], dtype=bool)
    local = np.asarray(quaternion_canonical(local))
    turned = blank.with_rotation({joint: local[:, joint] for joint in range(len(file.joints))}, whole)
    carrier, carried = _carried(file, turned, joints.above(joints.ours[anchor]), rigged.rig.to_file(place), world)
    values, changed = turned.values.copy(), np.zeros(turned.values.shape, dtype=bool)
    columns = file.columns_of(carrier, "position")
    values[:, columns], changed[:, columns] = carried[:, file.axes_of(carrier)], True
    return turned.with_values(values, changed)


def _carried(
    rig: JointFile, file: JointFile, chain: list[int], target: np.ndarray, world: np.ndarray
) -> tuple[int, np.ndarray]:
    """Return the joint that moves a rig's body, and its position channels (T, 3) that bring a joint to `target` (T, 3).

    `chain` is that joint and its ancestors; `file` has the motion except these, `world` (T, J, 4) its rotations.
    """
    moving = [joint for joint in chain if len(rig.columns_of(joint, "position")) == 3]
    if not moving:
        raise BodysenseError(f"{rig.path}: no position above {rig.joints[chain[0]]!r}; take a rig that has one")
    carrier = max(moving, key=lambda joint: float(np.ptp(_offset(rig, joint), axis=0).max()))
    own = chain.index(carrier)
    place = target
    for joint in chain[:own]:  # back from the pelvis
        place = place - quaternion_rotate(world[:, file.parents[joint]], _offset(file, joint))
    for joint in reversed(chain[own + 1 :]):  # and from the root
        step = _offset(file, joint)
        place = place - (step if file.parents[joint] < 0 else quaternion_rotate(world[:, file.parents[joint]], step))
    if file.parents[carrier] >= 0:
        place = quaternion_rotate(quaternion_conjugate(world[:, file.parents[carrier]]), place)
    if carrier > 0 and not np.allclose(_offset(rig, carrier), rig.place(carrier)):  # they add to the offset
        place = place - rig.offset[carrier]
    return carrier, np.asarray(place)


def _offset(file: JointFile, joint: int) -> np.ndarray:
    """Return the position (T, 3) of a joint in its parent, file units."""
    still = np.tile(file.offset[joint], (len(file.values), 1))
    given = {joint: file.place(joint)} if file.columns_of(joint, "position") else {}
    return positions_in_parent(given, file.offset).get(joint, still)
