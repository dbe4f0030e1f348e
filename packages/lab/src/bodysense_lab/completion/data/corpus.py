"""Recorded motion in the form that training reads: world rotations of the body's joints in consecutive frames."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import BODY
from bodysense.devices.simulated.headset_camera import see
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import quaternion_canonical
from bodysense.io.clip import Clip
from bodysense.io.datasets.splits import Split

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


CorpusReader = Callable[[Split], Corpus]  # corpus of a split


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
