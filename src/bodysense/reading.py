"""Files as what they hold: `read` gives a motion or a recording, `write` writes either."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bodysense.arrays import conversion
from bodysense.body.skeleton import default_skeleton
from bodysense.devices.video.pictures import is_video
from bodysense.errors import BodysenseError
from bodysense.io.archive import ZIP
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import Source, as_told, read_with_rig
from bodysense.io.gltf import motion as io_gltf
from bodysense.io.markers.files import is_marker_file
from bodysense.io.markers.recording import read_markers, with_hands_of
from bodysense.io.motion_files import ENDINGS, write_motion
from bodysense.io.recording import Recording, is_recording, read_recording, write_recording
from bodysense.io.rigs.options import AS_FOUND, ReadingOptions
from bodysense.io.smpl import PICKLES, is_smpl, read_smpl

MOTION_ENDINGS = (".bvh", ".npz", ".npy", *io_gltf.ENDINGS)
RECORDING_ENDINGS = (".npz", ".jsonl")


def read(path: str | Path, options: ReadingOptions = AS_FOUND) -> Clip | Recording:
    """Read a motion (.bvh, AMASS or SMPL .npz, .npy, .glb, .gltf, .vrma) as a Clip.

    A recording or markers (.c3d, .csv, .trc, .tsv) are read as a Recording.

    A clip is in canonical form: metres, +Y up, the skeleton of 65 points. Of a motion, `options` say what the file does
    not or says wrongly: unit, upward axis, floor, height, joints, which body. Raises BodysenseError, naming the file
    and the fix, for every other file.
    """
    path = Path(path)
    if is_video(str(path)):
        raise BodysenseError(f"{path}: a video is read while it is tracked; give it to track")
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file")
    if is_marker_file(path):
        found = read_markers(path)
        body = with_hands_of(default_skeleton(), found.sizes)
        return Recording(found.observation, body, told=not found.has_body, hands_shown=bool(found.sizes))
    if is_recording(path):
        return read_recording(path)
    return read_clip(path, options)[0]


def read_clip(
    path: str | Path, options: ReadingOptions = AS_FOUND, rate: float | None = None
) -> tuple[Clip, tuple[str, ...]]:
    """Read a motion in canonical form, and lines on what was recognised; `rate` Hz where its file does not say it.

    Raises BodysenseError, naming the file and the fix, for every other file.
    """
    path = Path(path)
    if not path.is_file():
        raise BodysenseError(f"{path}: no such file")
    check_kind(path)
    if is_smpl(path):
        clip, remarks = read_smpl(path, rate)
        return as_told(clip, options, "results of SMPL", "y"), tuple(f"note: {remark}" for remark in remarks)
    if rate is not None:
        raise BodysenseError(f"{path}: the file says its frame rate; leave --rate {rate:g} out")
    if path.suffix.lower() in io_gltf.ENDINGS:
        clip, remarks = io_gltf.read_gltf(path, options.joints)
        return as_told(clip, replace(options, joints=None), "glTF files", "y"), tuple(
            f"note: {remark}" for remark in remarks
        )
    if path.suffix.lower() not in (*MOTION_ENDINGS, ZIP):
        raise BodysenseError(f"{path}: unknown kind of file {path.suffix!r}; valid are {', '.join(MOTION_ENDINGS)}")
    clip, rig = read_with_rig(Source(path, person="", split="test"), options)
    return clip, () if rig is None else (f"read {path}: {rig.line()}",)


def check_kind(path: str | Path) -> None:
    """Raise BodysenseError, with what to do, for kinds of files that are never read: FBX, gzip, pickles."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".gz":
        raise BodysenseError(f"{path}: compressed by gzip; unpack it: gunzip -k {path.name}")
    if ending in PICKLES:
        raise BodysenseError(f"{path}: a pickle may run any code when it is read; {conversion(path)}")
    if ending == ".fbx":
        load = f"import bpy; bpy.ops.import_scene.fbx(filepath='{path.name}')"
        raise BodysenseError(
            f"{path}: FBX is not read; convert it with Blender: "
            f"blender -b --python-expr \"{load}; bpy.ops.export_scene.gltf(filepath='{path.stem}.glb')\""
        )


def write(path: str | Path, content: Clip | Recording) -> None:
    """Write a clip (.bvh, .glb, .vrma, .mcap) or a recording (.npz, .jsonl); the file appears whole or not at all.

    Raises BodysenseError where the ending is of another kind of file.
    """
    path = Path(path)
    if isinstance(content, Clip):
        write_motion(path, content)
    elif path.suffix.lower() in ENDINGS:
        raise BodysenseError(
            f"{path}: a recording is no motion; complete it first: track(recording).save({path.name!r}), "
            f"or give a name that ends in {' or '.join(RECORDING_ENDINGS)}"
        )
    else:
        write_recording(path, content)
