"""Motions with holes: known parts are observed, missing ones are completed, and the rest is bit-identical.

Joints with known rotation and position in the world become exact points of an Observation; the one tracker completes
the others. Its prediction fills the gaps (`body.gaps`) in the joints' local rotations, so that bones keep their
lengths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body import gaps
from bodysense.body.footing import side_clearance, stopped_slide
from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.reach import reaching
from bodysense.body.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
)
from bodysense.errors import BodysenseError
from bodysense.estimate import CONTACT_POINTS
from bodysense.io.bvh_stream import BvhLines, open_bvh
from bodysense.io.clip import Clip, part_joints
from bodysense.io.fingers import is_finger
from bodysense.io.holes import Missing, flat_lined, missing_mask
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions
from bodysense.io.rigs.rigged import read_rigged
from bodysense.io.rigs.source_joints import SourceJoints, joints_of_file, own_joints
from bodysense.observation import EXACT_ACCURACY, Observation

Array = np.ndarray
# s from known frames at which the tracker's prediction and interpolation have equal weight: legs depend most on the
# rest of the body and the floor, arms little, hands least. Fitted on validation people of CMU and Rocketbox.
TRUSTED = {**dict.fromkeys(("hip", "knee", "ankle", "foot"), 0.3), "wrist": 4.0, "hand": 3.5, "body": 1.5}
TRUNK, TRUSTED_WITHOUT = ("spine1", "spine2", "spine3"), 30.0  # s, for joints on a trunk that is missing, too
FINGERS_COAST = 1.2  # s in which the speed of fingers at a gap's edge fades; longer than for limbs
SHORT = 0.3  # s: in shorter gaps a leg is not corrected for the floor, because interpolation is more accurate


@dataclass(frozen=True, eq=False)
class PartialMotion:
    """A motion with missing parts."""

    clip: Clip  # on our joints; arbitrary where missing
    rig: SourceJoints  # its own joints
    rotation: Array  # (T, J, 4) of these, parent ← joint; arbitrary where missing
    holes: Array  # (T, J) bool: missing in the source
    missing: Array  # (T, J) bool: the holes that remain after interpolating joints that carry the whole body
    file: BvhLines | None = None  # its source

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing."""
        return not self.holes.any() and not self.clip.lacks


def open_partial(source: Path | Clip, missing: Sequence[Missing], options: ReadingOptions = AS_FOUND) -> PartialMotion:
    """Open a BVH file or a clip with its holes: given missing joints, and values that are not numbers.

    If no missing joints are given, limbs with constant values in the file are missing.

    Raises BodysenseError for invalid items, and if a joint that carries the whole body is missing in all frames.
    """
    if isinstance(source, Path):
        return _partial_file(source, missing, options)
    clip = source
    lacking = part_joints(clip.lacks, clip.pose.skeleton.joints)
    rig, whole = own_joints(clip.pose.skeleton, lacking), np.asarray(clip.pose.rotation, dtype=float)
    holes = missing_mask(missing, rig.joints, rig.parents, len(clip), rig.ours)
    rotation, rest = _rooted(clip.name, rig, whole, holes, 1 / clip.frame_rate)
    return PartialMotion(replace(clip, pose=replace(clip.pose, rotation=rotation)), rig, rotation, holes, rest)


def _partial_file(path: Path, missing: Sequence[Missing], options: ReadingOptions) -> PartialMotion:
    file = open_bvh(path)
    clip, rig = _read(file, options)
    holes = missing_mask(missing, file.joints, file.parents, len(file.lines), rig.ours) | ~file.has_number
    if not missing:
        holes |= flat_lined(file, rig)
    rotation, rest = _rooted(str(path), rig, file.rotation, holes, file.interval)
    rooted = holes & ~rest
    if rooted.any():
        file = file.without_places(rooted).mended.with_rotation(rotation, rooted)
        clip, rig = _read(file, options)
    return PartialMotion(clip, rig, rotation, holes, rest, file)


