"""Fitting: limbs and spine of a joined body bend so that its joints reach their measured positions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.reach import reach, reach_all
from bodysense.body.skeleton import FINGERS, Skeleton
from bodysense.geometry.gaps import runs
from bodysense.geometry.rotation import (
    angle_about,
    quaternion_canonical,
    quaternion_conjugate,
    quaternion_exp,
    quaternion_log,
    quaternion_multiply,
    quaternion_rotate,
    shortest_arc,
    smooth_step,
)

Array = np.ndarray
FADE_TIME = 0.25  # s in which a limb moves to its tracked position, and away from it
STRAIGHT = 0.02  # m from the line of a limb to its middle joint; nearer ones do not determine how the limb is turned
NEARLY_STRAIGHT = (
    0.93  # of a leg's length; a shorter one bends little for a small change of its length. 0.97: knees pop by 3 cm
)
MISS = 0.01  # m; largest distance by which a tracked ankle is missed to ease the bend of its leg
ENDS = ("left_wrist", "right_wrist", "left_ankle", "right_ankle")


@dataclass(frozen=True, eq=False)
class Trunk:
    """A body without fingers, on which fits are three times as fast."""

    whole: Skeleton
    skeleton: Skeleton
    joints: list[int]  # which joints of the whole body it has
    points: list[int]

    @staticmethod
    def of(whole: Skeleton) -> Trunk:
        """Return the body of a skeleton without its fingers."""
        points = [k for k, name in enumerate(whole.points) if not name.partition("_")[2].startswith(FINGERS)]
        joints = [k for k in points if k < len(whole.joints)]
        names = [whole.points[k] for k in points]
        parents = tuple(points.index(whole.parents[k]) if whole.parents[k] >= 0 else -1 for k in points)
        sites = tuple(names[len(joints) :])
        return Trunk(
            whole, Skeleton(tuple(names[: len(joints)]), sites, parents, whole.rest_offset[points]), joints, points
        )

    def without_fingers(self, pose: Pose) -> Pose:
        """Return a pose of the whole body without fingers."""
        return Pose(self.skeleton, pose.root_position, np.ascontiguousarray(pose.rotation[..., self.joints, :]))

    def with_fingers(self, pose: Pose, whole: Pose) -> Pose:
        """Return a pose of the whole body: this pose, and the fingers of another one."""
        rotation = np.array(whole.rotation)
        rotation[..., self.joints, :] = pose.rotation
        return Pose(self.whole, pose.root_position, rotation)


def fit_limbs(
    pose: Pose, points: Array, measured: Array, seconds: float, placed: tuple[Array, Array] | None = None
) -> Pose:
    """Bend limbs so that `measured` wrists, ankles, elbows and knees are at their points.

    A limb bends in its plane. Hands and feet keep their world rotations. The corrections fade into the frames before
    and after, so that the limb does not jump.

    Args:
        pose: (T,).
        points: (T, P, 3) m, world: measured positions of tracked points, estimated positions of all others.
        measured: (T, P) bool: points that are tracked.
        seconds: time between frames.
        placed: `forward_kinematics` of the pose, if it is known.
    """
    skeleton, (position, world) = pose.skeleton, placed or _placed(pose)
    tips = {end: skeleton.index(end) for end in ENDS}
    legs = {tip for end, tip in tips.items() if end.endswith("ankle")}
    goals = {end: np.where(measured[:, [tip]], points[:, tip], position[:, tip]) for end, tip in tips.items()}
    bent = reach_all(pose, goals, (position, world))
    rotation = np.array(pose.rotation)
    for tip in tips.values():
        for joint in (skeleton.parents[skeleton.parents[tip]], skeleton.parents[tip], tip):
            rotation[measured[:, tip], joint] = bent.rotation[measured[:, tip], joint]
    met = Pose(skeleton, pose.root_position, rotation.copy())
    places = _placed(met)
    for tip in tips.values():
        middle = skeleton.parents[tip]
        seen, ends = measured[:, middle], measured[:, tip]
        if seen.any():
            angle = fade_offsets(_swivel(skeleton, places[0], tip, points)[:, None], seen, seconds)[:, 0]
            _turn_at_middle(skeleton, places, tip, points[seen], seen, rotation)
            if tip in legs:  # hands are met, as they touch things
                eased = _ease_stretch(met, tip, seen, ends, seconds, rotation)
                if eased is not met:
                    met, places = eased, _placed(eased)
            beside = ends & ~seen & (angle != 0)
            _turn_about_limb(skeleton, places, tip, angle[beside], beside, rotation)
        _fade_turns(pose, world, tip, seen | ends, seconds, rotation)
    return Pose(skeleton, pose.root_position, rotation)


def _ease_stretch(met: Pose, tip: int, seen: Array, ends: Array, seconds: float, rotation: Array) -> Pose:
    """Ease the stretch of nearly straight legs where their knee comes or goes and their ankle stays tracked.

    If the hip is 8 mm too far from the ankle, a measured knee keeps its bend and the ankle misses its point. A hidden
    knee would jump by 4 cm, because the ankle alone decides. So the ankle misses its point in these frames, too, by
    `MISS` at most, and less and less.

    Args:
        met: (T,) with the ends of limbs at their points.
        tip: the ankle.
        seen: (T,) bool: the knee is tracked; `rotation` bends the leg to it.
        ends: (T,) bool: the ankle is tracked.
        seconds: time between frames.
        rotation: (T, J, 4) local rotations, which are written.

    Returns:
        The pose `met`, changed in frames with a hidden knee.
    """
    skeleton, start = met.skeleton, met.skeleton.parents[met.skeleton.parents[tip]]
    lengths = skeleton.rest_offset[[skeleton.parents[tip], tip]]
    longest = float(np.linalg.norm(lengths, axis=-1).sum())
    position = np.asarray(forward_kinematics(Pose(skeleton, met.root_position, rotation))[0])
    along = position[:, tip] - position[:, start]
    length = np.linalg.norm(along, axis=-1)
    jump = np.zeros(len(seen))  # m, what eases the jump of the length into frames with a hidden knee
    for first, end in runs(~seen):
        for inside, edge, step in ((first, first - 1, -1), (end - 1, end, 1)):
            before = edge + step
            if not (0 <= edge < len(seen) and ends[inside] and ends[edge]):
                continue
            if min(length[inside], length[edge]) < NEARLY_STRAIGHT * longest:
                continue
            pace = length[edge] - length[before] if 0 <= before < len(seen) and seen[before] and ends[before] else 0.0
            off = float(np.clip(length[edge] + pace - length[inside], -MISS, MISS))
            steps = np.arange(1, end - first + 1)[::-step]
            share = 1 - smooth_step(np.clip(steps / max(1, round(FADE_TIME / seconds)), 0.0, 1.0))
            jump[first:end] += off * share
    beside = ends & ~seen & (jump != 0)
    if not beside.any():
        return met
    goal = position[:, start] + along * ((length + jump) / np.maximum(length, 1e-9))[:, None]
    bent = reach(met[beside], skeleton.points[tip], goal[beside])
    turned = np.array(met.rotation)
    turned[beside] = bent.rotation
    for joint in (start, skeleton.parents[tip], tip):
        rotation[beside, joint] = bent.rotation[:, joint]
    return Pose(skeleton, met.root_position, turned)


def _placed(pose: Pose) -> tuple[Array, Array]:
    """Return positions and world rotations of a pose."""
    position, world = forward_kinematics(pose)
    return np.asarray(position), np.asarray(world)


def _fade_turns(pose: Pose, world: Array, tip: int, tracked: Array, seconds: float, rotation: Array) -> None:
    """Fade the corrections of a limb from `tracked` (T,) frames into their neighbours, in local rotations (T, J, 4).

    Turns fade, not positions: a nearly straight leg bends far for a small change of its length.
    """
    if tracked.all() or not tracked.any():
        return
    skeleton, middle = pose.skeleton, pose.skeleton.parents[tip]
    first = skeleton.parents[middle]
    joints = [first, middle]
    before = np.asarray(pose.rotation)[:, joints]
    turn = quaternion_log(quaternion_multiply(quaternion_conjugate(before), rotation[:, joints]))
    turn = fade_offsets(np.asarray(turn).reshape(len(tracked), 6), tracked, seconds).reshape(-1, 2, 3)
    beside = ~tracked & turn.any(axis=(1, 2))
    local = quaternion_multiply(before[beside], quaternion_exp(turn[beside]))
    above = quaternion_multiply(world[beside, skeleton.parents[first]], local[:, 0])
    _set_limb(skeleton, tip, world[beside], above, quaternion_multiply(above, local[:, 1]), beside, rotation)


def fade_offsets(offset: Array, measured: Array, seconds: float) -> Array:
    """Extend offsets (T, N) of `measured` (T,) frames into the other frames, where they fade within `FADE_TIME`."""
    found, count = np.where(measured[:, None], offset, 0.0), max(1, round(FADE_TIME / seconds))
    for first, end in runs(~measured):
        for frame, steps in ((first - 1, np.arange(1, end - first + 1)), (end, np.arange(end - first, 0, -1))):
            if 0 <= frame < len(offset):
                share = np.clip(steps / min(count, end - first + 1), 0.0, 1.0)
                found[first:end] += (1 - smooth_step(share))[:, None] * offset[frame]
    return found


def _swivel(skeleton: Skeleton, position: Array, tip: int, points: Array) -> Array:
    """Return the angle (T,) rad in (-pi, pi] that turns a limb's middle joint to the side of its point (T, P, 3).

    `position` (T, P, 3) m is that of the body. The axis is the line from the first joint to the end. The angle is 0 for
    a straight limb.
    """
    middle = skeleton.parents[tip]
    start = position[:, skeleton.parents[middle]]
    axis = position[:, tip] - start
    axis = axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    current, wanted = (
        place - start - ((place - start) * axis).sum(axis=-1, keepdims=True) * axis
        for place in (position[:, middle], points[:, middle])
    )
    bent = np.minimum(np.linalg.norm(current, axis=-1), np.linalg.norm(wanted, axis=-1)) > STRAIGHT
    return np.where(bent, angle_about(axis, current, wanted), 0.0)


def _turn_about_limb(
    skeleton: Skeleton, places: tuple[Array, Array], tip: int, angle: Array, where: Array, rotation: Array
) -> None:
    """Turn a limb about the line from first joint to end; writes local rotations (T, J, 4) of frames `where`.

    `places` are positions and world rotations of the body in all frames.
    """
    position, world = (part[where] for part in places)
    middle = skeleton.parents[tip]
    axis = position[:, tip] - position[:, skeleton.parents[middle]]
    axis = axis / np.maximum(np.linalg.norm(axis, axis=-1, keepdims=True), 1e-9)
    turn = quaternion_exp(angle[:, None] * axis)
    above = quaternion_multiply(turn, world[:, skeleton.parents[middle]])
    _set_limb(skeleton, tip, world, above, quaternion_multiply(turn, world[:, middle]), where, rotation)


def _turn_at_middle(
    skeleton: Skeleton, places: tuple[Array, Array], tip: int, points: Array, where: Array, rotation: Array
) -> None:
    """Turn a limb so that middle and end reach their points; writes local rotations (T, J, 4) of frames `where`.

    `places` are positions and world rotations of the body in all frames.
    """
    middle = skeleton.parents[tip]
    first = skeleton.parents[middle]
    position, world = (part[where] for part in places)
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
    """Set world rotations of a limb's bones and keep that of its end; writes local rotations of frames `where`."""
    middle = skeleton.parents[tip]
    first = skeleton.parents[middle]
    parent = world[:, skeleton.parents[first]]
    for joint, base, to in ((first, parent, above), (middle, above, below), (tip, below, world[:, tip])):
        rotation[where, joint] = quaternion_canonical(quaternion_multiply(quaternion_conjugate(base), to))


