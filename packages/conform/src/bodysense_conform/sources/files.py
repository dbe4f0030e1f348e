"""Files as subjects: motions (.bvh, .npz, .glb, .gltf, .vrma), recordings (.npz, .jsonl) and MCAP takes."""

from __future__ import annotations

import hashlib
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.skeleton import default_skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.datasets.sources import Source, read_source
from bodysense.io.recording import is_recording, parse_recording
from bodysense.io.rigs.rigged import read_rigged
from bodysense_conform.sources.gltf import read_gltf
from bodysense_conform.sources.mcap_take import read_mcap
from bodysense_conform.subject import Subject, is_finger, ordered

ENDINGS = (".bvh", ".npz", ".jsonl", ".glb", ".gltf", ".vrma", ".mcap")


def read_subject(path: Path) -> Subject:
    """Read a file as a subject. Raises BodysenseError, naming the file and the fix, for what cannot be read."""
    if not path.is_file():
        raise BodysenseError(
            f"{path}: no such file; give a file that ends in {', '.join(ENDINGS)}, a folder or a stream"
        )
    suffix = path.suffix.lower()
    if suffix not in ENDINGS:
        raise BodysenseError(f"{path}: unknown kind of file {suffix!r}; valid are {', '.join(ENDINGS)}")
    if suffix == ".mcap":
        subject = read_mcap(path)
    elif suffix in (".glb", ".gltf", ".vrma"):
        subject = read_gltf(path)
    elif is_recording(path):
        subject = _recording(path)
    else:
        subject = motion_subject(Source(path, person="", split="test"))
    with path.open("rb") as file:
        return replace(subject, sha256=hashlib.file_digest(file, "sha256").hexdigest())


def motion_subject(source: Source) -> Subject:
    """The subject of a motion file: its own joints, no others."""
    place = source.file.place
    if place.suffix.lower() != ".bvh":
        clip = read_source(source)
        return clip_subject(clip, "AMASS", () if clip.has_fingers else _fingers())
    rigged = read_rigged(source.file.read(), place)
    whole = replace(rigged.clip, name=place.stem)
    return clip_subject(whole, "BVH", set(default_skeleton().points) - set(rigged.rig.joints))


def clip_subject(clip: Clip, form: str, without: Collection[str] = ()) -> Subject:
    """A clip in canonical form as a subject; points of `without` were made up, and are left out."""
    position, rotation = forward_kinematics(clip.pose)
    return pose_subject(clip.name, form, clip.pose, clip.time, position, rotation, without)


def pose_subject(
    name: str,
    form: str,
    pose: Pose,
    time: np.ndarray,
    position: np.ndarray,
    rotation: np.ndarray,
    without: Collection[str] = (),
) -> Subject:
    """Places (T, P, 3) and turns (T, J, 4) of a skeleton as a subject."""
    skeleton = pose.skeleton
    points = ordered([point for point in skeleton.points if point not in without])
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


def _recording(path: Path) -> Subject:
    """What a device tracked, as it is: points of the body only."""
    seen = parse_recording(path).observation
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


def _fingers() -> set[str]:
    return {name for name in default_skeleton().points if is_finger(name)}
