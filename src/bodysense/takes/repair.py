"""Repair of finished takes: defects become holes, which are filled, or are undone where the cure is known.

Spikes, pops, frozen limbs and backward knees are filled from the rest of the body and the frames around them. Swapped
limbs are given back to their sides, a sliding foot stands where it stood, a sunken one is lifted onto the floor.
Other frames are unchanged.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.footing import side_clearance
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.reach import reach
from bodysense.errors import BodysenseError
from bodysense.geometry.gaps import runs
from bodysense.geometry.series import fade_out
from bodysense.io.clip import Clip
from bodysense.io.holes import Missing
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.quality.defects import Defect, find_defects
from bodysense.quality.foot_defects import foot_motion
from bodysense.quality.joint_defects import LIMBS
from bodysense.sources.open import MotionSource, Source, open_source
from bodysense.sources.partial_motion import open_partial
from bodysense.takes.filling import with_world_rotations
from bodysense.takes.take import Take
from bodysense.takes.track import Completion, fill_take
from bodysense.tracking.tracker import TrackerSettings

POP_SECONDS = 0.1  # s before and after a pop that are filled, so that the joint goes over smoothly
FADE = 0.3  # s in which a held foot returns to its own path after it is lifted
DRIFT = 0.06  # m/s; frames beside a slide in which the foot is faster belong to it
FARTHEST = 0.35  # m; a foot that slides farther is left, since its legs would not reach
LEG = ("hip", "knee", "ankle")
_MIRROR = np.array([1.0, 1.0, -1.0, -1.0])  # of a quaternion, left for right


@dataclass(frozen=True, eq=False)
class Repair:
    """A repaired take and the defects that were found in it."""

    take: Take
    defects: tuple[Defect, ...]
    remaining: tuple[Defect, ...]  # of the same kinds, found after the repair

    def save(self, path: str | Path, rig: str | Path | None = None) -> None:
        """Write the repaired motion like `Take.save`; a BVH or FBX file keeps its own rig."""
        self.take.save(path, rig)


def repair(
    source: Source,
    *,
    only: Collection[str] = (),
    reading: ReadingOptions = AS_FOUND,
    settings: TrackerSettings = TrackerSettings(),
) -> Repair:
    """Find the defects of a motion and repair them.

    Args:
        source: a motion: a file, a Clip, or a source that `open_source` opened.
        only: kinds of defects, of `quality.defects.KINDS`; all if empty.
        reading: facts that the file omits.
        settings: floor and whether feet are held where limbs are filled.

    Raises BodysenseError, naming the file and the fix, for a source that is no whole motion, and for unknown kinds.
    """
    opened = checked_motion(source, reading)
    defects = find_defects(opened.clip.pose, opened.clip.frame_rate, only)
    holes = _holes(defects, opened.clip)
    partial = open_partial(opened.joint_file or opened.clip, [], opened.options, held=False)
    holes = [
        replace(hole, name=partial.rig.joints[partial.rig.ours[hole.name]])
        for hole in holes
        if hole.name in partial.rig.ours
    ]
    partial = open_partial(opened.joint_file or opened.clip, holes, opened.options, held=False) if holes else partial
    completion = Completion(settings, None, False, lambda done, frames: None)
    take = replace(fill_take(partial, completion), source=opened.joint_file, reading=opened.options)
    take = _edited(take, defects)
    return Repair(
        take,
        tuple(defects),
        tuple(find_defects(take.clip.pose, take.clip.frame_rate, only or {defect.kind for defect in defects})),
    )


def checked_motion(source: Source, reading: ReadingOptions = AS_FOUND) -> MotionSource:
    """Open a whole motion. Raises BodysenseError, with the way on, for anything else."""
    opened = open_source(source, reading)
    if not isinstance(opened, MotionSource):
        name = Path(opened.name).name
        raise BodysenseError(f"{opened.name}: not a motion; complete it first: bodysense track {name} -o motion.bvh")
    if opened.clip.lacks:
        name = Path(opened.name).name
        raise BodysenseError(
            f"{opened.name}: the body has no {' and no '.join(opened.clip.lacks)}; complete it first: "
            f"bodysense track {name} -o motion.bvh"
        )
    return opened


def _holes(defects: Sequence[Defect], clip: Clip) -> list[Missing]:
    """Return the joints and frames that are filled."""
    holes: list[Missing] = []
    for defect in defects:
        beside = round(POP_SECONDS * clip.frame_rate) if defect.kind == "pop" else 0
        if defect.kind in ("spike", "pop", "freeze", "knee"):
            span = max(0, defect.first - beside), min(len(clip) - 1, defect.last + max(0, beside - 1))
            holes.append(Missing(defect.joint, frames=span))
    return holes


def _edited(take: Take, defects: Sequence[Defect]) -> Take:
    """Undo swaps, slides and sunken feet in a filled take."""
    partial, clip = take.partial, take.clip
    assert partial is not None
    pose, changed = clip.pose, np.zeros(np.asarray(clip.pose.rotation).shape[:2], dtype=bool)
    for defect in defects:
        if defect.kind == "swap":
            pose = _unswapped(pose, defect, changed)
    feet = {defect.joint for defect in defects if defect.kind == "slide"}
    for side in ("left", "right"):
        spans = [(d.first, d.last + 1) for d in defects if d.kind == "slide" and d.joint == f"{side}_ankle"]
        if f"{side}_ankle" in feet:
            pose = _moved_foot(pose, side, _held(replace(clip, pose=pose), side, spans), changed)
        spans = [(d.first, d.last + 1) for d in defects if d.kind == "floor" and d.joint == f"{side}_ankle"]
        if spans:
            pose = _moved_foot(pose, side, _lifted(replace(clip, pose=pose), side, spans), changed)
    if not changed.any():
        return take
    rig, skeleton = partial.rig, pose.skeleton
    if take.file is None:
        return replace(take, clip=replace(clip, pose=pose))
    where = np.zeros((len(clip), len(rig.joints)), dtype=bool)
    for name, joint in rig.ours.items():
        if name in skeleton.joints:
            where[:, joint] = changed[:, skeleton.index(name)]
    rotation = with_world_rotations(rig, take.file.rotation, rig.world(pose), where)
    return replace(
        take,
        clip=replace(clip, pose=pose),
        file=take.file.with_rotation(dict(enumerate(np.moveaxis(rotation, 1, 0))), where),
    )


def _unswapped(pose: Pose, defect: Defect, changed: np.ndarray) -> Pose:
    """Return the pose with a limb's motion given back to its side; `changed` (T, J) is marked."""
    rotation, frames = np.array(pose.rotation), slice(defect.first, defect.last + 1)
    parts = next(parts for parts in LIMBS.values() if defect.joint.removeprefix("left_") in parts)
    left, right = (pose.skeleton.indices([f"{side}_{part}" for part in parts]) for side in ("left", "right"))
    across = rotation[frames][:, right] * _MIRROR
    rotation[frames, right] = rotation[frames][:, left] * _MIRROR
    rotation[frames, left] = across
    changed[frames, left] = changed[frames, right] = True
    return replace(pose, rotation=rotation)