def _read(file: BvhLines, options: ReadingOptions) -> tuple[Clip, SourceJoints]:
    """Return the motion of a file on our joints, and its own joints."""
    rigged = read_rigged(file.mended.text(), file.path, options)
    return rigged.clip, joints_of_file(file, rigged)


def _rooted(name: str, rig: SourceJoints, rotation: Array, holes: Array, seconds: float) -> tuple[Array, Array]:
    """Interpolate the joints that carry the whole body over their gaps; return rotations and remaining holes."""
    rotation, holes = rotation.copy(), holes.copy()
    for joint in rig.trunk:
        if holes[:, joint].all():
            raise BodysenseError(
                f"{name}: {rig.joints[joint]!r} is missing in every frame, and everything hangs on it; "
                f"give the frames in which it is, as {rig.joints[joint]}:10-40"
            )
        rotation[:, joint] = gaps.filled(rotation[:, joint], holes[:, joint], seconds)
        holes[:, joint] = False
    return rotation, holes


def observed(motion: PartialMotion) -> Observation:
    """Return the known parts as exact points of our skeleton."""
    clip, skeleton = motion.clip, motion.clip.pose.skeleton
    position, rotation = (np.asarray(part) for part in forward_kinematics(clip.pose))
    has_position, turned = motion.rig.seen(~motion.missing)
    has_rotation = np.zeros_like(has_position)
    has_rotation[:, : len(skeleton.joints)] = turned
    rotation = np.concatenate([rotation, np.full((len(clip), len(skeleton.end_sites), 4), np.nan)], axis=1)
    return Observation(
        points=skeleton.points,
        position=np.where(has_position[..., None], position, np.nan),
        rotation=np.where(has_rotation[..., None], rotation, np.nan),
        has_position=has_position,
        has_rotation=has_rotation,
        accuracy=np.full(has_position.shape, EXACT_ACCURACY),
        time=clip.time,
    )


def filled(motion: PartialMotion, estimate: Pose) -> Array:
    """Return local rotations (T, J, 4) of the motion's joints: unchanged if known, else filled.

    `estimate` (T,) is the completed body on our joints. A joint that we do not have is interpolated over the gap.
    """
    rig, missing, seconds = motion.rig, motion.missing, 1 / motion.clip.frame_rate
    guessed, local = rig.world(estimate), np.array(motion.rotation)
    world = np.zeros_like(local)
    for joint, parent in enumerate(rig.parents):
        above = world[:, parent] if parent >= 0 else np.broadcast_to([1.0, 0.0, 0.0, 0.0], world[:, joint].shape)
        if missing[:, joint].any():
            guess = np.asarray(quaternion_multiply(quaternion_conjugate(above), guessed[:, joint]))
            given = guess if np.isfinite(guess).all() else None
            trusted = _trusted_after(rig.ours, joint, missing)
            coasting = FINGERS_COAST if is_finger(_our_name(rig.ours, joint)) else gaps.COASTING
            local[:, joint] = gaps.filled(local[:, joint], missing[:, joint], seconds, given, trusted, coasting)
        world[:, joint] = quaternion_multiply(above, local[:, joint])
    return local


def on_feet(motion: PartialMotion, rotation: Array, contact: Array, floor: float) -> Array:
    """Bend the filled legs of a motion (T, J, 4) so that feet stand still and no sole is too low.

    A foot stands if `contact` (T, 4), the probability that each of `CONTACT_POINTS` rests on something, is high. A
    sole is no lower than in known frames; without any it is over the floor, height `floor` m.
    """
    rig, pose, skeleton = motion.rig, pose_of(motion, rotation), motion.clip.pose.skeleton
    bent = np.zeros_like(motion.missing)
    for side in ("left", "right"):
        leg = [rig.ours.get(f"{side}_{part}", -1) for part in ("hip", "knee", "ankle")]
        gone = _long(np.asarray(motion.missing[:, leg].all(axis=1)), SHORT * motion.clip.frame_rate) & (min(leg) >= 0)
        if not gone.any():
            continue
        position = np.asarray(forward_kinematics(pose)[0])
        clearance = side_clearance(position, skeleton, side) - floor
        lowest = min(0.0, clearance[~gone].min(initial=0.0))
        rise = np.where(gone, np.maximum(0.0, lowest - clearance), 0.0)
        resting = [name for name in CONTACT_POINTS if name.startswith(side)]
        shift = stopped_slide(
            position[:, skeleton.indices(resting)],
            contact[:, [CONTACT_POINTS.index(name) for name in resting]],
            gone,
            1 / motion.clip.frame_rate,
        )
        shift[:, 1] = rise
        pose = reaching(pose, f"{side}_ankle", position[:, skeleton.index(f"{side}_ankle")] + shift)
        bent[:, leg] |= shift.any(axis=1, keepdims=True)
    return _turned_to(rig, rotation, rig.world(pose), bent)


