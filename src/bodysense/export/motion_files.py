"""Motions as files, their format chosen by the ending of the name."""

from __future__ import annotations

from pathlib import Path

from bodysense.data.bvh import write_bvh
from bodysense.data.clip import Clip
from bodysense.errors import BodysenseError
from bodysense.export.gltf import write_glb
from bodysense.export.vrma import write_vrma
from bodysense.files import check_place

_WRITERS = {".bvh": write_bvh, ".glb": write_glb, ".vrma": write_vrma}
ENDINGS = tuple(_WRITERS)


def check_ending(path: Path) -> Path:
    """Return the path of a motion to be written; raise BodysenseError, before any work, for one that cannot be."""
    check_place(path)
    if path.suffix.lower() not in _WRITERS:
        raise BodysenseError(
            f"{path}: the output ends in {path.suffix or 'nothing'!r}; give a name that ends in .bvh, .glb or .vrma"
        )
    return path


def write_motion(path: Path, clip: Clip) -> None:
    """Write a clip as BVH, glTF (.glb) or VRM animation (.vrma); raises BodysenseError as their writers do."""
    _WRITERS[check_ending(path).suffix.lower()](path, clip)
