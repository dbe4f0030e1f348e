"""Scenes with bent legs: squat, pick up, kneel on one and on both knees."""

from __future__ import annotations

import numpy as np

from bodysense_lab.synthesis.scenes import arm_postures
from bodysense_lab.synthesis.scenes.script import KNEE, SIGN, ArmPosture, Script
from bodysense_lab.synthesis.scenes.standing_scenes import change_arms, square_feet, take_arms


def squat(script: Script) -> None:
    """Squat, with flat feet or on the balls of the feet, and stand up."""
    draw = script.draw
    begin = script.clock
    deep = draw.chance(0.4)
    depth = draw.between(0.42, 0.55) if deep else draw.between(0.64, 0.85)  # of the standing height of the hips
    down, up, hold = script.duration(0.8, 1.6), script.duration(0.8, 1.6), script.duration(0.4, 2.5)
    held = begin + down
    standing = script.moves.value["height"]
    lean = draw.between(10, 28) * (1 - depth) / 0.4
    script.moves.pulse(begin, held, held + hold, held + hold + up, height=(depth - 1) * standing, tilt=lean,
                       bend=0.6 * lean)  # fmt: skip
    spread = draw.between(4, 22)
    for side in (0, 1):
        heel = draw.between(28, 42) if deep else 0.0
        script.moves.pulse(begin + 0.2 * down, held, held + hold, held + hold + 0.8 * up,
                           **script.of(side, heel=heel, knee_out=spread))  # fmt: skip
    change_arms(script, (arm_postures.with_controllers, arm_postures.talking, arm_postures.raised), 0.7)
    script.clock = held + hold + up
    script.wait(0.4, 1.2)


def pick_up(script: Script) -> None:
    """Pick something up from a height of 0 to 50 cm, squatting or bowing."""
    draw = script.draw
    begin = script.clock
    squats = draw.chance(0.5)
    down, up, hold = script.duration(0.9, 1.6), script.duration(0.9, 1.6), script.duration(0.2, 0.8)
    held = begin + down
    standing = script.moves.value["height"]
    depth, tilt, bend = (draw.between(0.5, 0.65), draw.between(14, 26), draw.between(18, 30)) if squats else (
        draw.between(0.9, 0.98), draw.between(42, 58), draw.between(28, 42))  # fmt: skip
    script.moves.pulse(begin, held, held + hold, held + hold + up, height=(depth - 1) * standing, tilt=tilt, bend=bend,
                       gaze_pitch=draw.between(15, 40))  # fmt: skip
    hand = draw.side()
    for side in (0, 1):
        rises = draw.between(20, 34) if squats else 0.0
        script.moves.pulse(begin + 0.2 * down, held, held + hold, held + hold + 0.8 * up,
                           **script.of(side, heel=rises, knee_out=draw.between(2, 14) if squats else 0.0))  # fmt: skip
        if side == hand or draw.chance(0.5):
            x, z = script.offset(script.middle(), SIGN[side] * draw.between(0.03, 0.16),
                                 draw.between(0.28, 0.42) * script.frame.scale)  # fmt: skip
            low = draw.between(0.1, 0.5) if squats else draw.between(0.12, 0.45)
            grips = ArmPosture("world", (x, low, z), (0.7, -0.2, -0.8), (-0.7, -0.5, 0.0), 0.0)
            script.arm(side, grips, begin + 0.15 * down, held)
        else:
            script.arm(side, arm_postures.hanging(draw)[0], begin, held)
    script.clock = held + hold
    take_arms(script, arm_postures.with_controllers(draw), script.clock, 0.9 * up)
    if not squats:
        script.phase("bowing", begin + 0.7 * down, held + hold + 0.3 * up)
    script.clock += up
    script.wait(0.4, 1.2)


def kneel_on_one(script: Script) -> None:
    """Kneel on one knee, stay, and stand up."""
    side = script.draw.side()
    _go_down(script, side)
    _stay(script)
    _stand_up(script, (side,))


def kneel_on_both(script: Script) -> None:
    """Kneel on one knee, then on both, stay upright or sit back on the heels, and stand up."""
    draw = script.draw
    first = draw.side()
    _go_down(script, first)
    second, now = 1 - first, script.clock
    takes = script.duration(0.6, 1.0)
    _put_knee(script, second, now, takes, rises=0.07)
    script.moves.add(now, now + takes, **script.of(second, heel=0.0))
    script.clock = now + takes
    if draw.chance(0.5):
        _sit_on_heels(script)
    else:
        _stay(script)
    _stand_up(script, (first, second))


def _knee_place(script: Script, side: int) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return x and z, m, of a knee on the floor under its hip and of its flat ankle, and the heel's angle, degrees."""
    frame = script.frame
    knee = script.place(SIGN[side] * frame.hip_width, 0.0)
    heel = 72.0
    # The toes stay on the floor: the ankle is over the ball, and the shin goes from it to the knee.
    pitch = np.radians(heel)
    ball = frame.ball[side]
    up = frame.ankle + ball[1] + (-ball[1] * np.cos(pitch) + ball[2] * np.sin(pitch))
    behind = float(np.sqrt(frame.shin**2 - (up - KNEE * frame.scale) ** 2))
    moved = ball[2] - (ball[2] * np.cos(pitch) + ball[1] * np.sin(pitch))
    flat = script.offset(knee, 0.0, -behind - moved)
    return knee, flat, heel


