"""Motions with holes: known parts are observed, missing ones are completed, and the rest is bit-identical.

Joints with known world rotation and position become exact points of an Observation, and the tracker completes the
others. Its prediction fills the gaps (`geometry.gaps`) in the local rotations of joints, so bones keep their lengths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.coordination import ROOT, coordination, deviations
from bodysense.body.footing import side_clearance, stop_sliding
from bodysense.body.pose import Pose, forward_kinematics, local_rotation
from bodysense.body.reach import reach
from bodysense.body.skeleton import BODY, LEG
from bodysense.errors import BodysenseError
from bodysense.geometry import gaps
from bodysense.geometry.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.io.clip import Clip, part_joints
from bodysense.io.fingers import is_finger
from bodysense.io.rigs.figure import blocks_of
from bodysense.observing.observation import EXACT_ACCURACY, Observation
from bodysense.sources.partial_motion import PartialMotion
from bodysense.tracking.estimate import CONTACT_POINTS, Estimate

if TYPE_CHECKING:
    from bodysense.io.target_rigs.own_rig import SourceJoints

Array = np.ndarray
Filled = dict[int, Array]  # (T, 4) local rotations of joints, by their index in the motion
# Weight of the tracker's prediction against the interpolation, by the last word of a joint's name. The rest of the body
# and the floor determine legs well, arms little, trunk and hands least. Fitted on validation people of CMU and
# Rocketbox. If only one side of a gap is known, the weight grows to 1.
TRUST = {
    **dict.fromkeys(("hip", "knee"), gaps.Trust(0.8, 0.2, 0.3)),
    **dict.fromkeys(("ankle", "foot"), gaps.Trust(0.4, 0.2, 0.3)),
    "shoulder": gaps.Trust(0.3, 0.2, 1.5),
    "wrist": gaps.Trust(0.05, 0.2, 4.0),
    "hand": gaps.Trust(1.0, 3.5, 3.5),
    "body": gaps.Trust(0.1, 0.2, 1.5),
}
TRUNK, TRUST_WITHOUT = ("spine1", "spine2", "spine3"), gaps.Trust(0.1, 0.2, 30.0)  # of joints on a missing trunk
FINGERS_COAST = 1.2  # s in which the speed of fingers at a gap's edge fades; longer than for limbs
_LEG = LEG[:3]  # joints that bend a leg
_PART = 2048  # frames of a gap that are predicted at once, a multiple of 64
SHORT = 0.3  # s; in shorter gaps a leg is not corrected for the floor, because interpolation is more accurate


@dataclass(frozen=True, eq=False)
class KnownPoints:
    """The known parts of a motion (T,), observed when frames are taken: those of an hour would fill the memory."""

    motion: PartialMotion

    def __len__(self) -> int:
        return len(self.motion.clip)

    def __getitem__(self, frames: slice) -> Observation:
        return known_points(self.motion, frames)

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points, those of our skeleton."""
        return self.motion.clip.pose.skeleton.points

    @property
    def time(self) -> Array:
        """(T,) s."""
        return self.motion.clip.time


@dataclass(frozen=True, eq=False)
class _SomeJoints:
    """Rotations (T, N, 4) of some joints, copied when frames are taken."""

    rotation: Array  # (T, J, 4)
    joints: Array

    def __len__(self) -> int:
        return len(self.rotation)

    def __getitem__(self, frames: int | slice) -> Array:
        return self.rotation[frames][..., self.joints, :]


def known_points(motion: PartialMotion, frames: slice = slice(None)) -> Observation:
    """Return an observation of the known parts in some frames, as exact points of our skeleton."""
    pose, skeleton = motion.clip.pose[frames], motion.clip.pose.skeleton
    position, rotation = (np.asarray(part) for part in forward_kinematics(pose))
    has_position, turned = motion.rig.seen(~motion.missing[frames])
    has_rotation = np.zeros_like(has_position)
    has_rotation[:, : len(skeleton.joints)] = turned
    rotation = np.concatenate([rotation, np.full((len(rotation), len(skeleton.end_sites), 4), np.nan)], axis=1)
    return Observation(
        points=skeleton.points,
        position=np.where(has_position[..., None], position, np.nan),
        rotation=np.where(has_rotation[..., None], rotation, np.nan),
        has_position=has_position,
        has_rotation=has_rotation,
        accuracy=np.full(has_position.shape, EXACT_ACCURACY),
        time=motion.clip.time[frames],
    )


