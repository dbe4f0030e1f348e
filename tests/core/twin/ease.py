"""Easing: an offset that starts where motion would jump and is exactly zero a set time later.

What is output goes on, and its difference to the goal decays by the cubic 1 - 3 u² + 2 u³, which starts and ends at
rest (Bollo, Inertialization, GDC 2018).
"""

from dataclasses import dataclass, field

import numpy as np

from .vectors import length, limited, turn_between, turned_by

FASTEST = 10.0  # m/s: offsets decay no faster
CUBIC = 1.5  # the fastest of the cubic, as a multiple of its mean speed


@dataclass
class Ease:
    """An offset that decays."""

    start: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m, or rad as a rotation vector
    age: float = 0.0  # s since the start
    span: float = 0.0  # s after which it is zero

    def offset(self) -> np.ndarray:
        """The offset now."""
        if not self.age < self.span:
            return np.zeros(3)
        u = self.age / self.span
        return self.start * (1 + u * u * (2 * u - 3))

    def stop(self) -> None:
        """No offset any more."""
        self.begin(np.zeros(3), 0.0)

    def begin(self, offset: np.ndarray, span: float) -> None:
        """Start with an offset that is gone after `span` seconds."""
        self.start, self.age, self.span = offset, 0.0, span

    def advance(self, interval: float) -> None:
        """Let time pass."""
        if self.age < self.span:
            self.age += interval

    def vector(
        self,
        goal: np.ndarray,
        before: np.ndarray,
        speed: np.ndarray,
        interval: float,
        breaks: bool,
        span: float,
    ) -> np.ndarray:
        """Ease a vector (m) toward its goal and return what to output.

        If its motion breaks, what was output before goes on with its speed (m/s) for a frame, and the difference to the
        goal decays over `span` seconds from then on, or longer if it would move too fast.
        """
        if breaks:
            offset = before + limited(speed, FASTEST) * interval - goal
            self.begin(offset, max(span, CUBIC * length(offset) / FASTEST) if span > 0 else 0.0)
        else:
            self.advance(interval)
        return goal + self.offset()

    def rotation(
        self,
        goal: np.ndarray,
        before: np.ndarray,
        spin: np.ndarray,
        interval: float,
        breaks: bool,
        span: float,
    ) -> np.ndarray:
        """The same for a rotation, with its spin in rad/s."""
        if breaks:
            self.begin(turn_between(goal, turned_by(before, spin * interval)), span)
        else:
            self.advance(interval)
        return turned_by(goal, self.offset())
