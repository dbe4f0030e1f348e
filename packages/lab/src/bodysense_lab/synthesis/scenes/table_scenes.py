"""Scenes of standing people at tables and worktops: work with both hands on the top, and lean on it."""

from __future__ import annotations

from bodysense_lab.synthesis.scenes import arm_postures
from bodysense_lab.synthesis.scenes.script import SIGN, ArmPosture, Script
from bodysense_lab.synthesis.scenes.standing_scenes import change_arms, foot_place, foot_yaw, square_feet, take_arms

TOPS = (0.68, 1.05)  # m, heights of table tops and worktops
_WRIST = 0.035  # m, of a wrist over the top on which its hand lies


def work_at_a_table(script: Script) -> None:
    """Stand at a table, bend over it, move things on it with both hands, and step aside at times."""
    draw, moves = script.draw, script.moves
    square_feet(script)
    begin = script.wait(0.2, 0.6)
    top, takes = draw.between(*TOPS), script.duration(0.7, 1.4)
    down = {"tilt": draw.between(2, 24), "bend": draw.between(4, 30), "gaze_pitch": draw.between(5, 30)}
    moves.add(begin, begin + takes, **down)
    _reach(script, top, begin, takes)
    script.clock = begin + takes
    for _ in range(int(draw.rng.integers(2, 6))):
        if draw.chance(0.3):
            _step_aside(script)
        if draw.chance(0.3):  # straightens up a little, or bends further
            change = draw.between(-8, 8)
            moves.add(script.clock, script.clock + 0.8, bend=change)
            down["bend"] += change
        _reach(script, top, script.clock, script.duration(0.4, 0.9))
        script.wait(0.6, 1.8)
    script.phase("standing", begin, script.clock)
    end = script.clock + takes
    moves.add(script.clock, end, **{name: -value for name, value in down.items()})
    change_arms(script, share=1.0)
    script.clock = end
    script.wait(0.5, 1.2)


def lean_on_a_table(script: Script) -> None:
    """Stand and lean on a table with both hands, the arms almost straight, or with one hand."""
    draw, frame = script.draw, script.frame
    square_feet(script)
    begin = script.wait(0.2, 0.6)
    top, takes = draw.between(*TOPS), script.duration(0.8, 1.5)
    sides = (0, 1) if draw.chance(0.7) else (draw.side(),)
    ahead = draw.between(0.3, 0.5) * frame.scale
    for side in sides:
        x, z = script.offset(script.middle(), SIGN[side] * draw.between(0.14, 0.3), ahead)
        posture = ArmPosture("world", (x, top + _WRIST, z), (0.8, -0.3, -0.6), (0.0, -1.0, 0.1), 0.0)
        script.arm(side, posture, begin, begin + takes)
    leans = draw.between(10, 38)
    share = draw.between(0.35, 0.75)
    released = begin + takes + script.duration(2.0, 5.0)
    x, z = script.offset((0.0, 0.0), 0.0, draw.between(0.0, 0.06))
    script.moves.pulse(begin, begin + takes, released, released + takes, x=x, z=z, tilt=share * leans,
                       bend=(1 - share) * leans, gaze_pitch=draw.between(-15, 15))  # fmt: skip
    script.phase("standing", begin, released)
    script.clock = released
    take_arms(script, arm_postures.hanging(draw), released, takes)
    script.clock = released + takes
    script.wait(0.4, 1.0)


def _reach(script: Script, top: float, begin: float, seconds: float) -> None:
    """Move both hands to other places on or just over the top, or one of them."""
    draw = script.draw
    for side in (0, 1) if draw.chance(0.6) else (draw.side(),):
        ahead, left = draw.between(0.22, 0.5) * script.frame.scale, draw.between(0.02, 0.32)
        x, z = script.offset(script.middle(), SIGN[side] * left, ahead)
        height = top + _WRIST + draw.between(0.0, 0.12)
        palm = (0.0, -1.0, 0.0) if draw.chance(0.5) else (-0.8, -0.6, 0.0)
        posture = ArmPosture("world", (x, height, z), (0.7, -0.7, -0.4), palm, draw.between(0.0, 0.012))
        script.arm(side, posture, begin, begin + seconds)


def _step_aside(script: Script) -> None:
    """Take a side step of 10 to 35 cm along the table; the second foot follows."""
    draw = script.draw
    left = draw.between(0.1, 0.35) * (1 if draw.chance(0.5) else -1)
    first = int(left < 0)
    places = [foot_place(script, side, left) for side in (0, 1)]
    for side in (first, 1 - first):
        script.step(side, places[side], foot_yaw(script, side), script.clock + 0.15, script.duration(0.3, 0.45),
                    lift=draw.between(0.03, 0.06), shift=draw.between(0.45, 0.7), heel=draw.between(5, 20))  # fmt: skip
    script.moves.to(script.clock - 0.2, script.clock + 0.4, **dict(zip(("x", "z"), script.middle(), strict=True)))
    script.clock += 0.2
