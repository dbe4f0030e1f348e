"""Takes: completed recordings, and how each is written to a file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bodysense.body.person import Person
from bodysense.body.pose import forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_to_matrix
from bodysense.io.clip import Clip
from bodysense.io.markers.options import is_marker_file
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.sources.open import MarkerSource
from bodysense.tracking.estimate import Estimate

if TYPE_CHECKING:
    from bodysense.io.markers.gaps import FilledMarkers
    from bodysense.io.rigs.joint_file import JointFile
    from bodysense.sources.partial_motion import PartialMotion


@dataclass(frozen=True, eq=False)
class Take:
    """A completed recording."""

    clip: Clip  # at a constant rate, on the proportions inferred at the end
    estimate: Estimate  # of every tracked frame; of markers, if not causal, with the pose of `clip`
    person: Person  # the wearer, as inferred at the end
    time: np.ndarray  # (T,) s of the estimate's frames
    partial: PartialMotion | None = None  # the motion whose holes were filled, if it was one
    source: Path | None = None  # the BVH or FBX file that was tracked, if it was one
    reading: ReadingOptions = AS_FOUND  # its options
    file: JointFile | None = None  # the same with its holes filled
    markers: MarkerSource | None = None  # the marker file that was tracked, if it was one
    remarks: tuple[str, ...] = ()  # warnings: dropped labels, guessed limbs, a known height that was released

    def __repr__(self) -> str:
        error = 100 * self.estimate.confidence.mean()
        return f"Take({self.clip!r}, {self.person!r}, expected error {error:.1f} cm)"

    def save(self, path: str | Path, rig: str | Path | None = None) -> None:
        """Write the motion as .bvh, .fbx, .glb (animated glTF), .vrma (VRM avatars) or .mcap (robots' tools).

        A take of markers is also written as the kind of file that was tracked (.trc, .c3d, .tsv, .csv): the same file
        with the gaps of its markers filled.

        Args:
            path: output file; its ending determines the format.
            rig: target rig: one of `RIGS`, or a BVH or FBX file. 'source' is the rig of the tracked BVH or FBX file;
                if its holes were filled, it is the file itself with filled holes (of FBX its skeletons and motion).
                If omitted: 'source' if such a file of a whole body was filled and the output is of its kind, else our
                own rig.

        Raises BodysenseError for an unknown rig. Raises it also for a complete file whose unit, axis, floor or height
        was given, because its copy would not change, and for a filled file whose height was given.
        """
        path = Path(path)
        if is_marker_file(path):
            check_marker_output(path, self.markers, rig)
            assert self.markers is not None and self.markers.found is not None
            from bodysense.io.markers.filled import write_filled

            done = self.filled_markers
            world, raw = self.markers.found.world, self.markers.found.raw
            write_filled(self.markers.path, path, raw, world.to_file(done.position), done.filled)
            return
        from bodysense.io.motion_files import write_motion
        from bodysense.io.target_rigs.named import OWN, SOURCE, check_rig
        from bodysense.io.target_rigs.own_rig import write_on_rig_of

        if rig is None:
            kind = None if self.file is None else self.file.path.suffix.lower()
            rig = SOURCE if path.suffix.lower() == kind and not self.clip.lacks else OWN
        check_rig(path, rig, self.source)
        if rig == SOURCE and self.file is not None:
            assert self.partial is not None
            FilledFile(self.file, self.partial, self.person, self.time, self.reading).save(path)
        elif rig == SOURCE and self.source is not None:
            write_on_rig_of(path, self.clip, self.source, self.reading)
        else:
            write_motion(path, replace(self.clip, name=path.stem), rig)

    @cached_property
    def filled_markers(self) -> FilledMarkers:
        """Fill the gaps of the markers that were tracked. Raises BodysenseError for a take of anything else."""
        if self.markers is None or self.markers.found is None:
            raise BodysenseError("this take is of no labelled markers; track a .c3d, .trc, .tsv or .csv file of them")
        from bodysense.io.markers.filled import fillable
        from bodysense.io.markers.gaps import fill_markers

        raw, world = self.markers.found.raw, self.markers.found.world
        pose = self.estimate.pose
        rotation = quaternion_to_matrix(np.asarray(forward_kinematics(pose)[1]))
        count = len(pose.skeleton.joints)
        joint, error = self.estimate.points[:, :count], self.estimate.confidence[:, :count]
        done = fill_markers(world.to_ours(raw.position), joint, rotation, error, raw.frame_rate)
        return replace(done, filled=done.filled & fillable(raw))


@dataclass(frozen=True, eq=False)
class FilledFile:
    """A BVH or FBX file with filled holes, without the estimate behind it: that of an hour is 4 GB."""

    file: JointFile
    partial: PartialMotion  # the motion whose holes were filled, with the pose of its first frame alone
    person: Person
    time: np.ndarray  # (T,) s of the frames
    reading: ReadingOptions = AS_FOUND
    markers: None = None

    @property
    def clip(self) -> Clip:
        """The first frame of the motion, on our joints."""
        return self.partial.clip

    @property
    def remarks(self) -> tuple[str, ...]:
        """Doubts about the file."""
        return self.partial.clip.warnings

    def save(self, path: str | Path, rig: str | Path | None = None) -> None:
        """Write the file, on its own rig. Raises BodysenseError for options that would not change it."""
        if self.partial.is_whole and (given := self.reading.for_the_world()):
            raise BodysenseError(
                f"{self.file.path}: nothing is missing, and its own rig keeps the file's size and axes, so "
                f"{', '.join(given)} would change nothing; leave that out, or write it with --rig bodysense"
            )
        if self.reading.height is not None:
            raise BodysenseError(
                f"{self.file.path}: its own rig keeps the file's size, so --height {self.reading.height:g} would not "
                "change the body's; leave that out, or write it with --rig bodysense"
            )
        self.file.write(path)


def check_marker_output(path: Path, markers: MarkerSource | None, rig: str | Path | None = None) -> None:
    """Raise BodysenseError, before any work, if a marker file cannot be written for the tracked source."""
    if markers is None or markers.found is None:
        raise BodysenseError(
            f"{path}: only a file of labelled markers comes back as markers; give a name that ends in .bvh or .glb"
        )
    if rig is not None:
        raise BodysenseError(f"{path}: --rig {rig}: markers have no rig; leave --rig out")
    from bodysense.io.markers.filled import check_fillable

    check_fillable(markers.path, path, markers.found.raw)