def check_causal(motion: PartialMotion) -> None:
    """Raise BodysenseError if a joint that carries the whole body has gaps, which only later frames could fill."""
    carried = np.flatnonzero((motion.holes & ~motion.missing).any(axis=0)).tolist()
    if carried:
        raise BodysenseError(
            f"{motion.clip.name}: {motion.rig.joints[carried[0]]!r} is missing in some frames, and everything hangs on "
            "it; it is filled from the frames before and after alone, so leave --causal out"
        )


def fill_motion(motion: PartialMotion, estimate: Estimate, floor: float = 0.0, *, causal: bool = False) -> Array:
    """Fill a motion from a completed body (T,) and hold its feet; return local rotations (T, J, 4) of its joints.

    `floor` is the height of the floor in m. If `causal`, each frame is filled from itself and the frames before it.
    """
    filled = fill_rotations(motion, guessed_rotations(motion, estimate.pose), causal=causal)
    return with_filled(motion, hold_filled_feet(motion, filled, estimate.contact, floor, causal=causal))


def holed_joints(motion: PartialMotion) -> list[int]:
    """Return the motion's joints that are missing in some frames."""
    return np.flatnonzero(motion.missing.any(axis=0)).tolist()


def guessed_rotations(motion: PartialMotion, pose: Pose) -> Filled:
    """Return world rotations (T, 4) of `holed_joints` in a completed body (T,); NaN for those that ours lacks."""
    joints = holed_joints(motion)
    return dict(zip(joints, np.moveaxis(motion.rig.world(pose, joints), 1, 0), strict=True))


def fill_rotations(motion: PartialMotion, guessed: Filled, *, causal: bool = False) -> Filled:
    """Return local rotations (T, 4) of the joints with holes: unchanged if known, else filled.

    `guessed` are their world rotations in a completed body. A joint is taken out of it when it is filled, because the
    rotations of an hour are large. Joints that our skeleton lacks are interpolated over the gap, or, if `causal`,
    continued into it.
    """
    rig, missing, seconds = motion.rig, motion.missing, 1 / motion.clip.frame_rate
    turn, still = {} if causal else expected_deviations(motion), np.zeros((len(missing), 3))
    needed, every = sorted({joint for gone in holed_joints(motion) for joint in rig.above(gone)}), slice(None)
    last = {rig.parents[joint]: joint for joint in needed}  # child of each joint that is filled last
    filled: Filled = {}
    world: Filled = {}
    for joint in needed:
        parent, local = rig.parents[joint], motion.rotation_in(every, [joint])[:, 0]
        above = world[parent] if parent >= 0 else np.broadcast_to([1.0, 0.0, 0.0, 0.0], local.shape)
        if joint in guessed:
            guess = np.asarray(quaternion_multiply(quaternion_conjugate(above), guessed.pop(joint)))
            given = guess if np.isfinite(guess).all() else None
            coasting = FINGERS_COAST if is_finger(_our_name(rig.ours, joint)) else gaps.COASTING
            gap = missing[:, joint]
            if causal:
                at_frame = partial(_trust_at, rig.ours, joint, missing)
                local = gaps.continue_into_gaps(local, gap, seconds, given, at_frame, coasting)
            else:
                trust = _trust(rig.ours, joint, missing)
                local = gaps.fill(local, gap, seconds, given, trust, coasting, turn.pop(joint, still))
            filled[joint] = local
        if joint in last:
            world[joint] = np.asarray(quaternion_multiply(above, local))
        if last[parent] == joint:
            world.pop(parent, None)
    return filled


def with_filled(motion: PartialMotion, filled: Filled, frames: slice = slice(None)) -> Array:
    """Return local rotations (N, J, 4) of the motion's joints in some frames, some of them filled."""
    rotation = motion.rotation_in(frames)
    for joint, turns in filled.items():
        rotation[:, joint] = turns[frames]
    return rotation


