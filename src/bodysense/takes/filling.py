"""Motions with holes: known parts are observed, missing ones are completed, and the rest is bit-identical.

Joints with known world rotation and position become exact points of an Observation, and the tracker completes the
others. Its prediction fills the gaps (`geometry.gaps`) in the local rotations of joints, so bones keep their lengths.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
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
from bodysense.io.clip import part_joints
from bodysense.io.fingers import is_finger
from bodysense.observing.observation import EXACT_ACCURACY, Observation
from bodysense.sources.partial_motion import PartialMotion
from bodysense.tracking.estimate import CONTACT_POINTS, Estimate

if TYPE_CHECKING:
    from bodysense.io.target_rigs.own_rig import SourceJoints

Array = np.ndarray
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
SHORT = 0.3  # s; in shorter gaps a leg is not corrected for the floor, because interpolation is more accurate


def known_points(motion: PartialMotion) -> Observation:
    """Return an observation of the known parts, as exact points of our skeleton."""
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
    return hold_filled_feet(
        motion, fill_rotations(motion, estimate.pose, causal=causal), estimate.contact, floor, causal=causal
    )


def fill_rotations(motion: PartialMotion, estimate: Pose, *, causal: bool = False) -> Array:
    """Return local rotations (T, J, 4) of the motion's joints: unchanged if known, else filled.

    `estimate` (T,) is the completed body on our joints. Joints that our skeleton lacks are interpolated over the gap,
    or, if `causal`, continued into it.
    """
    rig, missing, seconds = motion.rig, motion.missing, 1 / motion.clip.frame_rate
    guessed, local = rig.world(estimate), np.array(motion.rotation)
    turn = None if causal else expected_deviations(motion)
    world = np.zeros_like(local)
    needed = {joint for gone in np.flatnonzero(missing.any(axis=0)).tolist() for joint in rig.above(gone)}
    for joint in sorted(needed):
        parent = rig.parents[joint]
        above = world[:, parent] if parent >= 0 else np.broadcast_to([1.0, 0.0, 0.0, 0.0], world[:, joint].shape)
        if missing[:, joint].any():
            guess = np.asarray(quaternion_multiply(quaternion_conjugate(above), guessed[:, joint]))
            given = guess if np.isfinite(guess).all() else None
            coasting = FINGERS_COAST if is_finger(_our_name(rig.ours, joint)) else gaps.COASTING
            gap, own = missing[:, joint], local[:, joint]
            if turn is None:
                at_frame = partial(_trust_at, rig.ours, joint, missing)
                local[:, joint] = gaps.continue_into_gaps(own, gap, seconds, given, at_frame, coasting)
            else:
                trust = _trust(rig.ours, joint, missing)
                local[:, joint] = gaps.fill(own, gap, seconds, given, trust, coasting, turn[:, joint])
        world[:, joint] = quaternion_multiply(above, local[:, joint])
    return local


def expected_deviations(motion: PartialMotion) -> Array:
    """Return deviations (T, J, 3) rad of the motion's joints from interpolation, as predicted from known joints.

    They are 0 outside gaps, in gaps without known frames on both sides, and for joints that are not in `BODY`.
    """
    rig, pose, frames = motion.rig, motion.clip.pose, len(motion.clip)
    result, seconds = np.zeros((*motion.missing.shape, 3)), 1 / motion.clip.frame_rate
    places = [(k, rig.ours[name]) for k, name in enumerate(BODY) if name in rig.ours]
    holes = np.ones((frames, ROOT + 1), dtype=bool)
    for k, joint in places:
        holes[:, k] = motion.holes[:, joint]
    holes[:, ROOT] = holes[:, BODY.index("pelvis")]
    rotation = np.asarray(pose.rotation)[:, pose.skeleton.indices(BODY)]
    gone: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for k, joint in places:
        for span in gaps.runs(motion.missing[:, joint]):
            gone.setdefault(span, []).append((k, joint))
    for (first, end), those in gone.items():
        if first == 0 or end == frames:
            continue
        is_known = ~np.asarray(holes[max(first - 2, 0) : end + 2].any(axis=0))
        found = deviations(rotation, np.asarray(pose.root_position), first, end, seconds)
        found = coordination().expected(found, is_known, (end - first) * seconds)
        for k, joint in those:
            back = np.broadcast_to(quaternion_conjugate(rig.turn[BODY[k]]), (end - first, 4))
            result[first:end, joint] = quaternion_rotate(back, found[:, k])
    return result


def hold_filled_feet(
    motion: PartialMotion, rotation: Array, contact: Array, floor: float, *, causal: bool = False
) -> Array:
    """Bend the filled legs of a motion (T, J, 4) so that feet stand still and no sole is too low.

    A foot stands if `contact` (T, 4), the probability that each of `CONTACT_POINTS` rests on something, is high. Soles
    are not lower than in known frames, or than the floor at height `floor` m. If `causal`, only earlier frames are
    known, and standing feet may slide, because their next known position is unknown.
    """
    rig, skeleton = motion.rig, motion.clip.pose.skeleton
    if not any(motion.missing[:, rig.ours[name]].any() for name in ("left_hip", "right_hip") if name in rig.ours):
        return rotation
    pose, bent = pose_of(motion, rotation), np.zeros_like(motion.missing)
    for side in ("left", "right"):
        leg = [rig.ours.get(f"{side}_{part}", -1) for part in ("hip", "knee", "ankle")]
        gone = np.asarray(motion.missing[:, leg].all(axis=1)) & (min(leg) >= 0)
        gone = gone if causal else _long_runs(gone, SHORT * motion.clip.frame_rate)
        if not gone.any():
            continue
        position = np.asarray(forward_kinematics(pose)[0])
        clearance = side_clearance(position, skeleton, side) - floor
        known = np.minimum(0.0, np.where(gone, 0.0, clearance))
        lowest = np.minimum.accumulate(known) if causal else known.min()
        resting = [name for name in CONTACT_POINTS if name.startswith(side)]
        shift = stop_sliding(
            position[:, skeleton.indices(resting)],
            contact[:, [CONTACT_POINTS.index(name) for name in resting]],
            gone & (not causal),
            1 / motion.clip.frame_rate,
        )
        shift[:, 1] = np.where(gone, np.maximum(0.0, lowest - clearance), 0.0)
        pose = reach(pose, f"{side}_ankle", position[:, skeleton.index(f"{side}_ankle")] + shift)
        bent[:, leg] |= shift.any(axis=1, keepdims=True)
    return with_world_rotations(rig, rotation, rig.world(pose), bent)


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


def with_missing_limbs(motion: PartialMotion, estimate: Pose) -> PartialMotion:
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
