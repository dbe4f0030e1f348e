"""Seated scenes: down and up on seats of 30 to 55 cm, leaning back, legs crossed, ankle on knee, at a table."""

from __future__ import annotations

import numpy as np

from bodysense_lab.synthesis.scenes import arm_postures
from bodysense_lab.synthesis.scenes.script import SIGN, ArmPosture, Script
from bodysense_lab.synthesis.scenes.standing_scenes import change_arms, square_feet, take_arms

_HIP = 0.095  # m, of the hips over the seat, of the mean adult
SEATS = (0.30, 0.55)  # m, heights of seats


def sit(script: Script) -> None:
    """Sit down, stay, and stand up."""
    _sit_down(script)
    _stay(script)
    _stand_up(script)


def lean_back(script: Script) -> None:
    """Sit and lean back."""
    draw = script.draw
    _sit_down(script)
    begin, takes, hold = script.clock, script.duration(0.9, 1.6), script.duration(3.0, 6.0)
    slides = draw.between(0.02, 0.14)
    x, z = script.offset((0.0, 0.0), 0.0, slides)
    script.moves.pulse(begin, begin + takes, begin + takes + hold, begin + 2 * takes + hold, x=x, z=z,
                       tilt=-draw.between(10, 28), bend=draw.between(-4, 8))  # fmt: skip
    if draw.chance(0.5):
        take_arms(script, arm_postures.folded_in_front(draw) if draw.chance(0.5) else arm_postures.behind_head(draw),
                  begin, 1.2)  # fmt: skip
    script.clock = begin + 2 * takes + hold
    script.phase("seated", begin, script.clock)
    _stand_up(script)


def legs_crossed(script: Script) -> None:
    """Sit with one thigh over the other."""
    scale = script.frame.scale
    draw = script.draw
    place = (-draw.between(0.06, 0.12) * scale, -draw.between(0.26, 0.32) * scale, draw.between(0.14, 0.22) * scale)
    _cross(script, place, (-0.3, 1.0, 0.5), -draw.between(-10, 20))


def ankle_on_knee(script: Script) -> None:
    """Sit with an ankle on the other knee."""
    scale = script.frame.scale
    draw = script.draw
    place = (draw.between(-0.02, 0.06) * scale, draw.between(0.09, 0.12) * scale, draw.between(-0.1, 0.0) * scale)
    _cross(script, place, (1.0, 0.35, 0.5), draw.between(-5, 25))


def feet_under_the_chair(script: Script) -> None:
    """Sit with the feet drawn back under the chair, on their balls."""
    draw = script.draw
    _sit_down(script, lowest=0.4)
    begin = script.clock
    back = draw.between(0.12, 0.26) * script.frame.scale
    heels = draw.between(20, 38)
    crosses = draw.between(0.04, 0.1) if draw.chance(0.3) else 0.0
    homes = [script.ankle(side) for side in (0, 1)]
    for side in (0, 1):
        place = script.offset(homes[side], -SIGN[side] * crosses, -back - (0.08 * side if crosses else 0.0))
        seconds = script.duration(0.3, 0.5)
        _move_foot(script, side, place, seconds)
        script.moves.add(script.clock - seconds, script.clock + 0.05, **script.of(side, heel=heels))
    change_arms(script, arm_postures.SEATED, 0.6)
    script.wait(3.0, 6.0)
    for side in (0, 1):
        seconds = script.duration(0.3, 0.5)
        _move_foot(script, side, homes[side], seconds)
        script.moves.add(script.clock - seconds, script.clock, **script.of(side, heel=-heels))
    script.phase("seated", begin, script.clock)
    _stand_up(script)


def at_a_table(script: Script) -> None:
    """Sit at a table with the forearms on it."""
    draw, frame = script.draw, script.frame
    seat = _sit_down(script)
    begin, takes, hold = script.clock, script.duration(0.7, 1.2), script.duration(3.5, 7.0)
    top = seat + draw.between(0.26, 0.32) * frame.scale
    ahead = draw.between(0.3, 0.42)
    folded = draw.chance(0.4)
    for side in (0, 1):
        left = 0.02 if folded else draw.between(0.08, 0.22)
        x, z = script.place(SIGN[side] * left, ahead + 0.03 * side * folded)
        posture = ArmPosture("world", (x, top + 0.035, z), (0.6, -0.85, -0.3), (-0.2, -1.0, 0.0), 0.0)
        script.arm(side, posture, begin, begin + takes)
        script.arm(side, arm_postures.on_thighs(draw)[side], begin + takes + hold, begin + 2 * takes + hold)
    script.moves.pulse(begin, begin + takes, begin + takes + hold, begin + 2 * takes + hold,
                       bend=draw.between(8, 20), tilt=draw.between(0, 10), gaze_pitch=draw.between(0, 20))  # fmt: skip
    script.clock = begin + 2 * takes + hold
    script.phase("seated", begin, script.clock)
    _stand_up(script)


