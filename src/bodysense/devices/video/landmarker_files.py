"""Model files of MediaPipe: from a given folder or from the cache, into which they are fetched once and checked."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from bodysense.errors import BodysenseError
from bodysense.files import cache_folder, written_beside

POSE_LANDMARKER = "pose_landmarker_full.task"
HAND_LANDMARKER = "hand_landmarker.task"
_SITE = "https://storage.googleapis.com/mediapipe-models"
OFFICIAL = {  # address and SHA-256 of Google's files
    POSE_LANDMARKER: (
        f"{_SITE}/pose_landmarker/pose_landmarker_full/float16/1/{POSE_LANDMARKER}",
        "4eaa5eb7a98365221087693fcc286334cf0858e2eb6e15b506aa4a7ecdcec4ad",
    ),
    HAND_LANDMARKER: (
        f"{_SITE}/hand_landmarker/hand_landmarker/float16/1/{HAND_LANDMARKER}",
        "fbc2a30080c3c557093b5ddfc334698132eb341044ccee322ccf8bcf3607cde1",
    ),
}
_TIMEOUT = 20.0  # s


@dataclass(frozen=True)
class LandmarkerFiles:
    """Paths of the two models."""

    pose: Path
    hand: Path


def landmarker_folder() -> Path:
    """Return the folder of the model files in the user's cache."""
    return cache_folder() / "landmarkers"


def find_landmarkers(folder: Path | None = None) -> LandmarkerFiles:
    """Return the model files in `folder`, or in the cache if it is None; fetch files that the cache lacks.

    Raises BodysenseError if a file is missing and cannot be fetched.
    """
    folder = find_files(folder, OFFICIAL)
    return LandmarkerFiles(folder / POSE_LANDMARKER, folder / HAND_LANDMARKER)


def find_files(folder: Path | None, wanted: Mapping[str, tuple[str, str]]) -> Path:
    """Return the folder of the files: `folder`, or the cache if it is None; fetch files that the cache lacks.

    `wanted` maps names of files to their addresses and SHA-256. Raises BodysenseError if a file is missing and cannot
    be fetched.
    """
    if folder is None:
        folder = landmarker_folder()
        for name, (address, checksum) in wanted.items():
            if not (folder / name).is_file():
                _fetch(address, folder / name, checksum)
    for name in wanted:
        if not (folder / name).is_file():
            raise BodysenseError(f"--landmarkers {folder}: there is no {name}; docs/video.md tells how to get it")
    return folder


def _fetch(address: str, path: Path, checksum: str) -> None:
    """Fetch a file; raise BodysenseError if it cannot be fetched or has another SHA-256."""
    from urllib.request import urlopen

    try:
        with urlopen(address, timeout=_TIMEOUT) as answer:
            content = answer.read()
    except OSError as error:
        reason = getattr(error, "reason", None) or error
        raise BodysenseError(
            f"{address} cannot be fetched ({reason}); put {path.name} into {path.parent} yourself, by "
            "scripts/build_landmarkers.py of a clone (docs/video.md), or give its folder with --landmarkers"
        ) from None
    found = hashlib.sha256(content).hexdigest()
    if found != checksum:
        raise BodysenseError(
            f"{address} came with the checksum {found[:12]}…, not {checksum[:12]}…; try again, or get the file yourself"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_beside(path) as beside:
        beside.write_bytes(content)
