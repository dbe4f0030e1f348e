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
from bodysense.observation import Observation
from bodysense.open import MarkerSource, MotionSource, RecordingSource, open_source
from bodysense_conform.sources.mcap_take import read_mcap
from bodysense_conform.subject import Subject, is_finger, ordered

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
    """Return a clip in canonical form as a subject; fingers that it does not have are left out."""
    position, rotation = forward_kinematics(clip.pose)
    return pose_subject(clip.name, form, clip.pose, clip.time, position, rotation, fingers=clip.has_fingers)


def pose_subject(
    name: str, form: str, pose: Pose, time: np.ndarray, position: np.ndarray, rotation: np.ndarray, fingers: bool = True
) -> Subject:
    """Return places (T, P, 3) and turns (T, J, 4) of a skeleton as a subject."""
    skeleton = pose.skeleton
    points = ordered([point for point in skeleton.points if fingers or not is_finger(point)])
    keep, joints = skeleton.indices(points), len(skeleton.joints)
    turns = np.full((len(time), len(skeleton.points), 4), np.nan)
    turns[:, :joints] = rotation
    return Subject(
        name=name,
        format=form,
        points=points,
        time=np.asarray(time, dtype=float),
        position=np.asarray(position, dtype=float)[:, keep],
        rotation=turns[:, keep],
        rotated=np.asarray(keep < joints),
        valid=np.ones((len(time), len(points)), dtype=bool),
    )


def observation_subject(seen: Observation, path: Path) -> Subject:
    """Return tracked points as a subject. Raises BodysenseError if no joint of the body is among them."""
    points = ordered(seen.points)
    if not points:
        raise BodysenseError(
            f"{path}: none of its points is a joint of the body ({', '.join(seen.points[:4])} …); complete it first: "
            f"bodysense track {path} -o take.mcap"
        )
    keep = [seen.points.index(name) for name in points]
    return Subject(
        name=path.stem,
        format="recording",
        points=points,
        time=seen.time,
        position=seen.position[:, keep],
        rotation=seen.rotation[:, keep],
        rotated=np.asarray(seen.has_rotation[:, keep].any(axis=0)),
        valid=seen.has_position[:, keep],
    )
