"""Holding: limbs of a joined body bend to where its joints are measured, and feet that stand stay on the floor."""

from __future__ import annotations

import numpy as np

from bodysense.body.footing import side_clearance, stopped_slide
from bodysense.body.gaps import runs
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.reach import reaching, reaching_all
from bodysense.body.rotation import (
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
)
from bodysense.body.skeleton import Skeleton
from bodysense.completion.joining import smoothed
from bodysense.estimate import CONTACT_POINTS

Array = np.ndarray
FARTHEST = 0.06  # m that a foot is held back at most; 0.12 holds more firmly, and causes a third more jumps
# Probabilities of contact from which a foot is held, and below which it no longer is; s in which it then comes back.
# Lower ones hold more firmly, and cause up to twice the jumps. Chosen on validation clips.
HOLD, RELEASE, FADE = 0.8, 0.6, 0.3
HOVER, LOWERING = 0.02, 0.2  # m over the floor from which a foot that stands is lowered; s over which that is smoothed
LOW, LOWEST = 0.3, 0.7  # probabilities of contact from which a foot is lowered a little and wholly
STILL, LASTING = 0.8, 0.3  # share of `HOVER` that is left out for those who stand still; s for which they do so
FARTHEST_DOWN = 0.15  # m that both feet of a body that stands are lowered at most
STEADY = 0.7  # m/s: a head that moves faster up or down jumps, sits down or rises
BESIDE = 0.25  # s in which a limb comes to a place where it is tracked, and leaves it
STRAIGHT = 0.02  # m by which the middle of a limb is beside it at least, else the side on which it is means nothing
_SIDES = ("left", "right")
ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")


def bent_to(pose: Pose, points: Array, measured: Array, seconds: float) -> Pose:
    """The pose (T,) with wrists and ankles that are `measured` at their points, and elbows and knees likewise.

    A limb bends in the plane in which it lies; hands and feet keep their rotations in the world. Before and after
    frames in which it is tracked its turns there fade, so that it does not leap.

    Args:
        pose: (T,).
        points: (T, P, 3) m, world: where points are measured, elsewhere where they are believed.
        measured: (T, P) bool: points that are tracked.
        seconds: between frames.
    """
    skeleton, (position, world) = pose.skeleton, (np.asarray(part) for part in forward_kinematics(pose))
    tips = {end: skeleton.index(end) for end in ENDS}
    goals = {end: np.where(measured[:, [tip]], points[:, tip], position[:, tip]) for end, tip in tips.items()}
    bent = reaching_all(pose, goals)
    rotation = np.array(pose.rotation)
    for tip in tips.values():
        for joint in (skeleton.parents[skeleton.parents[tip]], skeleton.parents[tip], tip):
            rotation[measured[:, tip], joint] = bent.rotation[measured[:, tip], joint]
    met = Pose(skeleton, pose.root_position, rotation.copy())
    for tip in tips.values():
        middle = skeleton.parents[tip]
        seen, ends = measured[:, middle], measured[:, tip]
        if seen.any():
            angle = faded(_swivel(met, tip, points)[:, None], seen, seconds)[:, 0]
            beside = ends & ~seen & (angle != 0)
            _turn_about_limb(met[beside], tip, angle[beside], beside, rotation)
            _turn_at_middle(met[seen], tip, points[seen], seen, rotation)
        _fade_turns(pose, world, tip, seen | ends, seconds, rotation)
    return Pose(skeleton, pose.root_position, rotation)


def _fade_turns(pose: Pose, world: Array, tip: int, moved: Array, seconds: float, rotation: Array) -> None:
    """Fade by what a limb was turned in frames that `moved` (T,), in local rotations (T, J, 4) of frames beside them.

    Turns fade, not places: a leg that is nearly straight bends far for a small change of its length.
    """
    skeleton, middle = pose.skeleton, pose.skeleton.parents[tip]
    first = skeleton.parents[middle]
    joints = [first, middle]
    before = np.asarray(pose.rotation)[:, joints]
    turn = quaternion_log(quaternion_multiply(quaternion_conjugate(before), rotation[:, joints]))
    turn = faded(np.asarray(turn).reshape(len(moved), 6), moved, seconds).reshape(-1, 2, 3)
    beside = ~moved & turn.any(axis=(1, 2))
    local = quaternion_multiply(before[beside], quaternion_exp(turn[beside]))
    above = quaternion_multiply(world[beside, skeleton.parents[first]], local[:, 0])
    _set_limb(skeleton, tip, world[beside], above, quaternion_multiply(above, local[:, 1]), beside, rotation)


