"""Conversion of a complete motion to another kind of file, another rig or another rate."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bodysense.errors import BodysenseError, expect
from bodysense.io.clip import Clip
from bodysense.io.motion_files import check_ending, write_motion
from bodysense.io.reading_options import AS_FOUND, ReadingOptions
from bodysense.io.resample import resample
from bodysense.io.target_rigs.named import OWN, SOURCE, check_rig
from bodysense.io.target_rigs.own_rig import write_on_rig_of
from bodysense.sources.open import MotionSource, Source, open_source


def convert(
    source: Source,
    out: str | Path,
    *,
    rig: str | Path = OWN,
    rate: float | None = None,
    reading: ReadingOptions = AS_FOUND,
) -> Clip:
    """Write a motion as another kind of file, and return it.

    Args:
        source: a motion: a file (.bvh, .fbx, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma), a Clip, or a source that
            `open_source` opened.
        out: .bvh, .fbx, .glb (animated glTF), .vrma (for VRM avatars) or .mcap (for robots' tools).
        rig: target rig: one of `RIGS`, or a BVH or FBX file; 'source' is the rig of the one that is read.
        rate: frames a second; that of the motion if omitted. Rotations are interpolated by slerp.
        reading: facts that the file omits: unit, upward axis, floor, height, joints, which body.

    Raises BodysenseError, naming the file and the fix, for a source that is no complete motion, and before any work for
    an output that cannot be written.
    """
    expect(out, (str, Path), "convert", "the path of the output: convert(source, path)")
    out = check_ending(Path(out))
    opened = open_source(source, reading)
    if not isinstance(opened, MotionSource):
        raise BodysenseError(
            f"{opened.name}: not a motion, and conversion tracks nothing; complete it: "
            f"bodysense track {Path(opened.name).name} -o {out.name}"
        )
    check_rig(out, rig, opened.joint_file)
    clip = opened.clip
    if clip.lacks:
        raise BodysenseError(
            f"{opened.name}: the body has no {' and no '.join(clip.lacks)}; complete it: "
            f"bodysense track {Path(opened.name).name} -o {out.name}"
        )
    if rate is not None:
        clip = resample(clip, rate)
    clip = replace(clip, name=out.stem)
    if rig == SOURCE and opened.joint_file is not None:
        write_on_rig_of(out, clip, opened.joint_file, opened.options)
    else:
        write_motion(out, clip, rig)
    return clip
