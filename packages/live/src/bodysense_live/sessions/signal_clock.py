"""The clock of a signal: converts the client's frame times to moments, times that always increase.

If the client's clock was set, or the world was moved, the next moment is `RESET_GAP` s after the one before. After such
a gap the tracker starts a new motion of the same person.
"""

from __future__ import annotations

CLOCK_SET = 1.0  # s; a larger step, forward or back, means that the client's clock was set
RESET_GAP = 2.0  # s; long enough that the tracker starts a new motion
SHORTEST_STEP = 1e-4  # s; a frame that follows sooner is late


class SignalClock:
    """The conversion of one signal's frame times to moments."""

    def __init__(self) -> None:
        self._time: float | None = None  # s, client's time of the last frame
        self._shift = 0.0  # s, moment minus client's time
        self._resets = False  # with the next frame

    @property
    def has_started(self) -> bool:
        """Whether any frame has arrived."""
        return self._time is not None

    def time_of(self, time: float) -> float | None:
        """Return the moment of the next frame, whose client's time is `time` s; None if the frame is late."""
        if self._time is not None:
            step = time - self._time
            if -CLOCK_SET < step < SHORTEST_STEP and not self._resets:
                return None
            if abs(step) > CLOCK_SET or self._resets:
                self._shift += RESET_GAP - step
        self._time, self._resets = time, False
        return time + self._shift

    def reset(self) -> None:
        """Start a new motion with the next frame, whatever its time."""
        self._resets = True

    def reset_at(self, moment: float) -> float:
        """Return a later moment for the current frame, with which a new motion starts."""
        self._shift += RESET_GAP
        return moment + RESET_GAP