def _put_knee(script: Script, side: int, begin: float, seconds: float, *, rises: float) -> None:
    """Move a knee to the floor under its hip, with the foot on its toes."""
    knee, flat, heel = _knee_place(script, side)
    moves, of = script.moves, script.of
    moves.to(begin, begin + 0.001, **of(side, knee_x=knee[0], knee_z=knee[1]))
    moves.to(begin, begin + seconds, **of(side, ankle_x=flat[0], ankle_z=flat[1], foot_yaw=script.yaw, heel=heel))
    moves.bump(begin, begin + seconds, **of(side, lift=rises))
    moves.to(begin + 0.15 * seconds, begin + seconds, **of(side, kneel=1.0))
    script.step_recorded(side, begin, begin + seconds)


def _go_down(script: Script, side: int) -> None:
    """Step back with one foot and lower its knee to the floor."""
    draw, frame = script.draw, script.frame
    square_feet(script)
    script.wait(0.3, 0.6)
    other = 1 - side
    front = script.ankle(other)
    begin = script.clock
    step, down = script.duration(0.55, 0.75), script.duration(0.7, 1.2)
    # The hips end behind the front foot.
    back = draw.between(0.24, 0.36) * frame.scale
    hips = script.offset(front, -SIGN[other] * frame.hip_width, -back)
    moves = script.moves
    moves.to(begin, begin + step + down, x=hips[0], z=hips[1])
    knee, flat, heel = _knee_place(script, side)
    script.step(side, flat, script.yaw, begin + 0.15, step, lift=0.05, shift=0.5, advance=0.0, heel=0.0)
    landed = begin + 0.15 + step
    moves.to(begin, landed, **script.of(side, heel=heel))
    moves.to(begin, begin + 0.001, **script.of(side, knee_x=knee[0], knee_z=knee[1]))
    moves.to(landed - 0.2, landed + down, **script.of(side, kneel=1.0))
    moves.pulse(begin - 0.2, begin + 0.2, landed, landed + down, softness=0.012)
    moves.to(begin - 0.1, landed + down, height=KNEE * frame.scale + frame.thigh)
    moves.to(begin + 0.1, landed + down, balance=0.0, sway=0.0, tilt=draw.between(-2, 6), roll=0.0)
    moves.bump(begin, landed + down, bend=draw.between(8, 20))
    change_arms(script, share=0.5)
    script.clock = landed + down


def _sit_on_heels(script: Script) -> None:
    """Lower the hips from upright knees toward the heels, stay, and rise."""
    draw = script.draw
    down, up, hold = script.duration(0.8, 1.4), script.duration(0.8, 1.3), script.duration(1.0, 3.0)
    begin, held = script.clock, script.clock + down
    script.moves.pulse(begin, held, held + hold, held + hold + up, kneel_angle=draw.between(25, 46))
    script.moves.pulse(begin, held, held + hold, held + hold + up, tilt=draw.between(-5, 8))
    script.phase("kneeling", begin, held + hold + up)
    change_arms(script, share=0.4)
    script.clock = held + hold + up


def _stay(script: Script) -> None:
    """Stay on the knees and look about."""
    begin = script.clock
    change_arms(script, share=0.5)
    script.wait(1.5, 4.0)
    script.phase("kneeling", begin, script.clock)


def _stand_up(script: Script, knees: tuple[int, ...]) -> None:
    """Stand up from one or both knees."""
    draw, frame, moves = script.draw, script.frame, script.moves
    if len(knees) == 2:  # one foot first comes to the front
        side = knees[1]
        now, takes = script.clock, script.duration(0.6, 0.9)
        front = script.place(SIGN[side] * frame.hip_width, draw.between(0.24, 0.34) * frame.scale)
        moves.to(now, now + takes, **script.of(side, ankle_x=front[0], ankle_z=front[1], heel=0.0,
                                               foot_yaw=script.yaw + SIGN[side] * script.outward))  # fmt: skip
        moves.bump(now, now + takes, **script.of(side, lift=0.08))
        moves.to(now, now + 0.85 * takes, **script.of(side, kneel=0.0))
        script.step_recorded(side, now, now + takes)
        script.clock = now + takes + 0.1
    side = knees[0]
    other = 1 - side
    now, up = script.clock, script.duration(1.1, 1.6)
    moves.to(now, now + 0.6 * up, **script.of(side, kneel=0.0))
    front = script.ankle(other)
    middle = script.offset(front, SIGN[side] * script.apart, -0.02)
    moves.to(now, now + up, x=middle[0], z=middle[1], height=frame.leg + frame.ankle + 0.02)
    moves.to(now + 0.2 * up, now + up, balance=1.0, sway=1.0, **script.upright)
    moves.bump(now, now + up, bend=draw.between(10, 25))
    moves.pulse(now - 0.2, now + 0.2, now + up, now + 1.5 * up, softness=0.012)
    place = script.offset(front, SIGN[side] * 2 * script.apart, 0.0)
    rises, takes = now + 0.4 * up, 0.62 * up
    moves.to(rises - 0.1, rises + takes, **script.of(side, heel=0.0))
    script.step(side, place, script.yaw + SIGN[side] * script.outward, rises, takes, lift=0.05, shift=0.3, heel=0.0,
                advance=0.0)  # fmt: skip
    moves.to(script.clock - 0.3, script.clock + 0.5, **dict(zip(("x", "z"), script.middle(), strict=True)))
    script.wait(0.7, 1.4)