def faded(offset: Array, measured: Array, seconds: float) -> Array:
    """Return offsets (T, N) in which those of frames that are `measured` (T,) go on into the others, and fade there."""
    found, count = np.where(measured[:, None], offset, 0.0), max(1, round(BESIDE / seconds))
    for first, end in runs(~measured):
        for frame, steps in ((first - 1, np.arange(1, end - first + 1)), (end, np.arange(end - first, 0, -1))):
            if 0 <= frame < len(offset):
                share = np.clip(steps / min(count, end - first + 1), 0.0, 1.0)
                found[first:end] += (1 - share**2 * (3 - 2 * share))[:, None] * offset[frame]
    return found


def _swivel(pose: Pose, tip: int, points: Array) -> Array:
    """Return by how much a limb has to turn about the line from its first joint to its end, (T,) rad, (-pi, pi].

    Its middle joint then is on the side of its point (T, P, 3); a limb that is straight has none.
    """
    position, middle = np.asarray(forward_kinematics(pose)[0]), pose.skeleton.parents[tip]
    start = position[:, pose.skeleton.parents[middle]]
    axis = position[:, tip] - start
    axis = axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    shown, wanted = (
        place - start - ((place - start) * axis).sum(axis=-1, keepdims=True) * axis
        for place in (position[:, middle], points[:, middle])
    )
    bent = np.minimum(np.linalg.norm(shown, axis=-1), np.linalg.norm(wanted, axis=-1)) > STRAIGHT
    angle = np.arctan2((np.cross(shown, wanted) * axis).sum(axis=-1), (shown * wanted).sum(axis=-1))
    return np.where(bent, angle, 0.0)


def _turn_about_limb(pose: Pose, tip: int, angle: Array, where: Array, rotation: Array) -> None:
    """Turn a limb about the line from its first joint to its end in local rotations (T, J, 4), frames `where`."""
    skeleton, (position, world) = pose.skeleton, (np.asarray(part) for part in forward_kinematics(pose))
    middle = skeleton.parents[tip]
    axis = position[:, tip] - position[:, skeleton.parents[middle]]
    axis = axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    turn = quaternion_exp(angle[:, None] * axis)
    above = quaternion_multiply(turn, world[:, skeleton.parents[middle]])
    _set_limb(skeleton, tip, world, above, quaternion_multiply(turn, world[:, middle]), where, rotation)


def _turn_at_middle(pose: Pose, tip: int, points: Array, where: Array, rotation: Array) -> None:
    """Turn a limb's bones in local rotations (T, J, 4), frames `where`, so that middle and end come to their points."""
    skeleton = pose.skeleton
    middle = skeleton.parents[tip]
    first = skeleton.parents[middle]
    position, world = (np.asarray(part) for part in forward_kinematics(pose))
    start = position[:, first]
    swung = shortest_arc(position[:, middle] - start, points[:, middle] - start)
    upper = quaternion_rotate(swung, position[:, middle] - start)
    lower = quaternion_rotate(swung, position[:, tip] - position[:, middle])
    turned = shortest_arc(lower, points[:, tip] - start - upper)
    above = quaternion_multiply(swung, world[:, first])
    below = quaternion_multiply(turned, quaternion_multiply(swung, world[:, middle]))
    _set_limb(skeleton, tip, world, above, below, where, rotation)


def _set_limb(
    skeleton: Skeleton, tip: int, world: Array, above: Array, below: Array, where: Array, rotation: Array
) -> None:
    """Give a limb's bones rotations in the world, and keep that of its end, in local rotations, frames `where`."""
    middle = skeleton.parents[tip]
    first = skeleton.parents[middle]
    parent = world[:, skeleton.parents[first]]
    for joint, base, to in ((first, parent, above), (middle, above, below), (tip, below, world[:, tip])):
        rotation[where, joint] = quaternion_canonical(quaternion_multiply(quaternion_conjugate(base), to))


def trunk_met(pose: Pose, points: Array, measured: Array) -> Pose:
    """The pose (T,) whose spine points from the head to the pelvis, where both are `measured` and the chest is not.

    The spine turns about the head as one piece; head and pelvis keep their rotations in the world. What is left is how
    much longer or shorter than measured the spine is.

    Args:
        pose: (T,).
        points: (T, P, 3) m, world.
        measured: (T, P) bool: points that are tracked.
    """
    skeleton = pose.skeleton
    pelvis, head = skeleton.index("pelvis"), skeleton.index("head")
    where = np.asarray(measured[:, pelvis] & measured[:, head] & ~measured[:, skeleton.index("spine3")])
    if not where.any():
        return pose
    position, world = (np.asarray(part) for part in forward_kinematics(pose[where]))
    rotation, root = np.array(pose.rotation), np.array(pose.root_position)
    first, last = skeleton.index("spine1"), skeleton.parents[head]
    hanging, rising = position[:, first] - position[:, head], position[:, first] - position[:, pelvis]
    swung = shortest_arc(hanging, points[where, pelvis] + rising - points[where, head])
    for joint, above, own in (
        (first, world[:, pelvis], quaternion_multiply(swung, world[:, first])),
        (head, quaternion_multiply(swung, world[:, last]), world[:, head]),
    ):
        rotation[where, joint] = quaternion_canonical(quaternion_multiply(quaternion_conjugate(above), own))
    root[where] = points[where, head] + quaternion_rotate(swung, hanging) - rising
    return Pose(skeleton, root, rotation)