def _turned_to(rig: SourceJoints, rotation: Array, wanted: Array, where: Array) -> Array:
    """Return local rotations (T, J, 4) that give joints `wanted` world rotations (T, J, 4) where `where` (T, J)."""
    local, world = np.array(rotation), np.zeros_like(rotation)
    for joint, parent in enumerate(rig.parents):
        own = local[:, joint]
        if parent >= 0:
            turned = quaternion_multiply(quaternion_conjugate(world[:, parent]), wanted[:, joint])
            own = local[:, joint] = np.where(where[:, [joint]], quaternion_canonical(turned), own)
            own = quaternion_multiply(world[:, parent], own)
        world[:, joint] = own
    return local


def _our_name(ours: Mapping[str, int], joint: int) -> str:
    """Return our name of a rig's joint; empty if it is not one of ours."""
    return next((name for name, place in ours.items() if place == joint), "")


def _trusted_after(ours: Mapping[str, int], joint: int, missing: Array) -> float:
    """Return the time in `TRUSTED` of a joint; for one that we do not have, the default."""
    name = _our_name(ours, joint)
    part = name.rpartition("_")[2]
    trunk = [ours[name] for name in TRUNK if name in ours]
    if part not in ("hip", "knee", "ankle", "foot") and missing[missing[:, joint]][:, trunk].any(axis=1).mean() > 0.5:
        return TRUSTED_WITHOUT
    return TRUSTED.get(part, TRUSTED["hand"] if is_finger(name) else TRUSTED["body"])


def _long(gone: Array, fewest: float) -> Array:
    """Return the runs of (T,) bool with at least `fewest` frames."""
    result = np.zeros_like(gone)
    for first, end in gaps.runs(gone):
        result[first:end] = end - first >= fewest
    return result


def with_parts(motion: PartialMotion, estimate: Pose) -> PartialMotion:
    """Take missing legs, arms or head of the motion from the completed body (T,)."""
    clip, skeleton = motion.clip, motion.clip.pose.skeleton
    own = [skeleton.index(name) for name in part_joints(clip.lacks, skeleton.joints) if name not in motion.rig.ours]
    rotation = np.array(clip.pose.rotation)
    rotation[:, own] = estimate.rotation[:, own]
    clip = replace(clip, pose=replace(clip.pose, rotation=rotation))
    return replace(motion, clip=clip, rotation=motion.rotation if motion.file is not None else rotation)


def pose_of(motion: PartialMotion, rotation: Array) -> Pose:
    """Return the filled motion (T, J, 4) on our joints."""
    clip, rig = motion.clip, motion.rig
    skeleton = clip.pose.skeleton
    if motion.file is None:  # the motion is on our joints
        return Pose(skeleton, clip.pose.root_position, rotation)
    own = np.asarray(forward_kinematics(clip.pose)[1])
    seen = rig.seen(~motion.missing)[1]
    found = rig.ours_world(rotation)
    world = np.zeros_like(own)
    for joint, name in enumerate(skeleton.joints):
        parent = skeleton.parents[joint]
        if name in found:
            world[:, joint] = np.where(seen[:, [joint]], own[:, joint], found[name])
        else:  # a joint that the motion does not have keeps its rotation
            world[:, joint] = quaternion_multiply(world[:, parent], np.asarray(clip.pose.rotation)[:, joint])
    return Pose(skeleton, clip.pose.root_position, quaternion_canonical(local_rotation(skeleton, world)))
