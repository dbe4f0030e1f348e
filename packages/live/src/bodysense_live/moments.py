"""The clock of a signal: times of frames, which are the client's own, become moments.

Moments always increase, and by little: where the client's clock was set, and where the world was moved, a moment comes
`AFRESH` s later than the one before, after which the tracker begins a new motion of the same person.
"""

from __future__ import annotations

CLOCK_SET = 1.0  # s: a clock that jumps as far back, or forward, was set
AFRESH = 2.0  # s
SHORTEST_STEP = 1e-4  # s between frames


class Moments:
    """The moments of one signal."""

    def __init__(self) -> None:
        self._time: float | None = None  # s, the client's, of the last frame
        self._shift = 0.0  # s, from the client's time to moments
        self._starts_afresh = False  # with the next frame

    @property
    def have_begun(self) -> bool:
        """Whether any frame came."""
        return self._time is not None

    def of(self, time: float) -> float | None:
        """Return the moment of the next frame from the client's time; None for a late frame."""
        if self._time is not None:
            step = time - self._time
            if -CLOCK_SET < step < SHORTEST_STEP and not self._starts_afresh:
                return None
            if abs(step) > CLOCK_SET or self._starts_afresh:
                self._shift += AFRESH - step
        self._time, self._starts_afresh = time, False
        return time + self._shift

    def start_afresh(self) -> None:
        """Whatever time the next frame has, it begins a new motion."""
        self._starts_afresh = True

    def begin_anew(self, moment: float) -> float:
        """In place of the moment of this frame, one that begins a new motion; the next ones come after it."""
        self._shift += AFRESH
        return moment + AFRESH
