"""Motions with holes: what is there is observed, what is missing is completed, and the rest stays bit for bit.

Joints that are known, and whose place in the world is known, become exact points of an Observation; the one tracker
completes the others. A gap is then filled in the turns of joints against their parents, so that bones keep their
lengths. Between the frames on both sides of a gap two guesses are weighed: the tracker's, bent so that it begins and
ends where the motion does, and the turn from one side to the other. The turn is good near the sides, and its error
grows with the way to them; where the motion has no side, the tracker's guess stands alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.reach import reaching
from bodysense.body.retarget import side_clearance
from bodysense.body.rotation import (
    normalize,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    slerp,
)
from bodysense.data.bvh_lines import BvhLines, open_bvh, runs
from bodysense.data.clip import Clip
from bodysense.data.fingers import is_finger
from bodysense.data.holes import Missing, flat_lined, told_missing
from bodysense.data.rigged import read_rigged
from bodysense.data.source_joints import SourceJoints, joints_of_file, own_joints
from bodysense.errors import BodysenseError
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions
from bodysense.observation import EXACT_ACCURACY, Observation

Array = np.ndarray
COASTING = 0.3  # s in which the speed beside a gap fades
SMOOTH = 0.07  # s, deviation of the bell that takes the tremble from the tracker's guess
# s away from known frames where the tracker's guess counts as much as the turn between them: legs follow from the
# rest of a body and its floor, arms little, hands least. Fitted on validation people of CMU and Rocketbox.
TRUSTED = {**dict.fromkeys(("hip", "knee", "ankle", "foot"), 0.4), "wrist": 4.0, "hand": 4.0, "body": 1.0}


@dataclass(frozen=True, eq=False)
class Holed:
    """A motion of which something is missing."""

    clip: Clip  # on our joints; anything where it is missing
    rig: SourceJoints  # its own joints
    rotation: Array  # (T, J, 4) of these, parent ← joint; anything where it is missing
    holes: Array  # (T, J) bool: missing in the source
    missing: Array  # (T, J) bool: the same without the pelvis and what is above it, which are turned over their gaps
    file: BvhLines | None = None  # where it is from


def holed_clip(clip: Clip, missing: Sequence[Missing]) -> Holed:
    """A motion in memory, on our joints, without what is told to be missing."""
    rig = own_joints(clip.pose.skeleton)
    holes = told_missing(missing, rig.joints, rig.parents, len(clip), rig.ours)
    rotation = np.asarray(clip.pose.rotation, dtype=float)
    rotation, rest = _rooted(clip.name, rig, rotation, holes, 1 / clip.frame_rate)
    return Holed(replace(clip, pose=replace(clip.pose, rotation=rotation)), rig, rotation, holes, rest)


def holed_file(path: Path, missing: Sequence[Missing], find: bool, options: ReadingOptions = AS_FOUND) -> Holed:
    """A BVH file without what is told to be missing, has no number, or, where `find`, is flat-lined."""
    file = open_bvh(path)
    clip, rig = _read(file, options)
    holes = told_missing(missing, file.joints, file.parents, len(file.lines), rig.ours) | ~file.has_number
    if find:
        holes |= flat_lined(file, rig.ours)
    rotation, rest = _rooted(str(path), rig, file.rotation, holes, file.interval)
    rooted = holes & ~rest
    if rooted.any():
        file = file.without_places(rooted).mended.with_rotation(rotation, rooted)
        clip, rig = _read(file, options)
    return Holed(clip, rig, rotation, holes, rest, file)


def _read(file: BvhLines, options: ReadingOptions) -> tuple[Clip, SourceJoints]:
    """The motion of a file on our joints, and its own joints."""
    rigged = read_rigged(file.mended.text(), file.path, options)
    return rigged.clip, joints_of_file(file, rigged)


def _rooted(name: str, rig: SourceJoints, rotation: Array, holes: Array, seconds: float) -> tuple[Array, Array]:
    """Rotations and holes after the pelvis and what is above it were turned over their gaps: all else hangs on them."""
    rotation, holes = rotation.copy(), holes.copy()
    joint = rig.ours["pelvis"]
    while joint >= 0:
        if holes[:, joint].all():
            raise BodysenseError(
                f"{name}: {rig.joints[joint]!r} is missing in every frame, and everything hangs on it; "
                f"give the frames in which it is, as {rig.joints[joint]}:10-40"
            )
        rotation[:, joint] = turned_over(rotation[:, joint], holes[:, joint], seconds)
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
        trusted = _trusted_after(rig.ours, joint)
        for first, end in runs(missing[:, joint]):
            local[first:end, joint] = _gap(local[:, joint], guess, trusted, first, end, seconds)
        world[:, joint] = quaternion_multiply(above, local[:, joint])
    return local


def over_floor(holed: Holed, rotation: Array, floor: float) -> Array:
    """The filled motion (T, J, 4), legs that were filled bent so that no sole is lower than it is where it is known.

    Soles are over the floor, height `floor` m, where they are known in no frame.
    """
    rig, pose, skeleton = holed.rig, pose_of(holed, rotation), holed.clip.pose.skeleton
    bent = np.zeros_like(holed.missing)
    for side in ("left", "right"):
        leg = [rig.ours.get(f"{side}_{part}", -1) for part in ("hip", "knee", "ankle")]
        gone = holed.missing[:, leg].all(axis=1) & (min(leg) >= 0)
        if not gone.any():
            continue
        position = np.asarray(forward_kinematics(pose)[0])
        clearance = side_clearance(position, skeleton, side) - floor
        lowest = min(0.0, clearance[~gone].min(initial=0.0))
        rise = np.where(gone, np.maximum(0.0, lowest - clearance), 0.0)
        target = position[:, skeleton.index(f"{side}_ankle")] + rise[:, None] * np.array([0.0, 1.0, 0.0])
        pose = reaching(pose, f"{side}_ankle", target)
        bent[:, leg] |= (rise > 0)[:, None]
    return _turned_to(rig, rotation, rig.world(pose), bent)


def _turned_to(rig: SourceJoints, rotation: Array, wanted: Array, where: Array) -> Array:
    """Local rotations (T, J, 4) that give joints their `wanted` rotations (T, J, 4) in the world `where` (T, J)."""
    local, world = np.array(rotation), np.zeros_like(rotation)
    for joint, parent in enumerate(rig.parents):
        own = local[:, joint]
        if parent >= 0:
            turned = quaternion_multiply(quaternion_conjugate(world[:, parent]), wanted[:, joint])
            own = local[:, joint] = np.where(where[:, [joint]], quaternion_canonical(turned), own)
            own = quaternion_multiply(world[:, parent], own)
        world[:, joint] = own
    return local


def _trusted_after(ours: Mapping[str, int], joint: int) -> float:
    """The time in `TRUSTED` of a joint; of one that we do not have, any."""
    name = next((name for name, place in ours.items() if place == joint), "")
    return TRUSTED.get(name.rpartition("_")[2], TRUSTED["hand"] if is_finger(name) else TRUSTED["body"])


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


def turned_over(rotation: Array, missing: Array, seconds: float) -> Array:
    """Rotations (T, 4) of one joint, turned from one side of every gap (T,) to the other."""
    result = np.array(rotation)
    for first, end in runs(missing):
        result[first:end] = _turn(rotation, first, end, seconds)
    return result


def _turn(rotation: Array, first: int, end: int, seconds: float) -> Array:
    """Rotations (N, 4) from one side of a gap to the other; held where there is one side.

    The speed on either side goes on and fades within `COASTING`; between, the turn is at constant speed.
    """
    frames, count = len(rotation), end - first
    before, after = rotation[first - 1 if first else end], rotation[end if end < frames else first - 1]
    step = _difference(before, after) / (count + 1)
    gone = np.arange(1.0, count + 1)[:, None]
    left = count + 1 - gone
    way = gone * step
    if first > 1:
        way = way + gone * _fading(gone * seconds) * (_difference(rotation[first - 2], before) - step)
    if end < frames - 1:
        way = way - left * _fading(left * seconds) * (_difference(after, rotation[end + 1]) - step)
    return np.asarray(quaternion_multiply(np.broadcast_to(before, (count, 4)), quaternion_exp(way)))


def _fading(time: Array) -> Array:
    """From 1 to 0 within `COASTING`."""
    return np.maximum(0.0, 1 - time / COASTING) ** 2


def _gap(kept: Array, guess: Array, trusted: float, first: int, end: int, seconds: float) -> Array:
    """Rotations (N, 4) of a joint in the gap from `first` to before `end`.

    Args:
        kept: (T, 4) its rotations where they are known.
        guess: (T, 4) the tracker's.
        trusted: s away from known frames where the guess counts half.
        first: the gap's first frame.
        end: the frame after its last.
        seconds: between frames.
    """
    if first == 0 and end == len(kept):
        return guess[first:end] if np.isfinite(guess).all() else kept[first:end]
    turn = _turn(kept, first, end, seconds)
    if end - first < 2 or not np.isfinite(guess).all():
        return np.asarray(quaternion_canonical(turn))
    away = _away(first, end, len(kept)) * seconds
    share = away**2 / (away**2 + trusted**2)
    return np.asarray(quaternion_canonical(slerp(turn, _bent(kept, guess, first, end, seconds), share)))


def _away(first: int, end: int, frames: int) -> Array:
    """(N,) how many frames each of a gap is away from what is known: as a bridge between two sides, or from one."""
    count = np.arange(1.0, end - first + 1)
    before = count if first > 0 else np.full(len(count), np.inf)
    after = count[::-1] if end < frames else np.full(len(count), np.inf)
    return 1 / (1 / before + 1 / after)


def _bent(kept: Array, guess: Array, first: int, end: int, seconds: float) -> Array:
    """The guess (N, 4) in a gap, turned so that it goes on from the frame before and leads to the frame after.

    What it lacks on either side is added in full there and fades to the other side.
    """
    inside = _smooth(guess[first:end], SMOOTH / seconds)
    lacking = np.zeros((2, 3))
    if first > 0:
        lacking[0] = _difference(_beyond(inside[1::-1]), kept[first - 1])
    if end < len(kept):
        lacking[1] = _difference(_beyond(inside[-2:]), kept[end])
    steps = (np.arange(1.0, end - first + 1) / (end - first + 1))[:, None]
    return np.asarray(quaternion_multiply(inside, quaternion_exp((1 - steps) * lacking[0] + steps * lacking[1])))


def _smooth(rotation: Array, frames: float) -> Array:
    """Rotations (N, 4), each the mean of those around it by a bell of so many frames' deviation."""
    reach = int(np.ceil(3 * frames))
    flips = np.where((rotation[1:] * rotation[:-1]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    whole = np.concatenate([rotation[:1], rotation[1:] * np.cumprod(flips, axis=0)])
    around = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * (around / frames) ** 2)
    places = np.clip(np.arange(len(whole))[:, None] + around, 0, len(whole) - 1)
    return np.asarray(normalize(np.einsum("nk,nkc->nc", np.broadcast_to(weights, places.shape), whole[places])))


def _beyond(pair: Array) -> Array:
    """The rotation (4,) that follows two (2, 4) at the same speed."""
    return np.asarray(quaternion_multiply(pair[1], quaternion_multiply(quaternion_conjugate(pair[0]), pair[1])))


def _difference(a: Array, b: Array) -> Array:
    """The rotation vector (3,) from a to b."""
    return np.asarray(quaternion_log(quaternion_multiply(quaternion_conjugate(a), b)))