def fit_trunk(pose: Pose, points: Array, measured: Array) -> Pose:
    """Turn the spine to point from head to pelvis if both are `measured` and the chest is not.

    The spine turns about the head as one piece. Head and pelvis keep their world rotations. The remaining error is the
    difference between the length of the spine and the measured distance.

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


def fit_hips(pose: Pose, points: Array, measured: Array, turned: Array, seconds: float) -> Pose:
    """Move the pose (T,) so that both hips are at their points if they are `measured`.

    Limbs bend as in `fit_limbs`. Collars turn to measured shoulders, and feet to measured balls.

    Args:
        pose: (T,).
        points: (T, P, 3) m, world.
        measured: (T, P) bool: points that are tracked.
        turned: (T, P) bool: points whose rotation is tracked.
        seconds: time between frames.
    """
    trunk, whole = Trunk.of(pose.skeleton), pose
    pose, points, measured = trunk.without_fingers(pose), points[:, trunk.points], measured[:, trunk.points]
    turned = turned[:, trunk.points]
    position = np.asarray(forward_kinematics(pose)[0])
    hips = pose.skeleton.indices(["left_hip", "right_hip"])
    seen = np.asarray(measured[:, hips].all(axis=1))
    off = fade_offsets((points - position)[:, hips].mean(axis=1), seen, seconds)
    pose = Pose(pose.skeleton, pose.root_position + off, pose.rotation)
    pose = _aim_joints(pose, "collar", "shoulder", points, measured & ~turned)
    placed = _placed(pose)
    pose = fit_limbs(pose, np.where(measured[..., None], points, placed[0]), measured, seconds, placed)
    pose = _aim_joints(pose, "ankle", "foot", points, measured & ~turned)
    return trunk.with_fingers(pose, whole)


def _aim_joints(pose: Pose, joint: str, end: str, points: Array, measured: Array) -> Pose:
    """Turn a joint of each side so that its `end` points to its `measured` point (T, P, 3).

    The end keeps its world rotation.
    """
    skeleton, (position, world), rotation = pose.skeleton, _placed(pose), np.array(pose.rotation)
    for side in ("left", "right"):
        first, last = skeleton.indices([f"{side}_{joint}", f"{side}_{end}"])
        where, above = measured[:, last], world[:, skeleton.parents[first]]
        start = position[where, first]
        own = quaternion_multiply(
            shortest_arc(position[where, last] - start, points[where, last] - start), world[where, first]
        )
        for k, base, to in ((first, above[where], own), (last, own, world[where, last])):
            rotation[where, k] = quaternion_canonical(quaternion_multiply(quaternion_conjugate(base), to))
    return Pose(skeleton, pose.root_position, rotation)
