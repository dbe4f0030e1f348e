"""Motions with holes, opened: which values of a BVH or FBX file or a clip are missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    rotation: Array  # (T, J, 4) of the source's joints, parent ← joint; arbitrary in missing parts
    holes: Array  # (T, J) bool: missing in the source
    missing: Array  # (T, J) bool: holes that remain after interpolating joints that carry the whole body
    file: JointFile | None = None  # the source, if it is a file
    line: str = ""  # description of the file's rig

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
    rotation, rest = _fill_trunk(clip.name, rig, whole, holes, 1 / clip.frame_rate)
    return PartialMotion(replace(clip, pose=replace(clip.pose, rotation=rotation)), rig, rotation, holes, rest)


def _partial_file(path: Path, missing: Sequence[Missing], options: ReadingOptions, held: bool) -> PartialMotion:
    file = open_joint_file(path, options)
    clip, rig, line = _read(file, options)
    holes = missing_mask(missing, file.joints, file.parents, len(file.values), rig.ours) | ~file.has_number
    if held:
        holes |= flat_lined(file, rig)
    rotation, rest = _fill_trunk(str(path), rig, file.rotation, holes, 1 / file.frame_rate)
    rooted = holes & ~rest
    if rooted.any():
        file = file.without_places(rooted).mended.with_rotation(rotation, rooted)
        clip, rig, line = _read(file, options)
    return PartialMotion(clip, rig, rotation, holes, rest, file, f"read {path}: {line}")


def _read(file: JointFile, options: ReadingOptions) -> tuple[Clip, SourceJoints, str]:
    """Return the motion of a file on our joints, its own joints, and a line about its rig."""
    from bodysense.io.target_rigs.own_rig import joints_of_file

    rigged = rigged_of(file.mended, options)
    return rigged.clip, joints_of_file(file, rigged), rigged.rig.line()


def _fill_trunk(name: str, rig: SourceJoints, rotation: Array, holes: Array, seconds: float) -> tuple[Array, Array]:
    """Interpolate joints that carry the whole body over their gaps; return rotations and remaining holes."""
    rotation, holes = rotation.copy(), holes.copy()
    for joint in rig.trunk:
        if holes[:, joint].all():
            raise BodysenseError(
                f"{name}: {rig.joints[joint]!r} is missing in every frame, and everything hangs on it; "
                f"give the frames in which it is, as {rig.joints[joint]}:10-40"
            )
        rotation[:, joint] = gaps.fill(rotation[:, joint], holes[:, joint], seconds)
        holes[:, joint] = False
    return rotation, holes
