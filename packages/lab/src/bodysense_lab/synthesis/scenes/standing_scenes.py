"""Scenes on the feet: sway, small steps, turns, a foot set forward, bows, weight on a leg, walls, walks."""

from __future__ import annotations

import numpy as np

from bodysense_lab.synthesis.scenes import arm_postures
from bodysense_lab.synthesis.scenes.script import SIDES, SIGN, ArmPosture, Script


def take_arms(script: Script, pair: arm_postures.PAIR, begin: float, seconds: float) -> None:
    """Move both arms to postures, one a little after the other."""
    late = script.draw.between(0.0, 0.25)
    for side, posture in enumerate(pair):
        script.arm(side, posture, begin + late * side, begin + late * side + seconds)


def change_arms(script: Script, kinds: tuple = arm_postures.EVERYDAY, share: float = 0.6) -> None:
    """Take other postures of the arms in a `share` of calls."""
    if script.draw.chance(share):
        kind = kinds[int(script.draw.rng.integers(len(kinds)))]
        take_arms(script, kind(script.draw), script.clock, script.duration(0.6, 1.4))


def glance(script: Script, begin: float, end: float) -> None:
    """Look about between two times, s. The trunk follows a gaze that goes down, of some people more, of some less."""
    draw, now = script.draw, begin
    follows = draw.between(0.0, 0.8) if draw.chance(0.6) else 0.0
    while now < end:
        now += draw.between(0.4, 3.0)
        takes = draw.between(0.3, 0.9)
        yaw, pitch = draw.between(-55, 55) * draw.between(0.1, 1.0), draw.between(-12, 28)
        pitch += draw.between(0, 14) if draw.chance(0.25) else 0.0
        before = max(script.moves.value["gaze_pitch"], 0.0)
        script.moves.to(now, now + takes, gaze_yaw=yaw, gaze_pitch=pitch)
        script.moves.add(now, now + takes + 0.3, bend=follows * (max(pitch, 0.0) - before))
        now += takes


def square_feet(script: Script) -> None:
    """Put both feet side by side under the body if they are not."""
    for side in (0, 1):
        wanted = foot_place(script, side)
        now = script.ankle(side)
        turned = abs((script.moves.value[f"{SIDES[side]}_foot_yaw"] - foot_yaw(script, side) + 180) % 360 - 180)
        if np.hypot(wanted[0] - now[0], wanted[1] - now[1]) > 0.05 or turned > 25:
            begin = script.clock + 0.25
            script.step(side, wanted, foot_yaw(script, side), begin, script.duration(0.35, 0.5), lift=0.05, shift=0.5)


def foot_place(script: Script, side: int, left: float = 0.0, ahead: float = 0.0) -> tuple[float, float]:
    """Return x and z, m, of a foot under the body, moved to the left and ahead."""
    return script.place(SIGN[side] * script.apart + left, ahead)


def foot_yaw(script: Script, side: int) -> float:
    """Return the yaw of a standing foot, degrees."""
    return script.yaw + SIGN[side] * script.outward


def stand(script: Script) -> None:
    """Stand, sway and look about."""
    begin = script.wait(2.5, 6.0)
    change_arms(script)
    if script.draw.chance(0.5):  # the weight wanders
        ease = script.duration(1.0, 2.0)
        left = script.draw.between(-0.04, 0.04) * script.frame.scale
        x, z = script.place(left, script.draw.between(-0.015, 0.025))
        there = {"x": x - script.moves.value["x"], "z": z - script.moves.value["z"]}
        script.moves.pulse(begin, begin + ease, script.clock - 0.3, script.clock + ease, **there)
        script.clock += ease
    script.phase("standing", begin, script.clock)


def shuffle(script: Script) -> None:
    """Take small steps in random directions, of 4 to 15 cm, and stand between them."""
    draw = script.draw
    begin = script.clock
    for _ in range(int(draw.rng.integers(2, 6))):
        way, length = draw.between(0, 2 * np.pi), draw.between(0.04, 0.15)
        left, ahead = length * np.sin(way), length * np.cos(way)
        turned = draw.between(-12, 12)
        first = int(left < 0)
        aim = foot_place(script, first, left, ahead), foot_place(script, 1 - first, left, ahead)
        for side, place in zip((first, 1 - first), aim, strict=True):
            seconds = script.duration(0.22, 0.4)
            lead = draw.between(0.12, 0.3)
            yaw = foot_yaw(script, side) + turned
            script.step(side, place, yaw, script.clock + lead, seconds, lift=draw.between(0.02, 0.05),
                        shift=draw.between(0.45, 0.7), heel=draw.between(8, 22), lead=lead)  # fmt: skip
            script.clock += draw.between(0.05, 0.2)
        script.moves.add(script.clock - 0.8, script.clock, yaw=turned)
        script.wait(0.3, 1.5)
        change_arms(script, share=0.2)
    script.phase("standing", begin, script.clock)