def expected_deviations(motion: PartialMotion) -> Filled:
    """Return deviations (T, 3) rad of the motion's joints from interpolation, as predicted from known joints.

    They are 0 outside gaps, in gaps without known frames on both sides, and for joints that are not in `BODY`.
    """
    rig, pose, frames = motion.rig, motion.clip.pose, len(motion.clip)
    result, seconds = {}, 1 / motion.clip.frame_rate
    places = [(k, rig.ours[name]) for k, name in enumerate(BODY) if name in rig.ours]
    holes = np.ones((frames, ROOT + 1), dtype=bool)
    for k, joint in places:
        holes[:, k] = motion.holes[:, joint]
    holes[:, ROOT] = holes[:, BODY.index("pelvis")]
    rotation, root = _SomeJoints(np.asarray(pose.rotation), pose.skeleton.indices(BODY)), np.asarray(pose.root_position)
    gone: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for k, joint in places:
        for span in gaps.runs(motion.missing[:, joint]):
            gone.setdefault(span, []).append((k, joint))
    for (first, end), those in gone.items():
        if first == 0 or end == frames:
            continue
        is_known = ~np.asarray(holes[max(first - 2, 0) : end + 2].any(axis=0))
        for part in _parts(end - first):
            found = deviations(rotation, root, first, end, seconds, part)
            found = coordination().expected(found, is_known, (end - first) * seconds)
            here = slice(first + part.start, first + part.stop)
            for k, joint in those:
                back = np.broadcast_to(quaternion_conjugate(rig.turn[BODY[k]]), (len(found), 4))
                result.setdefault(joint, np.zeros((frames, 3)))[here] = quaternion_rotate(back, found[:, k])
    return result


def _parts(frames: int) -> list[slice]:
    """Return consecutive slices of a gap with a fixed number of frames; the last one has up to twice as many.

    A product of matrices may round the last rows differently, so that slices are never short.
    """
    starts = [*range(0, max(frames - _PART, 1), _PART)]
    return [slice(start, end) for start, end in zip(starts, [*starts[1:], frames], strict=True)]


def hold_filled_feet(
    motion: PartialMotion, filled: Filled, contact: Array, floor: float, *, causal: bool = False
) -> Filled:
    """Bend the filled legs of a motion so that feet stand still and no sole is too low.

    A foot stands if `contact` (T, 4), the probability that each of `CONTACT_POINTS` rests on something, is high. Soles
    are not lower than in known frames, or than the floor at height `floor` m. If `causal`, only earlier frames are
    known, and standing feet may slide, because their next known position is unknown.
    """
    rig, skeleton, seconds = motion.rig, motion.clip.pose.skeleton, 1 / motion.clip.frame_rate
    gone: dict[str, Array] = {}
    for side in ("left", "right"):
        leg = [rig.ours.get(f"{side}_{part}", -1) for part in _LEG]
        lost = np.asarray(motion.missing[:, leg].all(axis=1)) & (min(leg) >= 0)
        lost = lost if causal else _long_runs(lost, SHORT * motion.clip.frame_rate)
        if lost.any():
            gone[side] = lost
    if not gone:
        return filled
    resting = {side: [name for name in CONTACT_POINTS if name.startswith(side)] for side in gone}
    clearance = {side: np.empty(len(contact)) for side in gone}
    feet = {side: np.empty((len(contact), len(names), 3)) for side, names in resting.items()}
    for block in blocks_of(len(contact)):
        position = np.asarray(forward_kinematics(pose_of(motion, filled, block))[0])
        for side in gone:
            clearance[side][block] = side_clearance(position, skeleton, side) - floor
            feet[side][block] = position[:, skeleton.indices(resting[side])]
    shift: dict[str, Array] = {}
    for side, lost in gone.items():
        known = np.minimum(0.0, np.where(lost, 0.0, clearance[side]))
        lowest = np.minimum.accumulate(known) if causal else known.min()
        chances = contact[:, [CONTACT_POINTS.index(name) for name in resting[side]]]
        shift[side] = stop_sliding(feet[side], chances, lost & (not causal), seconds)
        shift[side][:, 1] = np.where(lost, np.maximum(0.0, lowest - clearance[side]), 0.0)
    legs = [rig.ours[f"{side}_{part}"] for side in gone for part in _LEG]
    held = filled | {joint: np.array(filled[joint]) for joint in legs}
    for block in blocks_of(len(contact)):
        bent = np.zeros((len(contact[block]), len(rig.joints)), dtype=bool)
        for side, moved in shift.items():
            bent[:, [rig.ours[f"{side}_{part}"] for part in _LEG]] |= moved[block].any(axis=1, keepdims=True)
        if not bent.any():
            continue
        pose = pose_of(motion, filled, block)
        position = np.asarray(forward_kinematics(pose)[0])
        for side, moved in shift.items():
            ankle = f"{side}_ankle"
            pose = reach(pose, ankle, position[:, skeleton.index(ankle)] + moved[block])
        turned = with_world_rotations(rig, with_filled(motion, filled, block), rig.world(pose), bent)
        for joint in np.flatnonzero(bent.any(axis=0)).tolist():
            held[joint][block] = turned[:, joint]
    return held


