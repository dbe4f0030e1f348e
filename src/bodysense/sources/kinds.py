"""Kinds of sources: what a path that a user gives is, or why it cannot be read and what to do."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from bodysense.arrays import array_shapes
from bodysense.errors import BodysenseError, did_you_mean
from bodysense.io.formats.archive import ZIP
from bodysense.io.formats.headset_log import is_headset_log
from bodysense.io.formats.pickled import ENDINGS as PICKLES
from bodysense.io.formats.recording import is_recording
from bodysense.io.markers.options import ENDINGS as MARKER_ENDINGS
from bodysense.io.markers.options import is_marker_file

GLTF = (".glb", ".gltf", ".vrma", ".vrm")
MANY_KINDS = (".npz", ".npy", *PICKLES)  # motions, recordings or joint positions, depending on their content
MOTION_ENDINGS = (".bvh", ".fbx", ".mvnx", ".npz", ".npy", *GLTF, *PICKLES)
TRACKED_ENDINGS = (*MOTION_ENDINGS, ".jsonl", *MARKER_ENDINGS)  # of the files of a folder; videos are given by name
Kind = Literal["motion", "recording", "markers", "video"]

# First bytes of a file, where they are, and the endings of such files; the first one is proposed.
_CONTENTS: tuple[tuple[bytes, int, tuple[str, ...]], ...] = (
    (b"HIERARCHY", 0, (".bvh",)),
    (b"Kaydara FBX", 0, (".fbx",)),
    (b"glTF", 0, (".glb", ".vrm", ".vrma")),
    (b"\x93NUMPY", 0, (".npy",)),
    (b"PathFileType", 0, (".trc",)),
    (b"ftyp", 4, (".mp4", ".m4v", ".mov", ".3gp")),
)
_HEAD = 16  # bytes that are read of a file

# Unsupported files that users often have, and the fix for each.
_UNSUPPORTED = {
    ".mvn": "Xsens's own format is not read; export the take as .mvnx or .bvh: File, Export, in MVN",
    ".vmd": "VMD, a motion of MikuMikuDance, is not read; import model and motion in Blender with MMD Tools, and "
    "export them as .glb or .bvh",
    ".json": "JSON of key points or of SMPL is not read: of a picture (OpenPose, AlphaPose …) give the video itself; "
    "write places in space as .csv (NAME.x, NAME.y, NAME.z) or .npy, and parameters of SMPL with numpy.savez, as "
    "'poses' and 'trans'",
    ".asf": "a skeleton without motion; convert it and its .amc to BVH (the library has its takes as BVH, too), or "
    "import both in Blender and export them as .bvh or .glb",
    ".amc": "AMC, a motion of an ASF skeleton, is not read; convert it to BVH (the library has its takes as BVH, too), "
    "or import it in Blender and export it as .bvh or .glb",
    ".mot": "joint angles of OpenSim are not read; track the markers they come from (.trc), or convert them to "
    "joint places with OpenSim (Analyze, PointKinematics) and save those as .trc",
    ".sto": "a table of OpenSim is not read; track the markers it comes from (.trc), or convert it to joint places "
    "with OpenSim (Analyze, PointKinematics) and save those as .trc",
    **{
        ending: f"{name} is not read; convert it with Blender: import it and export it as .glb, or: blender -b "
        f"--python-expr \"import bpy; bpy.ops.wm.{call}(filepath='scene{ending}'); "
        "bpy.ops.export_scene.gltf(filepath='scene.glb')\""
        for ending, name, call in (
            (".usd", "USD", "usd_import"),
            (".usda", "USD", "usd_import"),
            (".usdc", "USD", "usd_import"),
            (".usdz", "USD", "usd_import"),
            (".dae", "Collada", "collada_import"),
        )
    },
}


def kind_of(source: str | Path) -> Kind:
    """Return the kind of a file, a folder of images or a webcam's index.

    Raises BodysenseError, with the fix, for a file that does not exist, is empty or is of another kind than its ending,
    and for kinds that are never read.
    """
    path, typed = _checked_path(source)
    ending = path.suffix.lower()
    from bodysense.devices.video.pictures import VIDEOS, is_video

    if is_video(typed) and not path.is_file():
        _check_images(path)
        return "video"
    if not path.is_file():
        raise _missing(path, typed)
    check_kind(path)
    _check_content(path)
    if is_video(typed):
        return "video"
    if ending in MOTION_ENDINGS and ending not in MANY_KINDS:
        return "motion"
    if is_marker_file(path):
        return "recording" if is_headset_log(path) else "markers"
    if is_recording(path):
        return "recording"
    if ending not in (*MOTION_ENDINGS, ZIP):
        what = f"unknown kind of file {path.suffix!r}" if ending.strip(".") else "a name without an ending"
        raise BodysenseError(
            f"{path}: {what}; valid are motions ({', '.join(MOTION_ENDINGS)}), markers "
            f"({', '.join(MARKER_ENDINGS)}), recordings (.npz, .jsonl) and videos ({', '.join(VIDEOS)}, or images); "
            "give the file the ending of its kind, or export it as one of these"
        )
    return "motion"


def _checked_path(source: str | Path) -> tuple[Path, str]:
    """Return a path, and the text that was typed. Raises BodysenseError for text that no file system takes."""
    typed = str(source)
    if not typed.strip():
        raise BodysenseError(
            f"{typed!r}: an empty path; give a file, a folder of images or a webcam's index, such as 0"
        )
    if not typed.isprintable():
        raise BodysenseError(f"{typed!r}: no such file; remove the characters of the name that are not printed")
    path = Path(source)
    try:
        path.exists()
    except OSError as error:
        raise BodysenseError(f"{typed}: {error.strerror}; give an existing file") from None
    return path, typed


def _missing(path: Path, typed: str) -> BodysenseError:
    """Return the error about a file that does not exist, with the nearest names of its folder."""
    scheme, is_address, rest = typed.partition(":/")
    if is_address and len(scheme) > 1:  # one letter is a drive
        address = typed if rest.startswith("/") else f"{scheme}://{rest}"  # a path has dropped the second slash
        way = f"give its path, /{rest.lstrip('/')}" if scheme.lower() == "file" else "download it first"
        return BodysenseError(f"{address}: an address, and only files are read; {way}")
    folder = path.parent
    if not folder.is_dir():
        return BodysenseError(
            f"{path}: no such file; {folder} is {'a file' if folder.exists() else 'no folder'}; give an existing file"
        )
    try:
        near = did_you_mean(path.name, sorted(one.name for one in folder.iterdir()))
    except OSError:
        near = ""
    return BodysenseError(f"{path}: no such file; {near or 'give a file of ' + str(folder.resolve())}")


def _check_content(path: Path) -> None:
    """Raise BodysenseError for an empty file, and for one whose content is of another kind than its ending."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as error:
        raise BodysenseError(f"{path}: cannot be read ({error.strerror}); is it yours to read?") from None
    if not head:
        raise BodysenseError(f"{path}: the file is empty; copy or export it again")
    for begin, place, endings in _CONTENTS:
        if head[place : place + len(begin)] == begin and path.suffix.lower() not in endings:
            name = path.with_suffix(endings[0]).name if path.suffix else f"{path.name.rstrip('.')}{endings[0]}"
            has = f"its ending is {path.suffix}" if path.suffix.strip(".") else "its name has no ending"
            raise BodysenseError(f"{path}: a file of kind {endings[0]} by its content, but {has}; rename it: {name}")