def step_back(script: Script) -> None:
    """Take one to four steps back of 0.1 to 0.35 m, and stand."""
    begin, draw = script.clock, script.draw
    _steps(script, 0.0, -draw.between(0.12, 0.35), int(draw.rng.integers(1, 5)))
    script.wait(0.8, 2.0)
    script.phase("standing", begin, script.clock)


def step_aside(script: Script) -> None:
    """Take one to three side steps of 0.12 to 0.4 m, and stand."""
    begin, draw = script.clock, script.draw
    way = 1.0 if draw.chance(0.5) else -1.0
    _steps(script, way * draw.between(0.12, 0.4), 0.0, int(draw.rng.integers(1, 4)))
    script.wait(0.8, 2.0)
    script.phase("standing", begin, script.clock)


def step_ahead(script: Script) -> None:
    """Take one to four short steps ahead, and stand."""
    begin, draw = script.clock, script.draw
    _steps(script, draw.between(-0.08, 0.08), draw.between(0.12, 0.4), int(draw.rng.integers(1, 5)))
    script.wait(0.8, 2.0)
    script.phase("standing", begin, script.clock)


def _steps(script: Script, left: float, ahead: float, count: int) -> None:
    """Move the body by steps of (left, ahead) m; a last step puts the feet side by side."""
    draw = script.draw
    first = int(left < 0) if abs(left) > abs(ahead) else draw.side()
    seconds, gap = script.duration(0.32, 0.5), draw.between(0.06, 0.35)
    lift, shift = draw.between(0.03, 0.08), draw.between(0.5, 0.75)
    heel = draw.between(10, 28) if ahead >= 0 else draw.between(2, 8)  # a foot that goes back leaves the floor flat
    where = script.middle()
    closes = abs(left) > abs(ahead)  # feet that go sideways do not pass each other

    def put(side: int) -> None:
        place = script.offset(where, SIGN[side] * script.apart, 0.0)
        script.step(side, place, foot_yaw(script, side), script.clock + gap, seconds, lift=lift, shift=shift, heel=heel,
                    toes_up=10.0 if ahead > 0.2 else 0.0, lead=min(0.3, gap + 0.15))  # fmt: skip

    side = first
    for _ in range(count):
        where = script.offset(where, left, ahead)
        put(side)
        if closes:
            put(1 - side)
        else:
            side = 1 - side
    if not closes:
        put(side)


def turn(script: Script) -> None:
    """Turn on the spot by 40 to 200° at 20 to 180° a second."""
    draw = script.draw
    begin = script.clock
    rate = float(np.exp(draw.between(np.log(20), np.log(180))))
    total = draw.between(40, 200) * (1 if draw.chance(0.5) else -1)
    total = float(np.sign(total)) * min(abs(total), 6.0 * rate)
    period = min(draw.between(0.4, 0.75), max(0.27, 40 / rate))
    lasts = abs(total) / rate
    centre, yaw = script.middle(), script.yaw
    script.moves.add(begin, begin + 1.3 * lasts + 0.5, yaw=total)
    lead = draw.between(0.0, 25.0) * float(np.sign(total))
    script.moves.pulse(begin - 0.25, begin + 0.35, begin + lasts, begin + 1.3 * lasts + 0.4, gaze_yaw=lead)
    side = int(total < 0)
    count = max(2, int(np.ceil((1.3 * lasts + 0.3) / period)))
    ease_end = 1.3 * lasts + 0.5
    for k in range(count + 1):
        start = begin + 0.12 + k * period
        seconds = period * draw.between(0.7, 0.85)
        share = np.clip((start - begin + seconds + 0.75 * period) / ease_end, 0, 1)
        share = share**3 * (10 - 15 * share + 6 * share**2)
        aim = yaw + total * (1.0 if k >= count - 1 else float(share))
        place = script.offset(centre, SIGN[side] * script.apart, 0.0, aim)
        script.step(side, place, aim + SIGN[side] * script.outward, start, seconds, lift=draw.between(0.02, 0.06),
                    shift=draw.between(0.3, 0.5), heel=draw.between(6, 18), lead=0.5 * period, advance=0.0)  # fmt: skip
        side = 1 - side
    script.moves.to(script.clock - 0.4, script.clock + 0.2, x=centre[0], z=centre[1])
    script.wait(0.8, 2.0)
    script.phase("standing", begin, script.clock)


