"""Script of a scene: moves of the body's channels, steps of the feet, postures of the arms, and phases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from bodysense_lab.synthesis.scenes.moves import Draw, Moves

Phase = Literal["standing", "bowing", "kneeling", "seated"]
PHASES: tuple[Phase, ...] = ("standing", "bowing", "kneeling", "seated")
SIDES = ("left", "right")
KNEE = 0.055  # m, height of a knee on the floor, of the mean adult
SIGN = (1.0, -1.0)  # +X is the body's left
_STOOPS = 0.35  # share of people who stand with a bent trunk
_STAGGERED = 0.4  # share of people one of whose feet is ahead of the other, by at most 14 cm
_BODY = (
    *(
        "x",
        "z",
        "height",
        "balance",
        "yaw",
        "tilt",
        "roll",
        "bend",
        "side",
        "twist",
        "softness",
        "sway",
        "lead",
        "kneel_angle",
    ),
    *("gaze_yaw", "gaze_pitch", "gaze_roll"),
)
_SIDED = (
    *("ankle_x", "ankle_z", "lift", "foot_yaw", "heel", "toes_up", "swing", "knee_out"),
    *("kneel", "knee_x", "knee_z", "cross", "cross_x", "cross_y", "cross_z", "arm_swing"),
    *("pole_x", "pole_y", "pole_z", "plantar"),
)


@dataclass(frozen=True)
class Frame:
    """Sizes of a body, m, that scale a script."""

    scale: float  # relative to the mean adult; no unit
    thigh: float
    shin: float
    hip_width: float  # half the distance of the hips
    ankle: float  # height of an ankle over the floor
    ball: np.ndarray  # (2, 3) of each side, from the ankle to the ball of the foot
    arm: float

    @property
    def leg(self) -> float:
        """Length of a leg from the hip to the ankle."""
        return self.thigh + self.shin


@dataclass(frozen=True, eq=False)
class ArmPosture:
    """A posture of an arm: places and directions in a frame of the body, of a left arm; +X is outward.

    Frames are `gravity` (shoulder; upright), `chest` (between the shoulders), `pelvis` (between the hips), `head`,
    `thigh` (hip; the thigh is along −Y, its top is +Z) and `world`. Lengths are in arms' lengths but in `world`, m.
    """

    frame: Literal["gravity", "chest", "pelvis", "head", "thigh", "world"]
    wrist: tuple[float, float, float]
    elbow: tuple[float, float, float]  # direction of the elbow
    palm: tuple[float, float, float]  # direction of the palm
    motion: float = 0.012  # m, standard deviation of the wrist's random motion


@dataclass(frozen=True)
class FootStep:
    """A step: a foot that is in the air from begin to end, s."""

    side: int
    begin: float
    end: float


@dataclass(eq=False)
class Script:
    """A scene that is being written. The clock is the time up to which it is written."""

    draw: Draw
    frame: Frame
    moves: Moves
    upright: dict[str, float]  # degrees, of pelvis and trunk of the standing person
    clock: float = 0.0
    pace: float = 1.0  # speed of the person
    apart: float = 0.09  # m, from the middle to an ankle of a standing person
    outward: float = 7.0  # degrees that a standing foot is turned outward
    steps: list[FootStep] = field(default_factory=list)
    lifted: list[FootStep] = field(default_factory=list)  # feet off the floor that do not step
    phases: list[tuple[Phase, float, float]] = field(default_factory=list)
    arms: list[list[tuple[float, float, ArmPosture]]] = field(default_factory=lambda: [[], []])

    @classmethod
    def begin(cls, frame: Frame, draw: Draw) -> Script:
        """Return the script of a standing person with a random place and heading."""
        apart, outward = draw.between(0.06, 0.125) * frame.scale, draw.between(2.0, 14.0)
        upright = {"tilt": draw.between(-7, 2), "bend": draw.between(-3, 6)}
        if draw.chance(_STOOPS):
            upright = {"tilt": upright["tilt"] + draw.between(0, 8), "bend": upright["bend"] + draw.between(2, 16)}
        values = dict.fromkeys(_BODY, 0.0) | {f"{side}_{name}": 0.0 for side in SIDES for name in _SIDED}
        yaw, x, z = draw.between(-180, 180), draw.between(-1.5, 1.5), draw.between(-1.5, 1.5)
        values |= {
            "yaw": yaw,
            "x": x,
            "z": z,
            "balance": 1.0,
            "softness": 0.0004,
            "sway": 1.0,
            "lead": draw.between(0.02, 0.06) * frame.scale,
        }
        values |= {"height": frame.leg + frame.ankle + 0.02, "straight": draw.between(5.5, 9), **upright}
        staggered = draw.between(-0.07, 0.07) * frame.scale if draw.chance(_STAGGERED) else 0.0
        script = cls(draw, frame, Moves(values), upright, pace=draw.between(0.75, 1.35), apart=apart, outward=outward)
        for side in (0, 1):
            place = script.place(SIGN[side] * apart, draw.between(-0.025, 0.025) + SIGN[side] * staggered)
            start = dict(zip(("ankle_x", "ankle_z"), place, strict=True))
            start |= {"foot_yaw": yaw + SIGN[side] * outward, "knee_out": draw.between(-2, 8)}
            script.moves = Moves(script.moves.value | {f"{SIDES[side]}_{name}": v for name, v in start.items()})
        return script

    @property
    def yaw(self) -> float:
        """Heading of the pelvis, degrees; 0 faces +Z, 90 faces +X."""
        return self.moves.value["yaw"]

    def place(self, left: float, ahead: float, yaw: float | None = None) -> tuple[float, float]:
        """Return x and z, m, of a place to the left and ahead of the hips, by the heading."""
        return self.offset((self.moves.value["x"], self.moves.value["z"]), left, ahead, yaw)

    def offset(
        self, origin: Sequence[float], left: float, ahead: float, yaw: float | None = None
    ) -> tuple[float, float]:
        """Return x and z, m, of a place to the left and ahead of an origin (x, z), by the heading."""
        way = np.radians(self.yaw if yaw is None else yaw)
        x = origin[0] + left * np.cos(way) + ahead * np.sin(way)
        return float(x), float(origin[1] - left * np.sin(way) + ahead * np.cos(way))

    def ankle(self, side: int) -> tuple[float, float]:
        """Return x and z, m, of an ankle after all moves so far."""
        return self.moves.value[f"{SIDES[side]}_ankle_x"], self.moves.value[f"{SIDES[side]}_ankle_z"]

    def middle(self) -> tuple[float, float]:
        """Return x and z, m, of the middle of the ankles."""
        left, right = self.ankle(0), self.ankle(1)
        return (left[0] + right[0]) / 2, (left[1] + right[1]) / 2

    def wait(self, shortest: float, longest: float) -> float:
        """Advance the clock by a random time and return the time before, s."""
        before = self.clock
        self.clock += self.draw.between(shortest, longest) / self.pace
        return before

    def duration(self, shortest: float, longest: float) -> float:
        """Draw the duration of a movement at the person's pace, s."""
        return self.draw.between(shortest, longest) / self.pace

    def phase(self, name: Phase, begin: float, end: float) -> None:
        """Record that the person is in a phase from begin to end, s."""
        self.phases.append((name, begin, end))

    def of(self, side: int, **values: float) -> dict[str, float]:
        """Return channels of a side by their full names."""
        return {f"{SIDES[side]}_{name}": value for name, value in values.items()}

    def step_recorded(self, side: int, begin: float, end: float) -> None:
        """Record that a foot is in the air from begin to end, s, and comes down elsewhere."""
        self.steps.append(FootStep(side, begin, end))

    def lift_recorded(self, side: int, begin: float, end: float) -> None:
        """Record that a foot is off the floor from begin to end, s, and comes down in its old place."""
        self.lifted.append(FootStep(side, begin, end))

    def arm(self, side: int, posture: ArmPosture, begin: float, end: float) -> None:
        """Move an arm to a posture within begin to end, s."""
        self.arms[side].append((begin, end, posture))

    def step(
        self,
        side: int,
        place: tuple[float, float],
        yaw: float,
        begin: float,
        seconds: float,
        *,
        lift: float,
        shift: float,
        heel: float = 25.0,
        toes_up: float = 0.0,
        lead: float = 0.3,
        softness: float = 0.003,
        advance: float = 1.0,
    ) -> None:
        """Put a foot to a place, with the weight on the other foot in the meantime.

        Args:
            side: 0 left, 1 right.
            place: x and z of the ankle, m.
            yaw: of the foot, degrees.
            begin: s.
            seconds: that the foot is in the air.
            lift: height of the arc, m.
            shift: share of the distance to the other foot by which the weight moves to it.
            heel: angle by which the heel rises before the foot leaves the floor, degrees.
            toes_up: angle of the toes at landing, degrees.
            lead: s before and after the step in which the weight moves.
            softness: of the pelvis's height during the step, m.
            advance: share of the way of the middle of the feet by which the weight follows.
        """
        end, middle, stance = begin + seconds, self.middle(), self.ankle(1 - side)
        self.moves.swing(begin, end, **self.of(side, ankle_x=place[0], ankle_z=place[1]))
        self.moves.to(begin, end, **self.of(side, foot_yaw=yaw))
        self.moves.bump(begin, end, **self.of(side, lift=lift))
        if heel:
            rise = min(0.35, 0.7 * seconds)
            self.moves.pulse(begin - rise, begin + 0.15 * seconds, begin + 0.2 * seconds, end - 0.1 * seconds,
                             **self.of(side, heel=heel))  # fmt: skip
        if toes_up:
            self.moves.pulse(begin + 0.4 * seconds, end, end, end + 0.35 * seconds, **self.of(side, toes_up=toes_up))
            self.lifted.append(FootStep(side, end - 1e-3, end + 0.35 * seconds))  # the sole comes down
        self.moves.pulse(begin, begin + 0.4 * seconds, end - 0.4 * seconds, end, **self.of(side, swing=1.0))
        now = self.middle()
        gone = {"x": advance * (now[0] - middle[0]), "z": advance * (now[1] - middle[1])}
        self.moves.add(begin - lead, end + lead, **gone)
        over = {"x": shift * (stance[0] - middle[0]), "z": shift * (stance[1] - middle[1])}
        self.moves.pulse(begin - lead, begin + 0.3 * seconds, end - 0.3 * seconds, end + lead, **over)
        self.moves.pulse(begin - lead, begin, end, end + lead, softness=softness)
        self.steps.append(FootStep(side, begin, end))
        self.clock = max(self.clock, end)
