"""Motions with holes, opened: which values of a BVH or FBX file or a clip are missing."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.geometry import gaps
from bodysense.io.clip import Clip, part_joints
from bodysense.io.holes import Missing, flat_lined, missing_mask
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.rigged import open_joint_file, rigged_of
from bodysense.io.rigs.joint_file import JointFile

if TYPE_CHECKING:
    from bodysense.io.target_rigs.own_rig import SourceJoints

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class PartialMotion:
    """A motion with missing parts."""

    clip: Clip  # on our joints; arbitrary in missing parts
    rig: SourceJoints  # joints of the source
    holes: Array  # (T, J) bool: missing in the source
    missing: Array  # (T, J) bool: holes that remain after interpolating joints that carry the whole body
    trunk: Mapping[int, Array] = field(default_factory=dict)  # (T, 4) rotations of interpolated joints of a file
    file: JointFile | None = None  # the source, if it is a file
    line: str = ""  # description of the file's rig

    @property
    def rotation(self) -> Array:
        """(T, J, 4) local rotations of the source's joints, parent ← joint; arbitrary in missing parts."""
        return self.rotation_in(slice(None))

    def rotation_in(self, frames: slice, joints: Sequence[int] | None = None) -> Array:
        """Return the rotations (N, J, 4) in some frames, of all joints or the given ones."""
        chosen = range(len(self.rig.joints)) if joints is None else joints
        if self.file is None:
            return np.array(self.clip.pose.rotation[frames][:, list(chosen)], dtype=float)
        rotation = self.file.rotation_in(frames, joints)
        for place, joint in enumerate(chosen):
            if joint in self.trunk:
                rotation[:, place] = self.trunk[joint][frames]
        return rotation

    @property
    def is_whole(self) -> bool:
        """Whether nothing is missing."""
        return not self.holes.any() and not self.clip.lacks


def open_partial(
    source: Path | Clip, missing: Sequence[Missing], options: ReadingOptions = AS_FOUND, *, held: bool = True
) -> PartialMotion:
    """Open a BVH file, an FBX file or a clip with its holes: `missing` joints and NaN values.

    If no missing joints are given, limbs with constant values in the file are missing, too, unless `held` is false.

    Raises BodysenseError for invalid items, and if a joint that carries the whole body is missing in all frames.
    """
    if isinstance(source, Path):
        return _partial_file(source, missing, options, held and not missing)
    from bodysense.io.target_rigs.own_rig import own_joints

    clip = source
    lacking = part_joints(clip.lacks, clip.pose.skeleton.joints)
    rig, whole = own_joints(clip.pose.skeleton, lacking), np.asarray(clip.pose.rotation, dtype=float)
    holes = missing_mask(missing, rig.joints, rig.parents, len(clip), rig.ours)
    trunk, rest = _fill_trunk(clip.name, rig, lambda joint: whole[:, joint], holes, 1 / clip.frame_rate)
    rotation = np.array(whole)
    for joint, turns in trunk.items():
        rotation[:, joint] = turns
    return PartialMotion(replace(clip, pose=replace(clip.pose, rotation=rotation)), rig, holes, rest)


def _partial_file(path: Path, missing: Sequence[Missing], options: ReadingOptions, held: bool) -> PartialMotion:
    file = open_joint_file(path, options)
    clip, rig, line = _read(file, options)
    holes = missing_mask(missing, file.joints, file.parents, len(file.values), rig.ours) | ~file.has_number
    if held:
        holes |= flat_lined(file, rig)
    every, given = slice(None), file
    trunk, rest = _fill_trunk(
        str(path), rig, lambda joint: given.rotation_in(every, [joint])[:, 0], holes, 1 / file.frame_rate
    )
    rooted = holes & ~rest
    if rooted.any():
        file = file.without_places(rooted).mended.with_rotation(trunk, rooted)
        clip, rig, line = _read(file, options)
    return PartialMotion(clip, rig, holes, rest, trunk, file, f"read {path}: {line}")


def _read(file: JointFile, options: ReadingOptions) -> tuple[Clip, SourceJoints, str]:
    """Return the motion of a file on our joints, its own joints, and a line about its rig."""
    from bodysense.io.target_rigs.own_rig import joints_of_file

    rigged = rigged_of(file.mended, options)
    return rigged.clip, joints_of_file(file, rigged), rigged.rig.line()


def _fill_trunk(
    name: str, rig: SourceJoints, rotation_of: Callable[[int], Array], holes: Array, seconds: float
) -> tuple[dict[int, Array], Array]:
    """Interpolate joints that carry the whole body over their gaps; return their rotations and the remaining holes."""
    filled = {}
    if holes[:, rig.trunk].any():
        holes = holes.copy()
    for joint in rig.trunk:
        if holes[:, joint].all():
            raise BodysenseError(
                f"{name}: {rig.joints[joint]!r} is missing in every frame, and everything hangs on it; "
                f"give the frames in which it is, as {rig.joints[joint]}:10-40"
            )
        if holes[:, joint].any():
            filled[joint] = gaps.fill(rotation_of(joint), holes[:, joint], seconds)
            holes[:, joint] = False
    return filled, holes
