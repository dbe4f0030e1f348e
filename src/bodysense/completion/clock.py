"""The clock: how long ago the frame before was, and whether what was remembered still counts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bodysense.errors import BodysenseError
from bodysense.observation import check_order


@dataclass(frozen=True)
class Clock:
    """Intervals between frames."""

    longest_gap: float = 1.0  # s without frames after which motion starts afresh
    first: float = 1 / 30  # s, the interval that a first frame counts as
    longest: float = 0.1  # s: a longer interval that is no gap counts as this

    def __post_init__(self) -> None:
        for name in ("longest_gap", "first", "longest"):
            if not getattr(self, name) > 0:
                raise BodysenseError(f"clock: {name} is {getattr(self, name):g}; it must be positive, in seconds")

    def interval(self, time: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Seconds (B,) since the frame before, and whether (B,) this frame begins anew.

        Args:
            time: (B,) s, of this frame.
            before: (B,) s, of the frame before; NaN where there was none.

        Raises BodysenseError where time is not finite or does not increase.
        """
        past = time - before
        wrong = ~np.isfinite(time) | (past <= 0)
        if wrong.any():
            k = int(np.argmax(wrong))
            check_order(time[k], before[k], "tracker")
        fresh = ~(past <= self.longest_gap)
        return np.where(fresh, self.first, np.minimum(past, self.longest)), fresh
