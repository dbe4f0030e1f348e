"""Windows: which frames make up the sequences that a network sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from bodysense.errors import BodysenseError


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows over clips that lie one after the other: `length` poses, `step` frames apart."""

    start: np.ndarray  # (W,) first frame of each window
    clip: np.ndarray  # (W,) which clip it lies in
    length: int
    step: int

    def __len__(self) -> int:
        return len(self.start)

    def frames(self, which: Any = slice(None)) -> np.ndarray:
        """Frames (..., length) of some windows, by any index of NumPy; all by default."""
        return self.start[which][..., None] + self.step * np.arange(self.length)


def find_windows(clip_start: Any, clip_length: Any, *, length: int, stride: int = 1, step: int = 1) -> Windows:
    """All windows that fit into the clips with first frames `clip_start` (C,) and `clip_length` (C,) frames.

    A window is `length` poses, every `step`-th frame: step=4 takes 30 Hz poses from a 120 Hz recording (`frame_step`).
    `stride` is the distance between two windows' starts, counted in those poses, hence stride · step frames. So the
    windows of a recording by step are those of the recording thinned out beforehand.
    """
    for name, value in (("length", length), ("stride", stride), ("step", step)):
        if value < 1:
            raise BodysenseError(f"{name} {value} cannot be; windows need a {name} of at least 1")
    clip_start, clip_length = np.asarray(clip_start, dtype=np.int64), np.asarray(clip_length, dtype=np.int64)
    span = (length - 1) * step + 1
    count = np.maximum(0, (clip_length - span) // (stride * step) + 1)
    clip = np.repeat(np.arange(len(count)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return Windows(clip_start[clip] + within * stride * step, clip, length, step)


def frame_step(source_rate: float, rate: float) -> int:
    """Source frames from one pose at `rate` Hz to the next. Raises BodysenseError where that is no whole number."""
    step = source_rate / rate if rate > 0 else 0.0
    if round(step) < 1 or abs(step - round(step)) > 1e-3 * step:
        raise BodysenseError(
            f"{source_rate:g} Hz is no whole multiple of {rate:g} Hz; resample the recording first (data.resample)"
        )
    return round(step)