def foot_forward(script: Script) -> None:
    """Set a foot forward by 0.25 to 0.6 m, hold the stance and box or reach, and step back."""
    draw = script.draw
    begin, side = script.clock, draw.side()
    ahead = draw.between(0.25, 0.56) * script.frame.scale
    home = script.ankle(side)
    place = script.offset(home, SIGN[side] * draw.between(-0.03, 0.08), ahead)
    seconds = script.duration(0.38, 0.55)
    script.step(side, place, script.yaw + SIGN[side] * draw.between(0, 12), begin + 0.35, seconds, lift=0.06, shift=0.5,
                toes_up=10.0, lead=0.35)  # fmt: skip
    kind = (arm_postures.guard, arm_postures.raised, arm_postures.with_controllers)[int(draw.rng.integers(3))]
    take_arms(script, kind(draw), begin + 0.2, script.duration(0.6, 1.0))
    rear, landed = 1 - side, script.clock
    turned = draw.between(0, 25) * SIGN[rear]
    script.moves.add(begin + 0.3, landed + 0.4, twist=turned * 0.5, bend=draw.between(0, 10))
    back = -turned * 0.5
    lowers = draw.between(0.0, 0.05) * script.frame.scale
    raises = draw.between(0, 18) if draw.chance(0.6) else 0.0
    raises += 60 * max(0.0, ahead / script.frame.scale - 0.36)  # the ankle of the rear foot bends only so far
    held = script.clock + 0.4
    script.moves.add(landed, held, **script.of(rear, heel=raises))
    standing = script.moves.value["height"]
    script.moves.to(landed - 0.3, held + 0.2, height=standing - 0.02 - lowers - 0.16 * ahead**2)
    script.wait(2.0, 4.5)
    script.phase("standing", begin, script.clock)
    script.moves.to(script.clock - 0.1, script.clock + 0.5, height=standing)
    script.moves.add(script.clock - 0.2, script.clock + 0.3, **script.of(rear, heel=-raises))
    script.moves.add(script.clock, script.clock + 0.8, twist=back)
    script.step(
        side, home, foot_yaw(script, side), script.clock + 0.35, seconds, lift=0.05, heel=5.0, shift=0.6, lead=0.3
    )
    change_arms(script, share=1.0)
    script.wait(0.5, 1.2)


def bow(script: Script) -> None:
    """Bow with straight legs by 30 to 115°."""
    draw = script.draw
    begin = script.clock
    tilt, bend = draw.between(12, 45), draw.between(18, 45)
    if draw.chance(0.5):  # deep
        tilt, bend = draw.between(45, 65), draw.between(30, 50)
    down, up = script.duration(0.8, 1.8), script.duration(0.8, 1.8)
    hold = script.duration(0.3, 2.0)
    held = begin + down
    script.moves.pulse(
        begin, held, held + hold, held + hold + up, tilt=tilt, bend=bend, gaze_pitch=draw.between(-10, 35)
    )
    if draw.chance(0.6):
        change_arms(script, (arm_postures.hanging, arm_postures.folded_in_front, arm_postures.with_controllers), 1.0)
    script.clock = held + hold + up
    script.phase("bowing", begin + 0.7 * down, held + hold + 0.3 * up)
    script.wait(0.5, 1.5)


def weight_on_one_leg(script: Script) -> None:
    """Stand on one leg with the other relaxed, its knee bent, and change legs."""
    draw = script.draw
    begin = script.clock
    for _ in range(int(draw.rng.integers(1, 3))):
        side = draw.side()
        seconds = script.duration(0.7, 1.4)
        middle, foot = script.middle(), script.ankle(side)
        share = draw.between(0.6, 0.95)
        over = {"x": share * (foot[0] - middle[0]), "z": share * (foot[1] - middle[1])}
        roll = SIGN[side] * draw.between(2, 7)
        raised = draw.between(0, 14) if draw.chance(0.4) else 0.0
        hold = script.duration(1.5, 4.0)
        free = 1 - side
        now = script.clock
        script.moves.pulse(now, now + seconds, now + seconds + hold, now + 2 * seconds + hold, **over,
                           roll=roll, side=-roll * 1.1)  # fmt: skip
        script.moves.pulse(now + 0.5 * seconds, now + 1.3 * seconds, now + seconds + hold - 0.4,
                           now + 1.4 * seconds + hold, **script.of(free, heel=raised))  # fmt: skip
        script.clock = now + 2 * seconds + hold
        change_arms(script, share=0.4)
    script.phase("standing", begin, script.clock)