def on_floor(pose: Pose, contact: Array, measured: Array, turned: Array, floor: float, seconds: float) -> Pose:
    """The pose (T,) with feet that stand held in place and low, and soles that are not under the floor.

    Nobody who stands hovers with both feet.

    Args:
        pose: (T,).
        contact: (T, 4) probability that each of `CONTACT_POINTS` rests on something.
        measured: (T, P) bool: points that are tracked; feet that are stay where they are.
        turned: (T, J) bool: joints whose rotation is tracked; tracked shins and feet keep it.
        floor: m, height of the floor.
        seconds: between frames.
    """
    skeleton, position = pose.skeleton, np.asarray(forward_kinematics(pose)[0])
    free = {}
    for side in _SIDES:
        soles = skeleton.indices([f"{side}_{part}" for part in ("ankle", "foot", "toe")])
        lower = skeleton.indices([f"{side}_{part}" for part in ("knee", "ankle")])
        free[side] = np.asarray(~measured[:, soles].any(axis=1) & ~turned[:, lower].any(axis=1))
    clearance = {side: side_clearance(position, skeleton, side) - floor for side in _SIDES}
    chances = {
        side: contact[:, [place for place, name in enumerate(CONTACT_POINTS) if name.startswith(side)]]
        for side in _SIDES
    }
    stands = {side: np.clip((one.max(axis=1) - LOW) / (LOWEST - LOW), 0.0, 1.0) for side, one in chances.items()}
    sole = HOVER * (1 - STILL * lasting(np.minimum(*stands.values()), seconds))
    hovers = upright(position, skeleton, floor, seconds) * (np.minimum(*clearance.values()) - sole)
    hovers = np.where(np.logical_and(*free.values()), np.clip(hovers, 0.0, FARTHEST_DOWN), 0.0)
    for side in _SIDES:
        if not free[side].any():
            continue
        place = position[:, skeleton.indices([name for name in CONTACT_POINTS if name.startswith(side)])]
        shift = stopped_slide(place, chances[side], free[side], seconds, FARTHEST, FADE, (HOLD, RELEASE))
        known = smoothed(free[side].astype(float), LOWERING / seconds)
        away = np.clip(2 * known - 1, 0.0, 1.0)  # from frames that are known
        over = np.maximum(stands[side] * np.clip(clearance[side] - sole, 0.0, FARTHEST), hovers)
        lower = away * smoothed(over, LOWERING / seconds)
        deep = np.maximum(0.0, -clearance[side])
        allowed = faded(deep[:, None], ~free[side], seconds)[:, 0]  # tracked feet may be under the floor
        shift[:, 1] = np.where(free[side], np.maximum(0.0, deep - allowed) - lower, 0.0)
        pose = reaching(pose, f"{side}_ankle", position[:, skeleton.index(f"{side}_ankle")] + shift)
    return pose


def lasting(share: Array, seconds: float) -> Array:
    """Return shares (T,) of what is so for `LASTING` seconds, before or after a frame, smoothed over that time."""
    frames = max(1, round(LASTING / seconds))
    padded = np.pad(share, frames, mode="edge")
    least = np.lib.stride_tricks.sliding_window_view(padded, frames + 1).min(axis=-1)  # of frames and those after
    return smoothed(np.maximum(least[:-frames], least[frames:]), LASTING / 2 / seconds)


def upright(position: Array, skeleton: Skeleton, floor: float, seconds: float) -> Array:
    """Return how surely a body stands or walks, (T,) in [0, 1]: 0 if it sits, lies or jumps.

    Args:
        position: (T, P, 3) m, world.
        skeleton: the body.
        floor: m, its height.
        seconds: between frames.
    """
    head = skeleton.index("head")
    high = position[:, head, 1] - floor
    tall = float(skeleton.rest_offset[0, 1] + (skeleton.path @ skeleton.rest_offset)[head, 1])
    speed = np.gradient(high, seconds) if len(high) > 1 else np.zeros_like(high)
    risen = np.clip((high / tall - 0.75) / 0.1, 0.0, 1.0)
    calm = np.clip((STEADY - np.abs(speed)) / (0.5 * STEADY), 0.0, 1.0)
    return np.where(high > tall + 0.03, 0.0, risen * calm)
