"""Windows of frames over clips, the sequences on which a network is trained."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of `length` frames over concatenated clips."""

    start: np.ndarray  # (W,) first frame of each window
    clip: np.ndarray  # (W,) index of its clip
    length: int

    def __len__(self) -> int:
        return len(self.start)

    def frames(self, which: Any = slice(None)) -> np.ndarray:
        """Return the frames (..., length) of windows, selected by a NumPy index; all by default."""
        return self.start[which][..., None] + np.arange(self.length)


def find_windows(clip_start: Any, clip_length: Any, *, length: int, stride: int = 1) -> Windows:
    """Return all windows of `length` frames that fit into clips with first frames `clip_start` (C,) and lengths (C,).

    `stride` is the number of frames from one window's start to the next. Raises BodysenseError if `length` or `stride`
    is below 1.
    """
    for name, value in (("length", length), ("stride", stride)):
        if value < 1:
            raise BodysenseError(f"{name} {value} is not possible; windows need a {name} of at least 1")
    clip_start, clip_length = np.asarray(clip_start, dtype=np.int64), np.asarray(clip_length, dtype=np.int64)
    count = np.maximum(0, (clip_length - length) // stride + 1)
    clip = np.repeat(np.arange(len(count)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return Windows(clip_start[clip] + within * stride, clip, length)