def check_kind(path: str | Path) -> None:
    """Raise BodysenseError, with the fix, for unsupported kinds of files: gzip, USD, results of ROMP …"""
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".gz":
        raise BodysenseError(f"{path}: compressed by gzip; unpack it: gunzip -k {path.name}")
    if ending in _UNSUPPORTED:
        raise BodysenseError(f"{path}: {_UNSUPPORTED[ending]}")
    if ending == ".npz" and "results" in array_shapes(path):
        raise BodysenseError(
            f"{path}: results of ROMP or BEV, a pickle within an archive, which may run any code when it is read; "
            "save a person's 'smpl_thetas' (T, 72) as 'poses' and 'cam_trans' (T, 3) as 'trans' with numpy.savez"
        )


def _check_images(path: Path) -> None:
    """Raise BodysenseError, with the fix, for a folder without images."""
    if not path.is_dir():
        return
    from bodysense.devices.video.pictures import IMAGES, has_images

    if not has_images(path):
        files = sorted(path.iterdir())
        endings = {file.suffix.lower() for file in files}
        usable = next((file for file in files if file.suffix.lower() in TRACKED_ENDINGS), None)
        never = sorted(endings & _UNSUPPORTED.keys())
        fix = _UNSUPPORTED[never[0]] if never else f"give one file, or a folder of {', '.join(IMAGES)}"
        if usable is not None:
            fix = f"give one of its files, such as {usable}, or all of them: bodysense track {path} -o OUT"
        raise BodysenseError(f"{path}: a folder without images; {fix}")