def crossed_ankles(script: Script) -> None:
    """Stand with crossed ankles: a foot is set down in front of the other and beyond it."""
    draw = script.draw
    begin, side = script.clock, draw.side()
    home = script.ankle(side)
    beyond, ahead = draw.between(0.05, 0.11), draw.between(0.1, 0.17)
    place = script.offset(script.ankle(1 - side), -SIGN[side] * beyond, ahead * script.frame.scale)
    seconds = script.duration(0.4, 0.6)
    script.step(side, place, script.yaw - SIGN[side] * draw.between(0, 15), begin + 0.4, seconds, lift=0.07, shift=0.8,
                lead=0.4, advance=0.65)  # fmt: skip
    raised = draw.between(0, 28)
    script.moves.add(script.clock - 0.1, script.clock + 0.4, **script.of(side, heel=raised))
    change_arms(script, share=0.5)
    script.wait(2.0, 4.5)
    script.phase("standing", begin, script.clock)
    script.moves.add(script.clock - 0.1, script.clock + 0.3, **script.of(side, heel=-raised))
    script.step(side, home, foot_yaw(script, side), script.clock + 0.35, seconds, lift=0.07, shift=0.7, lead=0.35,
                advance=0.65)  # fmt: skip
    script.moves.to(script.clock - 0.2, script.clock + 0.5, **dict(zip(("x", "z"), script.middle(), strict=True)))
    script.wait(0.6, 1.2)


def lean_on_wall(script: Script) -> None:
    """Lean on a wall with a hand and a shoulder turned to it, or with both hands ahead."""
    draw = script.draw
    begin = script.clock
    seconds, arm = script.duration(0.9, 1.6), script.frame.arm
    high = draw.between(1.1, 1.5) * script.frame.scale
    ahead = draw.chance(0.5)
    sides = (0, 1) if ahead and draw.chance(0.6) else (draw.side(),)
    far = draw.between(0.75, 0.95) * arm
    for side in sides:
        left, front = SIGN[side] * 0.2, far + 0.05
        if not ahead:
            left, front = SIGN[side] * (far + 0.17), draw.between(0.0, 0.15)
        x, z = script.offset(script.middle(), left * 1.0, front)
        palm = (0.0, 0.0, 1.0) if ahead else (1.0, 0.0, 0.2)
        posture = ArmPosture("world", (x, high, z), (0.5, -1.0, 0.0), palm, 0.0)
        script.arm(side, posture, begin, begin + seconds)
    leans = draw.between(3, 8)
    lean = {"tilt": leans, "bend": 0.5 * leans} if ahead else {"roll": -SIGN[sides[0]] * leans}
    moved = 0.012 * leans
    to = script.offset((0.0, 0.0), 0.0 if ahead else SIGN[sides[0]] * moved, moved if ahead else 0.0)
    released = begin + seconds + script.duration(2.0, 4.5)
    script.moves.pulse(begin, begin + seconds, released, released + seconds, **lean, x=to[0], z=to[1])
    script.phase("standing", begin, released)
    script.clock = released
    take_arms(script, arm_postures.hanging(draw), released, seconds)
    script.clock = released + seconds
    script.wait(0.3, 1.0)


def _hold_arms(script: Script, kind) -> None:
    """Stand with the arms in a posture, and shift the weight or take a small step meanwhile."""
    begin = script.clock
    take_arms(script, kind(script.draw), begin, script.duration(0.7, 1.3))
    script.wait(1.2, 2.0)
    if script.draw.chance(0.3):
        shuffle_once = script.draw.side()
        place = script.offset(script.ankle(shuffle_once), 0.0, script.draw.between(-0.08, 0.08))
        script.step(shuffle_once, place, foot_yaw(script, shuffle_once), script.clock + 0.3, script.duration(0.25, 0.4),
                    lift=0.03, shift=0.6)  # fmt: skip
    script.wait(2.0, 4.5)
    script.phase("standing", begin, script.clock)
    change_arms(script, share=0.7)
    script.wait(0.6, 1.4)


def hands_behind_back(script: Script) -> None:
    """Stand with the hands behind the back."""
    _hold_arms(script, arm_postures.behind_back)


def hands_behind_head(script: Script) -> None:
    """Stand with the hands behind the head."""
    _hold_arms(script, arm_postures.behind_head)


