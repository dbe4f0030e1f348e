"""Recorded motion in the form that training reads: world rotations of the body's joints in consecutive frames."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.headset_camera import see
from bodysense.errors import BodysenseError
from bodysense.files import cache_folder, make_folder, written_beside
from bodysense.geometry.rotation import quaternion_canonical
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split
from bodysense_lab.core.progress import read_clips
from bodysense_lab.data.store import is_store

FORMAT = "bodysense-corpus-2"
_JOINTS = len(BODY)
_CLIP_FIELDS = ("rest_offset", "start", "length", "rate", "finger_start", "name", "category")


@dataclass(frozen=True, eq=False)
class Corpus:
    """Clips of one split at their own rates. The arrays have the frames of all clips, one after the other."""

    rotation: np.ndarray  # (N, 22, 4) float32 wxyz, world ← joint
    root: np.ndarray  # (N, 3) float32 m, the pelvis
    visible: np.ndarray  # (N, 65) bool: points that a headset's cameras see
    fingers: np.ndarray  # (M, 30, 4) float32 wxyz, parent ← joint; frames of clips with fingers only
    rest_offset: np.ndarray  # (C, 65, 3) float32 m, the body of each clip
    start: np.ndarray  # (C,) first frame
    length: np.ndarray  # (C,) frames
    rate: np.ndarray  # (C,) Hz
    finger_start: np.ndarray  # (C,) first row of `fingers`; -1: no fingers
    name: np.ndarray  # (C,) str
    category: np.ndarray  # (C,) str

    def __len__(self) -> int:
        return len(self.length)

    def select(self, clips: np.ndarray) -> Corpus:
        """Return a corpus of the clips with indices (N,). It shares the frames of this one."""
        return replace(self, **{name: getattr(self, name)[clips] for name in _CLIP_FIELDS})

    @property
    def with_fingers(self) -> np.ndarray:
        """Indices (N,) of the clips whose fingers were recorded."""
        return np.flatnonzero(self.finger_start >= 0)

    def finger_clips(self, person: str) -> tuple[np.ndarray, np.ndarray]:
        """Return indices of the clips with fingers of a person, and of all other people."""
        clips = self.with_fingers
        theirs = np.array([str(self.name[clip]).split("/")[0] == person for clip in clips], dtype=bool)
        return clips[theirs], clips[~theirs]

    @property
    def minutes(self) -> float:
        """Duration of all clips, minutes."""
        return float((self.length / self.rate).sum() / 60)


def read_corpus(data: Path, split: Split, limit: int | None = None) -> Corpus:
    """Read the clips of a split of `data`, a folder of motion or a store, or `limit` of them for a trial.

    The corpus is cached in the user's cache folder until the data change. Raises BodysenseError if there is no motion.
    """
    request = f"{data.resolve()} {split} {limit}"
    cached = cache_folder() / f"corpus-{hashlib.sha256(request.encode()).hexdigest()[:16]}.npz"
    content = content_digest(data)
    if cached.is_file():
        with np.load(cached, allow_pickle=False) as saved:
            if str(saved["content"]) == content:
                return Corpus(**{name: saved[name] for name in saved.files if name != "content"})
    corpus = corpus_of(read_clips(data, split, limit))
    make_folder(cached.parent)
    with written_beside(cached) as beside, beside.open("wb") as file:
        np.savez(file, content=content, **vars(corpus))
    return corpus


def content_digest(data: Path) -> str:
    """Return a digest that changes with the motion in a folder or store and with the format of a corpus."""
    if is_store(data):
        seen = [(data / "zarr.json").read_text(encoding="utf-8")]
    else:
        from bodysense.io.datasets.sources import list_sources

        found = [(source, source.path.stat()) for source in list_sources(data)]
        seen = [
            f"{source.key(data)} {source.person} {source.split} {source.category} {file.st_size} {file.st_mtime_ns}"
            for source, file in found
        ]
    return hashlib.sha256("\n".join([FORMAT, *seen]).encode()).hexdigest()


def corpus_of(clips: Iterable[Clip]) -> Corpus:
    """Convert clips to the form that training reads. Raises BodysenseError if there are no clips."""
    rows: list[dict[str, np.ndarray]] = []
    about: list[tuple[float, str, str]] = []
    for clip in clips:
        pose = clip.pose
        world = forward_kinematics(pose)[1][:, :_JOINTS]
        fingers = pose.rotation[:, _JOINTS:] if clip.has_fingers else np.zeros((0, 30, 4))
        rows.append(
            {
                "rotation": quaternion_canonical(world).astype(np.float32),
                "root": pose.root_position.astype(np.float32),
                "visible": see(pose).visible,
                "fingers": fingers.astype(np.float32),
                "rest_offset": pose.skeleton.rest_offset[None].astype(np.float32),
            }
        )
        about.append((clip.frame_rate, f"{clip.person}/{clip.name}", clip.category))
    if not rows:
        raise BodysenseError("there is no motion to learn from; give at least one clip")
    whole = {name: np.concatenate([row[name] for row in rows]) for name in rows[0]}
    length = np.array([len(row["root"]) for row in rows])
    finger_frames = np.array([len(row["fingers"]) for row in rows])
    return Corpus(
        **whole,
        start=np.cumsum(length) - length,
        length=length,
        rate=np.array([row[0] for row in about]),
        finger_start=np.where(finger_frames > 0, np.cumsum(finger_frames) - finger_frames, -1),
        name=np.array([row[1] for row in about]),
        category=np.array([row[2] for row in about]),
    )


def interpolate(a: np.ndarray, b: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Interpolate rotations (T, J, 4) linearly from a to b by `share` (T,), in float64, and normalise them."""
    a, b = a.astype(float), b.astype(float)
    b *= np.where((a * b).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    mixed = a + share[:, None, None] * (b - a)
    return mixed / np.linalg.norm(mixed, axis=-1, keepdims=True)
