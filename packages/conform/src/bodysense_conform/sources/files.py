"""Files as subjects: what `bodysense.open_source` reads, and MCAP takes."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import list_sources, read_source
from bodysense.observing.observation import Observation
from bodysense.sources.open import MarkerSource, MotionSource, RecordingSource, open_source
from bodysense_conform.sources.mcap_take import read_mcap
from bodysense_conform.subject import Subject, is_finger, ordered, points_subject

ENDINGS = (".bvh", ".npz", ".jsonl", ".glb", ".gltf", ".vrma", ".mcap", ".c3d", ".trc")


def read_subject(path: Path) -> Subject:
    """Read a file as a subject. Raises BodysenseError, naming the file and the fix, if it cannot be read."""
    if path.suffix.lower() == ".mcap" and path.is_file():
        subject = read_mcap(path)
    else:
        source = open_source(path)
        if isinstance(source, MotionSource):
            subject = clip_subject(replace(source.clip, name=path.stem), path.suffix[1:].upper())
        elif isinstance(source, (RecordingSource, MarkerSource)):
            subject = observation_subject(source.recording.observation, path)
        else:
            raise BodysenseError(f"{path}: a video; complete it first: bodysense track {path} -o take.mcap")
    with path.open("rb") as file:
        return replace(subject, sha256=hashlib.file_digest(file, "sha256").hexdigest())


def folder_subjects(folder: Path, splits: Collection[str]) -> Iterator[tuple[str, Subject | BodysenseError]]:
    """Read every file of a folder by name; of motion data with splits (docs/data.md) those of the given splits."""
    if splits or (folder / "splits.json").is_file() or (folder.parent / "splits.json").is_file():
        for entry in list_sources(folder):
            if not splits or entry.split in splits:
                try:
                    yield entry.path.name, clip_subject(read_source(entry), "motion")
                except BodysenseError as error:
                    yield entry.path.name, error
        return
    for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() in ENDINGS and path.is_file()):
        try:
            yield path.name, read_subject(path)
        except BodysenseError as error:
            yield path.name, error


def clip_subject(clip: Clip, form: str) -> Subject:
    """Return a clip in canonical form as a subject; missing fingers are left out."""
    return pose_subject(clip.name, form, clip.pose, clip.time, fingers=clip.has_fingers)


def pose_subject(
    name: str, form: str, pose: Pose, time: np.ndarray, rest_offset: np.ndarray | None = None, fingers: bool = True
) -> Subject:
    """Return a pose (T, …) as a subject; `rest_offset` (T, P, 3) m is that of a body whose proportions change."""
    position, rotation = forward_kinematics(pose, rest_offset)
    turns = np.full((*position.shape[:-1], 4), np.nan)
    turns[:, : rotation.shape[1]] = rotation
    points = [point for point in pose.skeleton.points if fingers or not is_finger(point)]
    keep = pose.skeleton.indices(points)
    rotated = keep < len(pose.skeleton.joints)
    return points_subject(name, form, points, time, position[:, keep], turns[:, keep], rotated)


def observation_subject(seen: Observation, path: Path) -> Subject:
    """Return tracked points as a subject. Raises BodysenseError if no joint of the body is among them."""
    if not ordered(seen.points):
        raise BodysenseError(
            f"{path}: none of its points is a joint of the body ({', '.join(seen.points[:4])} …); complete it first: "
            f"bodysense track {path} -o take.mcap"
        )
    rotated = np.asarray(seen.has_rotation.any(axis=0))
    return points_subject(
        path.stem, "recording", seen.points, seen.time, seen.position, seen.rotation, rotated, seen.has_position
    )
