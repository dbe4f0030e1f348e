"""Windows: which frames make up the sequences that a network sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of `length` frames over clips that lie one after the other."""

    start: np.ndarray  # (W,) first frame of each window
    clip: np.ndarray  # (W,) which clip it lies in
    length: int

    def __len__(self) -> int:
        return len(self.start)

    def frames(self, which: Any = slice(None)) -> np.ndarray:
        """Frames (..., length) of some windows, by any index of NumPy; all by default."""
        return self.start[which][..., None] + np.arange(self.length)


def find_windows(clip_start: Any, clip_length: Any, *, length: int, stride: int = 1) -> Windows:
    """All windows that fit into the clips with first frames `clip_start` (C,) and `clip_length` (C,) frames.

    A window is `length` frames; `stride` is the number of frames from one window's start to the next.
    """
    for name, value in (("length", length), ("stride", stride)):
        if value < 1:
            raise BodysenseError(f"{name} {value} cannot be; windows need a {name} of at least 1")
    clip_start, clip_length = np.asarray(clip_start, dtype=np.int64), np.asarray(clip_length, dtype=np.int64)
    count = np.maximum(0, (clip_length - length) // stride + 1)
    clip = np.repeat(np.arange(len(count)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return Windows(clip_start[clip] + within * stride, clip, length)
