"""Motion files; the file name's ending selects the format."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.files import check_place, part_beside
from bodysense.io.clip import Clip
from bodysense.io.formats.bvh import BvhStream, read_bvh, write_bvh
from bodysense.io.target_rigs.named import OWN, check_rig, is_rig_file, on_rig, renamed
from bodysense.io.target_rigs.own_rig import write_on_rig_of

ENDINGS = (".bvh", ".fbx", ".glb", ".vrma", ".mcap")


def check_ending(path: Path) -> Path:
    """Return the path of an output file. Raises BodysenseError if its ending is unknown."""
    check_place(path)
    if path.suffix.lower() not in ENDINGS:
        found = f"the output ends in {path.suffix!r}" if path.suffix else "the output has no ending"
        raise BodysenseError(f"{path}: {found}; give a name that ends in {', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}")
    if path.suffix.lower() == ".mcap":
        from bodysense.io.formats.mcap_take import load_writer

        load_writer()
    return path


def write_motion(path: Path, clip: Clip, rig: str | Path = OWN) -> None:
    """Write a clip as BVH, FBX, glTF (.glb), VRM animation (.vrma) or MCAP take (.mcap).

    `rig` is one of `RIGS`, or a file whose rig is taken.

    Raises BodysenseError as the writers do, and for a rig that is unknown or that this kind of file cannot have.
    """
    ending = check_ending(path).suffix.lower()
    check_rig(path, rig, None)
    if is_rig_file(rig):
        write_on_rig_of(path, clip, Path(rig))
        return
    if ending == ".mcap":
        from bodysense.io.formats.mcap_take import write_mcap

        write_mcap(path, clip)
        return
    from bodysense.io.formats.fbx.writer import write_fbx
    from bodysense.io.formats.gltf.vrma import write_vrma
    from bodysense.io.formats.gltf.writer import write_glb

    if ending == ".vrma":
        write_vrma(path, clip)
        return
    clip, names = on_rig(clip, str(rig))
    if ending == ".glb":
        write_glb(path, clip, names)
    elif ending == ".fbx":
        write_fbx(path, clip, names)
    else:
        write_bvh(path, renamed(clip, names))


@contextmanager
def motion_stream(path: Path, skeleton: Skeleton, frame_rate: float, rig: str = OWN) -> Iterator[BvhStream]:
    """Return a writer of motion frame by frame; the file appears at the end of the block, if there was any frame.

    Formats other than .bvh, and rigs other than ours, are converted at the end.
    """
    check_rig(check_ending(path), rig, None)
    if path.suffix.lower() == ".bvh" and rig == OWN:
        with BvhStream(path, skeleton, frame_rate) as motion:
            yield motion
        return
    with _folder_beside(path) as folder:
        whole = folder / f"{path.stem}.bvh"
        with BvhStream(whole, skeleton, frame_rate) as motion:
            yield motion
        if motion.frames:
            read = read_bvh(whole)
            order = read.pose.skeleton.indices(skeleton.joints)
            # A BVH file does not name the ends of fingers and toes.
            pose = Pose(skeleton, read.pose.root_position, read.pose.rotation[:, order])
            write_motion(path, Clip(path.stem, pose, frame_rate), rig)


@contextmanager
def _folder_beside(path: Path) -> Iterator[Path]:
    """Create a hidden folder next to an output file; it is removed at the end of the block."""
    folder = part_beside(path.with_suffix(""))
    folder.mkdir()
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)