def _move_foot(script: Script, side: int, place: tuple[float, float], seconds: float) -> None:
    """Move a foot of a seated person, whose weight stays on the seat."""
    yaw = script.yaw + SIGN[side] * script.outward
    script.step(side, place, yaw, script.clock + 0.1, seconds, lift=0.035, shift=0.0, heel=0.0, advance=0.0)


def _sit_down(script: Script, lowest: float = SEATS[0]) -> float:
    """Sit down on a seat behind the person, and return its height, m."""
    draw, frame, moves = script.draw, script.frame, script.moves
    square_feet(script)
    script.wait(0.3, 0.8)
    seat = draw.between(lowest, SEATS[1])
    hips = seat + _HIP * frame.scale
    lean = np.radians(draw.between(-8, 22))  # of the shins: knees are behind the ankles for positive angles
    knee = frame.ankle + frame.shin * np.cos(lean)
    behind = frame.shin * np.sin(lean) + float(np.sqrt(max(frame.thigh**2 - (knee - hips) ** 2, 0.01)))
    x, z = script.offset(script.middle(), 0.0, -behind)
    begin, takes = script.clock, script.duration(1.1, 1.9)
    end = begin + takes
    moves.to(begin + 0.1 * takes, end, x=x, z=z, height=hips)
    moves.to(begin + 0.45 * takes, end, balance=0.0)
    moves.to(begin + 0.3 * takes, end, sway=0.5)
    moves.bump(begin - 0.1, end + 0.3, bend=draw.between(16, 28), tilt=draw.between(18, 30))
    moves.add(begin + 0.5 * takes, end + 0.2, tilt=-draw.between(2, 12), bend=draw.between(0, 8))
    change_arms(script, arm_postures.SEATED, 0.8)
    script.clock = end + 0.2
    return seat


def _stay(script: Script) -> None:
    """Stay seated, look about, and move a foot at times."""
    begin, draw = script.clock, script.draw
    for _ in range(int(draw.rng.integers(1, 4))):
        script.wait(1.5, 3.0)
        change_arms(script, arm_postures.SEATED, 0.4)
        if draw.chance(0.35):
            side = draw.side()
            place = script.offset(script.ankle(side), 0.0, draw.between(-0.1, 0.1) * script.frame.scale)
            _move_foot(script, side, place, script.duration(0.3, 0.5))
    script.phase("seated", begin, script.clock)


def _cross(script: Script, place: tuple[float, float, float], knee: tuple[float, float, float], plantar: float) -> None:
    """Sit down, raise a leg onto the other, stay, and put it down."""
    draw = script.draw
    _sit_down(script, lowest=0.38)
    begin, side = script.clock, draw.side()
    takes, hold = script.duration(0.8, 1.3), script.duration(3.0, 6.0)
    values = dict(zip(("cross_x", "cross_y", "cross_z", "pole_x", "pole_y", "pole_z"), (*place, *knee), strict=True))
    script.moves.to(begin, begin + 0.001, **script.of(side, **values, plantar=plantar))
    script.moves.pulse(begin, begin + takes, begin + takes + hold, begin + 2 * takes + hold,
                       **script.of(side, cross=1.0))  # fmt: skip
    for start in (begin, begin + takes + hold):
        script.moves.bump(start, start + takes, **script.of(side, lift=0.12))
        script.moves.bump(start, start + takes, tilt=-6.0)
    script.lift_recorded(side, begin, begin + 2 * takes + hold)
    change_arms(script, arm_postures.SEATED, 0.6)
    script.clock = begin + 2 * takes + hold
    script.phase("seated", begin, script.clock)
    _stand_up(script)


def _stand_up(script: Script) -> None:
    """Stand up from a seat, with the trunk forward first."""
    draw, frame, moves = script.draw, script.frame, script.moves
    middle = script.middle()
    begin, takes = script.clock, script.duration(1.1, 1.8)
    end = begin + takes
    moves.bump(begin - 0.3, end, bend=draw.between(16, 28), tilt=draw.between(20, 32))
    moves.to(begin + 0.1 * takes, end, x=middle[0], z=middle[1], height=frame.leg + frame.ankle + 0.02)
    moves.to(begin + 0.1 * takes, begin + 0.6 * takes, balance=1.0)
    moves.to(begin + 0.3 * takes, end, sway=1.0, **script.upright)
    change_arms(script, share=0.6)
    script.clock = end
    script.wait(0.6, 1.4)