def hands_on_hips(script: Script) -> None:
    """Stand with the hands on the hips."""
    _hold_arms(script, arm_postures.on_hips)


def arms_crossed(script: Script) -> None:
    """Stand with crossed arms."""
    _hold_arms(script, arm_postures.crossed)


def reach(script: Script) -> None:
    """Reach up or ahead, at times on tiptoe."""
    if script.draw.chance(0.3):
        _stand_on_tiptoe(script)
    else:
        _hold_arms(script, arm_postures.raised)


def _stand_on_tiptoe(script: Script) -> None:
    """Rise on the balls of the feet with raised hands, and come down."""
    draw, begin = script.draw, script.clock
    heel, takes, hold = draw.between(15, 34), script.duration(0.6, 1.1), script.duration(0.8, 2.0)
    take_arms(script, arm_postures.raised(draw), begin, takes)
    held, end = begin + takes + hold, begin + 2 * takes + hold
    ahead = 0.1 * script.frame.scale  # the weight moves over the balls of the feet
    script.moves.pulse(begin, begin + takes, held, end, lead=ahead, height=0.15)
    for side in (0, 1):
        script.moves.pulse(begin + 0.1, begin + takes, held, end, **script.of(side, heel=heel))
    script.clock = end
    change_arms(script, share=1.0)
    script.wait(1.0, 2.0)
    script.phase("standing", begin, script.clock)


def walk(script: Script) -> None:
    """Walk at 0.4 to 1.5 m/s along a straight or bent way, and stand."""
    draw = script.draw
    begin = script.clock
    speed = draw.between(0.4, 1.5)
    cadence = (0.95 + 0.7 * speed / script.frame.scale) * draw.between(0.94, 1.1)  # steps a second
    period, length = 1 / cadence, speed / cadence
    count = int(draw.rng.integers(4, 11))
    bend = draw.between(-14, 14) if draw.chance(0.6) else 0.0  # degrees a step
    swing, stiff = draw.between(8, 26) * min(1.2, 0.4 + 0.6 * speed), draw.between(0.8, 1.2)
    take_arms(script, arm_postures.hanging(draw) if draw.chance(0.7) else arm_postures.with_controllers(draw),
              begin - 0.3, 0.9)  # fmt: skip
    side = draw.side()
    air = period * (0.78 + 0.17 * speed / 1.5)
    where, yaw = script.middle(), script.yaw
    lead = 0.75 * period
    strike = 6 + 12 * speed / 1.5
    apart = script.apart * draw.between(0.55, 0.9)
    lowered = -(0.012 + 0.018 * speed / 1.5) * script.frame.leg
    leans = draw.between(0, 5)
    script.moves.add(begin, begin + 0.35 + period, height=lowered, lead=-0.04 * speed, bend=leans)
    for k in range(count + 1):
        start = begin + 0.35 + k * period
        last = k == count
        if not last:
            yaw += bend
            way = script.offset(where, 0.0, length if k else 0.6 * length, yaw - bend / 2)
            where = way
        half = script.apart if last or k == count - 1 else apart
        place = script.offset(where, SIGN[side] * half, 0.0, yaw)
        script.step(side, place, yaw + SIGN[side] * 0.7 * script.outward, start, air,
                    lift=draw.between(0.015, 0.035) + 0.01 * speed, shift=0.22 if speed > 0.8 else 0.38,
                    heel=(24 + 32 * speed / 1.5) if k else 15.0, toes_up=0.0 if last else strike,
                    lead=lead, softness=0.006)  # fmt: skip
        script.moves.add(start - 0.5 * period, start + period, yaw=0.0 if last else bend)
        waves = 0.0 if last else 1.0
        away = SIGN[side] * waves  # the leg of this side goes ahead: so do its hip and the other arm
        script.moves.bump(start - 0.5 * period, start + air + 0.5 * period, twist=away * 5 * stiff)
        for arm in (0, 1):
            script.moves.to(start, start + air + 0.15 * period,
                            **script.of(arm, arm_swing=waves * swing * (1 if arm != side else -0.7)))  # fmt: skip
        side = 1 - side
    script.moves.add(script.clock - 0.5 * period, script.clock + 0.4, height=-lowered, lead=0.04 * speed, bend=-leans)
    script.moves.to(script.clock - 0.3, script.clock + 0.5, **dict(zip(("x", "z"), script.middle(), strict=True)))
    script.wait(0.7, 1.5)
    script.phase("standing", script.clock - 0.6, script.clock)
