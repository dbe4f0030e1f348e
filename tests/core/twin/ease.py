"""Easing: an offset that starts where motion would jump and is exactly zero a set time later.

What is output goes on, and its difference to the goal is taken away at a speed that rises in a fifth of the time, stays
and falls in the last fifth (the idea: Bollo, Inertialization, GDC 2018). Where the goal's own speed differs from the
output's, the offset starts with that slope.
"""

from dataclasses import dataclass, field

import numpy as np

from .vectors import length, limited, turn_between, turned_by

FASTEST = 10.0  # m/s: offsets decay no faster
RAMP = 0.2  # of the span: what an offset takes to get up speed, and to lose it
FASTER = 1 / (1 - RAMP)  # the greatest speed, as a multiple of the mean one


def gone(u: float) -> float:
    """The share of an offset that is gone after the share u of the span: the area under a trapezoid of speed."""
    if u < RAMP:
        return FASTER * u * u / (2 * RAMP)
    if u > 1 - RAMP:
        return 1 - FASTER * (1 - u) ** 2 / (2 * RAMP)
    return FASTER * (u - RAMP / 2)


@dataclass
class Ease:
    """An offset that decays."""

    start: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m, or rad as a rotation vector
    age: float = 0.0  # s since the start
    span: float = 0.0  # s after which it is zero
    slope: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m/s: how the offset changes at first by itself
    speed: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m/s, of the output before the start
    goal: np.ndarray = field(default_factory=lambda: np.zeros(3))  # m, at the start

    @property
    def runs(self) -> bool:
        """Whether the offset is not gone yet."""
        return self.age < self.span

    def offset(self) -> np.ndarray:
        """The offset now."""
        if not self.runs:
            return np.zeros(3)
        u = self.age / self.span
        return self.start * (1 - gone(u)) + self.slope * (self.span * u * (1 - u) ** 2)

    def stop(self) -> None:
        """No offset any more."""
        self.begin(np.zeros(3), 0.0)

    def begin(self, offset: np.ndarray, span: float) -> None:
        """Start with an offset that is gone after `span` seconds."""
        self.start, self.age, self.span, self.slope = offset, 0.0, span, np.zeros(3)

    def advance(self, interval: float) -> None:
        """Let time pass."""
        if self.runs:
            self.age += interval

    def vector(
        self,
        goal: np.ndarray,
        before: np.ndarray,
        speed: np.ndarray,
        interval: float,
        breaks: bool,
        span: float,
        steepest: float = 0.0,
    ) -> np.ndarray:
        """Ease a vector (m) toward its goal and return what to output.

        If its motion breaks, what was output before goes on with its speed (m/s) for a frame, and the difference to the
        goal decays over `span` seconds from then on, or longer if it would move too fast. The second frame shows how
        fast the goal moves: up to `steepest` (m/s), the output comes to that speed along the span.
        """
        if breaks:
            offset = before + limited(speed, FASTEST) * interval - goal
            self.begin(offset, max(span, FASTER * length(offset) / FASTEST) if span > interval else 0.0)
            self.speed, self.goal = speed, goal
        else:
            if self.age == 0:
                self.slope = limited(self.speed - (goal - self.goal) / interval, steepest)
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
        """Ease a rotation; `spin` is its angular velocity in rad/s."""
        if breaks:
            self.begin(turn_between(goal, turned_by(before, spin * interval)), span if span > interval else 0.0)
        else:
            self.advance(interval)
        return turned_by(goal, self.offset())
