"""Motions with holes: what is there is observed, what is missing is completed, and the rest stays bit for bit.

Joints that are known, and whose place in the world is known, become exact points of an Observation; the one tracker
completes the others. A gap is then filled in the turns of joints against their parents, so that bones keep their
lengths. Between the frames on both sides of a gap two guesses are weighed: the tracker's, bent so that it begins and
ends where the motion does, and the turn from one side to the other. The turn is good near the sides, and its error
grows with the way to them; where the motion has no side, the tracker's guess stands alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    slerp,
)
from bodysense.body.skeleton import default_skeleton
from bodysense.data.bvh import parse_bvh
from bodysense.data.bvh_file import BvhFile, open_bvh, runs
from bodysense.data.canonical import canonical, match_points
from bodysense.data.clip import Clip
from bodysense.data.holes import Missing, flat_lined, told_missing
from bodysense.data.names import recognise
from bodysense.data.rig import Rig, own_rig, rig_of
from bodysense.errors import BodysenseError
from bodysense.observation import EXACT_ACCURACY, Observation

Array = np.ndarray
TRUSTED = 0.2  # s from the nearest known frames at which the tracker counts as much as the turn between them
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Holed:
    """A motion of which something is missing."""

    clip: Clip  # on our joints; anything where it is missing
    rig: Rig  # its own joints
    rotation: Array  # (T, J, 4) of these, parent ← joint; anything where it is missing
    holes: Array  # (T, J) bool: missing in the source
    missing: Array  # (T, J) bool: the same without the pelvis and what is above it, which are turned over their gaps
    file: BvhFile | None = None  # where it is from


def holed_clip(clip: Clip, missing: Sequence[Missing]) -> Holed:
    """A motion in memory, on our joints, without what is told to be missing."""
    rig = own_rig(clip.pose.skeleton)
    holes = told_missing(missing, rig.joints, rig.parents, len(clip), rig.ours)
    rotation = np.asarray(clip.pose.rotation, dtype=float)
    rotation, rest = _rooted(clip.name, rig, rotation, holes)
    return Holed(replace(clip, pose=replace(clip.pose, rotation=rotation)), rig, rotation, holes, rest)


def holed_file(path: Path, missing: Sequence[Missing], find: bool) -> Holed:
    """A BVH file without what is told to be missing, has no number, or, where `find`, is flat-lined."""
    file = open_bvh(path)
    rig, _ = _read(file)
    holes = told_missing(missing, file.joints, file.parents, len(file.lines), rig.ours) | ~file.has_number
    if find:
        holes |= flat_lined(file, rig.ours)
    rotation, rest = _rooted(str(path), rig, file.rotation, holes)
    rooted = file.with_rotation(rotation, holes & ~rest)
    return Holed(_read(rooted)[1], rig, rotation, holes, rest, rooted)


def _read(file: BvhFile) -> tuple[Rig, Clip]:
    """The rig of a file, and its motion on our joints."""
    clip = parse_bvh(file.mended.text(), file.path)
    theirs = clip.pose.skeleton
    match = match_points(theirs, recognise(theirs.joints, str(file.path)))
    whole = canonical(replace(clip, name=str(file.path)))
    ours = {name: file.joints.index(theirs.joints[k]) for name, k in match.items() if k < len(theirs.joints)}
    sites = tuple(name for name in match if name in default_skeleton().end_sites)
    joints = {name: k for name, k in ours.items() if name in default_skeleton().joints}
    return rig_of(file, whole, joints, sites, UPRIGHT), replace(whole, name=clip.name)


def _rooted(name: str, rig: Rig, rotation: Array, holes: Array) -> tuple[Array, Array]:
    """Rotations and holes after the pelvis and what is above it were turned over their gaps: all else hangs on them."""
    rotation, holes = rotation.copy(), holes.copy()
    joint = rig.ours["pelvis"]
    while joint >= 0:
        if holes[:, joint].all():
            raise BodysenseError(
                f"{name}: {rig.joints[joint]!r} is missing in every frame, and everything hangs on it; "
                f"give the frames in which it is, as {rig.joints[joint]}:10-40"
            )
        rotation[:, joint] = turned_over(rotation[:, joint], holes[:, joint])
        holes[:, joint] = False
        joint = rig.parents[joint]
    return rotation, holes


def observed(holed: Holed) -> Observation:
    """What is there, as exact points of our skeleton."""
    clip, skeleton = holed.clip, holed.clip.pose.skeleton
    position, rotation = (np.asarray(part) for part in forward_kinematics(clip.pose))
    has_position, turned = holed.rig.seen(~holed.missing)
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


def filled(holed: Holed, estimate: Pose) -> Array:
    """Local rotations (T, J, 4) of the motion's joints: as they were where they are known, else filled.

    `estimate` (T,) is the completed body on our joints. A joint that we do not have is turned from one side of the gap
    to the other.
    """
    rig, missing, seconds = holed.rig, holed.missing, 1 / holed.clip.frame_rate
    guessed, local = rig.world(estimate), np.array(holed.rotation)
    world = np.zeros_like(local)
    for joint, parent in enumerate(rig.parents):
        above = world[:, parent] if parent >= 0 else np.broadcast_to([1.0, 0.0, 0.0, 0.0], world[:, joint].shape)
        guess = np.asarray(quaternion_multiply(quaternion_conjugate(above), guessed[:, joint]))
        for first, end in runs(missing[:, joint]):
            local[first:end, joint] = _gap(local[:, joint], guess, first, end, seconds)
        world[:, joint] = quaternion_multiply(above, local[:, joint])
    return local


def pose_of(holed: Holed, rotation: Array) -> Pose:
    """The filled motion (T, J, 4) on our joints."""
    clip, rig = holed.clip, holed.rig
    skeleton = clip.pose.skeleton
    own = np.asarray(forward_kinematics(clip.pose)[1])
    seen = rig.seen(~holed.missing)[1]
    found = rig.ours_world(rotation)
    world = np.zeros_like(own)
    for joint, name in enumerate(skeleton.joints):
        parent = skeleton.parents[joint]
        if name in found:
            world[:, joint] = np.where(seen[:, [joint]], own[:, joint], found[name])
        else:  # a joint that the motion does not have keeps its turn
            world[:, joint] = quaternion_multiply(world[:, parent], np.asarray(clip.pose.rotation)[:, joint])
    return Pose(skeleton, clip.pose.root_position, quaternion_canonical(local_rotation(skeleton, world)))


def turned_over(rotation: Array, missing: Array) -> Array:
    """Rotations (T, 4) of one joint, turned at constant speed from one side of every gap (T,) to the other."""
    result = np.array(rotation)
    for first, end in runs(missing):
        result[first:end] = _turn(rotation, first, end)
    return result


def _turn(rotation: Array, first: int, end: int) -> Array:
    """Rotations (N, 4) from one side of a gap to the other at constant speed; held where there is one side."""
    steps, before, after = _steps(first, end), rotation[max(first - 1, 0)], rotation[min(end, len(rotation) - 1)]
    if first == 0:
        before = after
    if end == len(rotation):
        after = before
    shape = (end - first, 4)
    return np.asarray(slerp(np.broadcast_to(before, shape), np.broadcast_to(after, shape), steps))


def _steps(first: int, end: int) -> Array:
    """(N,) how far each frame of a gap is on the way from the frame before to the frame after, in (0, 1)."""
    return np.arange(1, end - first + 1) / (end - first + 1)


def _gap(kept: Array, guess: Array, first: int, end: int, seconds: float) -> Array:
    """Rotations (N, 4) of a joint in the gap from `first` to before `end`, of (T, 4) kept and guessed ones."""
    turn = _turn(kept, first, end)
    if end - first < 2 or not np.isfinite(guess).all():
        return turn
    if first == 0 and end == len(kept):
        return guess
    share = _trust(first, end, len(kept), seconds)
    return np.asarray(quaternion_canonical(slerp(turn, _bent(kept, guess, first, end), share)))


def _bent(kept: Array, guess: Array, first: int, end: int) -> Array:
    """The guess (N, 4) in a gap, turned so that it goes on from the frame before and leads to the frame after.

    What it lacks on either side is added in full there and fades to the other side.
    """
    inside = guess[first:end]
    lacking = np.zeros((2, 3))
    if first > 0:
        lacking[0] = _difference(_beyond(inside[1::-1]), kept[first - 1])
    if end < len(kept):
        lacking[1] = _difference(_beyond(inside[-2:]), kept[end])
    steps = _steps(first, end)[:, None]
    return np.asarray(quaternion_multiply(inside, quaternion_exp((1 - steps) * lacking[0] + steps * lacking[1])))


def _beyond(pair: Array) -> Array:
    """The rotation (4,) that follows two (2, 4) at the same speed."""
    return np.asarray(quaternion_multiply(pair[1], quaternion_multiply(quaternion_conjugate(pair[0]), pair[1])))


def _difference(a: Array, b: Array) -> Array:
    """The rotation vector (3,) from a to b."""
    return np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(a), b)))


def _trust(first: int, end: int, frames: int, seconds: float) -> Array:
    """(N,) how much the guess counts, from 0 beside a known frame toward 1 far from all."""
    count = np.arange(end - first)
    before = (count + 1) * seconds if first > 0 else np.full(len(count), np.inf)
    after = count[::-1] * seconds + seconds if end < frames else np.full(len(count), np.inf)
    away = 1 / (1 / before + 1 / after)
    return away / (away + TRUSTED)