def with_world_rotations(rig: SourceJoints, rotation: Array, wanted: Array, where: Array) -> Array:
    """Return local rotations (T, J, 4) that give joints in `where` (T, J) the `wanted` world rotations (T, J, 4)."""
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


def _trust(ours: Mapping[str, int], joint: int, missing: Array) -> gaps.Trust:
    """Return the weight of the prediction for a joint; joints that our skeleton lacks have that of the body."""
    name = _our_name(ours, joint)
    part = name.rpartition("_")[2]
    trunk = [ours[name] for name in TRUNK if name in ours]
    is_leg = part in LEG
    if not is_leg and missing[missing[:, joint]][:, trunk].any(axis=1).mean() > 0.5:
        return TRUST_WITHOUT
    return TRUST.get(part, TRUST["hand"] if is_finger(name) else TRUST["body"])


def _trust_at(ours: Mapping[str, int], joint: int, missing: Array, frame: int) -> gaps.Trust:
    """Return the weight of the prediction for a joint, by the missing joints of one frame."""
    return _trust(ours, joint, missing[frame : frame + 1])


def _long_runs(gone: Array, fewest: float) -> Array:
    """Return the runs of (T,) bool with at least `fewest` frames."""
    result = np.zeros_like(gone)
    for first, end in gaps.runs(gone):
        result[first:end] = end - first >= fewest
    return result


def missing_limbs(clip: Clip, rig: SourceJoints) -> list[int]:
    """Return our joints of legs, arms or head that the motion lacks."""
    skeleton = clip.pose.skeleton
    return [skeleton.index(name) for name in part_joints(clip.lacks, skeleton.joints) if name not in rig.ours]


def with_missing_limbs(motion: PartialMotion, limbs: Array) -> PartialMotion:
    """Take legs, arms or head that the motion lacks from rotations (T, N, 4) of `missing_limbs`."""
    rotation = np.array(motion.clip.pose.rotation)
    rotation[:, missing_limbs(motion.clip, motion.rig)] = limbs
    return replace(motion, clip=replace(motion.clip, pose=replace(motion.clip.pose, rotation=rotation)))


def pose_of(motion: PartialMotion, filled: Filled, frames: slice = slice(None)) -> Pose:
    """Return the filled motion on our joints, in some frames."""
    rig, pose, rotation = motion.rig, motion.clip.pose[frames], with_filled(motion, filled, frames)
    skeleton = pose.skeleton
    if motion.file is None:  # the motion is on our joints
        return Pose(skeleton, pose.root_position, rotation)
    own = np.asarray(forward_kinematics(pose)[1])
    seen = rig.seen(~motion.missing[frames])[1]
    found = rig.ours_world(rotation)
    world = np.zeros_like(own)
    for joint, name in enumerate(skeleton.joints):
        parent = skeleton.parents[joint]
        if name in found:
            world[:, joint] = np.where(seen[:, [joint]], own[:, joint], found[name])
        else:  # a joint that the motion does not have keeps its rotation
            world[:, joint] = quaternion_multiply(world[:, parent], np.asarray(pose.rotation)[:, joint])
    return Pose(skeleton, pose.root_position, quaternion_canonical(local_rotation(skeleton, world)))


def whole_pose(motion: PartialMotion, filled: Filled) -> Pose:
    """Return the filled motion (T,) on our joints, computed a block of frames at a time."""
    pose = motion.clip.pose
    rotation = np.empty(np.asarray(pose.rotation).shape)
    for block in blocks_of(len(rotation)):
        rotation[block] = pose_of(motion, filled, block).rotation
    return Pose(pose.skeleton, pose.root_position, rotation)