def _held(clip: Clip, side: str, spans: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return shifts (T, 3) m of an ankle that let a sliding foot stand where it stood before, or stands after."""
    place = np.asarray(forward_kinematics(clip.pose)[0])
    foot = foot_motion(clip.pose, clip.frame_rate, side)
    ankle, stands = place[:, clip.pose.skeleton.index(f"{side}_ankle")], foot.stands
    drifts = stands & (foot.along > DRIFT)
    shift, fade = np.zeros_like(ankle), round(FADE * clip.frame_rate)
    for first, end in (_wider(drifts, *span) for span in spans):
        is_led = not (first and stands[first - 1]) and end < len(stands) and bool(stands[end])
        anchor = ankle[min(end, len(ankle) - 1)] if is_led else ankle[max(first - 1, 0)]
        own = np.zeros_like(ankle)
        own[first:end] = anchor - ankle[first:end]
        own[:, 1] = 0
        if np.linalg.norm(own, axis=1).max() > FARTHEST:
            continue
        step, edge = (-1, first - 1) if is_led else (1, end)
        last = own[first if is_led else end - 1].copy()
        while 0 <= edge < len(stands) and stands[edge]:  # it keeps its place until it is lifted
            own[edge] = last
            edge += step
        for frame, share in zip(range(edge, edge + step * fade, step), fade_out(fade), strict=True):
            if 0 <= frame < len(own):
                own[frame] = share * last
        shift += own
    return shift


def _wider(drifts: np.ndarray, first: int, end: int) -> tuple[int, int]:
    """Return a span extended by the adjacent frames (T,) in which the foot drifts."""
    while first > 0 and drifts[first - 1]:
        first -= 1
    while end < len(drifts) and drifts[end]:
        end += 1
    return first, end


def _lifted(clip: Clip, side: str, spans: Sequence[tuple[int, int]]) -> np.ndarray:
    """Return shifts (T, 3) m that lift a foot onto the floor, and fade on either side."""
    depth = np.maximum(0.0, -side_clearance(np.asarray(forward_kinematics(clip.pose)[0]), clip.pose.skeleton, side))
    shift, fade = np.zeros((len(depth), 3)), max(1, round(FADE / 2 * clip.frame_rate))
    sunken = np.zeros(len(depth), dtype=bool)
    for first, end in spans:
        sunken[first:end] = True
    for first, end in runs(sunken):
        own = np.zeros(len(depth))
        own[first:end] = depth[first:end]
        for count, share in enumerate(fade_out(fade), start=1):
            for frame, edge in ((first - count, first), (end - 1 + count, end - 1)):
                if 0 <= frame < len(own) and not sunken[frame]:
                    own[frame] = max(own[frame], share * depth[edge])
        shift[:, 1] = np.maximum(shift[:, 1], own)
    return shift


def _moved_foot(pose: Pose, side: str, shift: np.ndarray, changed: np.ndarray) -> Pose:
    """Return the pose with an ankle shifted (T, 3) m; `changed` (T, J) is marked."""
    moved = shift.any(axis=1)
    if not moved.any():
        return pose
    ankle = np.asarray(forward_kinematics(pose)[0])[:, pose.skeleton.index(f"{side}_ankle")]
    bent = reach(pose, f"{side}_ankle", ankle + shift)
    rotation, leg = np.array(pose.rotation), pose.skeleton.indices([f"{side}_{part}" for part in LEG])
    for joint in leg:
        rotation[moved, joint] = np.asarray(bent.rotation)[moved, joint]
        changed[moved, joint] = True
    return replace(pose, rotation=rotation)
