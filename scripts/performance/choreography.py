"""Choreography of a headset's wearer: postures, contacts, steps and glances over time.

World: +Y up, metres; the wearer starts at the origin and faces +Z. Angles in degrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .figure import FINGERS
from .spacetime import Spot
from .walking import Walk, footfalls

FRAME_RATE = 30.0
SECONDS = 25.0
SEAT_HEIGHT = 0.45  # m, height of the virtual seat
Posture = Mapping[str, float]
Vector = tuple[float, float, float]


def frame_times() -> np.ndarray:
    """(T,) s, of the frames."""
    return np.arange(round(SECONDS * FRAME_RATE)) / FRAME_RATE


@dataclass(frozen=True, eq=False)
class Meeting:
    """A contact of an action: two points that meet, or two directions that agree."""

    a: Spot
    b: Spot
    share: float = 1.0  # of the full weight
    direction: bool = False


@dataclass(frozen=True, eq=False)
class Action:
    """A posture that is held for some time."""

    name: str
    start: float  # s: reached
    end: float  # s: left
    posture: Posture
    meetings: Sequence[Meeting] = field(default=())
    gaze: Vector = (0.0, 0.0, 1.0)  # direction of the face


@dataclass(frozen=True, eq=False)
class Passing:
    """An offset that is largest at `time`, and zero from `ramp` seconds before and after."""

    time: float
    ramp: float
    posture: Posture


def both(**posture: float) -> dict[str, float]:
    """Return a posture's angles for both sides."""
    return {f"{side}_{name}": value for side in ("left", "right") for name, value in posture.items()}


def hand(side: str, knuckle: float, curl: float, fan: float = 0.0, **posture: float) -> dict[str, float]:
    """Return angles of equally curled fingers, with `fan` degrees more for each finger toward the little one."""
    result = {f"{side}_{name}": value for name, value in posture.items()}
    for place, finger in enumerate(FINGERS):
        result[f"{side}_{finger}_knuckle"] = knuckle + fan * place
        result[f"{side}_{finger}_curl"] = curl + fan * place
    return result


def relaxed(side: str) -> dict[str, float]:
    """A hand that hangs or rests."""
    return hand(side, 16, 26, 3, thumb_close=5, thumb_down=8, thumb_curl=14) | {f"{side}_index_spread": 3.0}


HANG = both(
    arm_raise=-77, arm_forward=4, arm_twist=8, elbow=16, pronation=18, wrist_flex=4, collar_raise=-2,
    hip_flex=4, knee=8, ankle=4, hip_out=2, hip_twist=6,
)  # fmt: skip
STAND: Posture = {**HANG, **relaxed("left"), **relaxed("right"), "y": 0.985, "z": 0.045, "bend": 2.0}


def pad(side: str, finger: str) -> Spot:
    """The pad of a finger."""
    sign = 1.0 if side == "left" else -1.0
    return Spot(f"{side}_{finger}3", (0.016 * sign, -0.008 if finger != "thumb" else -0.014, 0.0))


def on(joint: str, x: float, y: float, z: float) -> Spot:
    """A point (or a direction) of a joint."""
    return Spot(joint, (x, y, z))


def palm(side: str) -> Spot:
    """The middle of the palm's skin."""
    return on(f"{side}_wrist", 0.0529 if side == "left" else -0.0529, -0.0222, -0.003)


def facing(side: str, to: Spot, share: float = 0.0005) -> Meeting:
    """The palm faces a direction."""
    return Meeting(on(f"{side}_wrist", 0, -1, 0), to, share, direction=True)


def reach(side: str, to: Spot, share: float = 0.0005) -> Meeting:
    """The hand runs along a direction."""
    return Meeting(on(f"{side}_wrist", 1 if side == "left" else -1, 0, 0), to, share, direction=True)


WALKS = (
    Walk(0.5, 0.0, 0.0, 0.0, ((1.6, 0.0), (1.6, 130.0), (0.75, 0.0)), 8),
    Walk(20.6, 0.0, 0.0, 0.0, ((0.7, -20.0), (0.9, -60.0)), 4),  # from where the first ends
)
_STAND_AT = WALKS[0].at(np.array([WALKS[0].end]))[0]  # x, z, degrees: where the wearer stands between the walks
WALKS = (WALKS[0], replace(WALKS[1], x=_STAND_AT[0], z=_STAND_AT[1], heading=_STAND_AT[2]))
STEPS = footfalls(WALKS, SECONDS)

WAVE = {
    **STAND,
    **hand("right", 4, 8, 1, thumb_close=-18, thumb_down=5, thumb_curl=4),
    "right_arm_raise": -6.0, "right_arm_forward": 28.0, "right_arm_twist": -72.0, "right_elbow": 104.0,
    "right_pronation": 30.0, "right_collar_raise": 8.0, "head_side": 3.0, "x": 0.015,
}  # fmt: skip
TALK = {
    **both(arm_raise=-70, arm_forward=26, arm_twist=4, elbow=78, pronation=-38, wrist_flex=-8),
    **hand("right", 14, 18, 4, thumb_close=-12, thumb_down=8, thumb_curl=8),
    **hand("left", 18, 22, 4, thumb_close=-10, thumb_down=8, thumb_curl=8),
}  # fmt: skip
SIT = {
    **STAND,
    **both(hip_flex=82, knee=84, ankle=2, hip_out=6),
    **both(arm_raise=-72, arm_forward=28, arm_twist=18, elbow=58, pronation=42, wrist_flex=8),
    "y": 0.632, "z": -0.40, "tilt": -6.0, "bend": 8.0,
}  # fmt: skip
SIT_TALK = {**SIT, **TALK, "head_nod": 3.0}
HIGH = {
    **STAND,
    **hand("left", 20, 26, 2, thumb_close=-15, thumb_down=10, thumb_curl=12),
    "left_arm_raise": 30.0, "left_arm_forward": 70.0, "left_arm_twist": -20.0, "left_elbow": 22.0,
    "left_collar_raise": 18.0, "left_pronation": 20.0, "head_nod": -14.0, "side": -4.0, "x": 0.02,
}  # fmt: skip
LOW = {
    **STAND,
    **both(hip_flex=34, knee=34, ankle=14),
    **hand("right", 28, 34, 2, thumb_close=-8, thumb_down=14, thumb_curl=14),
    "right_arm_raise": -50.0, "right_arm_forward": 62.0, "right_arm_twist": 10.0, "right_elbow": 24.0,
    "right_pronation": 30.0, "y": 0.90, "z": -0.10, "tilt": 18.0, "bend": 22.0, "head_nod": 6.0,
}  # fmt: skip
POINT = {
    **STAND,
    **hand("right", 75, 88, 3, thumb_close=30, thumb_down=10, thumb_curl=42),
    "right_index_knuckle": 2.0, "right_index_curl": 4.0,
    "right_arm_raise": 4.0, "right_arm_forward": 62.0, "right_arm_twist": 10.0, "right_elbow": 10.0,
    "right_pronation": 10.0, "right_collar_raise": 6.0, "turn": -8.0, "head_turn": -10.0, "x": 0.01,
}  # fmt: skip
PASSING = (
    Passing(8.95, 0.95, {"tilt": 26, "bend": 14, "head_nod": -22}),  # the trunk goes forward to sit down and get up
    Passing(14.3, 0.75, {"tilt": 30, "bend": 14, "head_nod": -22, **both(arm_forward=10, elbow=10)}),
)


def here(x: float, y: float, z: float) -> Vector:
    """Return a world position from one relative to the wearer between the walks: left, up, forward of the feet."""
    ahead = turned(x, y, z)
    return (ahead[0] + float(_STAND_AT[0]), y, ahead[2] + float(_STAND_AT[1]))


def turned(x: float, y: float, z: float) -> Vector:
    """Return a direction in the world from one relative to the wearer between the walks: left, up, forward."""
    way = np.deg2rad(_STAND_AT[2])
    return (float(x * np.cos(way) + z * np.sin(way)), y, float(z * np.cos(way) - x * np.sin(way)))


def stood(posture: Posture) -> dict[str, float]:
    """A posture whose place is along the world's axes, from one along the wearer's between the walks."""
    x, _, z = turned(posture.get("x", 0.0), 0.0, posture.get("z", 0.0))
    return {**posture, "x": x, "z": z}


def actions() -> list[Action]:
    """The performance, in order."""
    time = frame_times()
    tilt = np.deg2rad(17) * np.sin(2 * np.pi * 1.5 * time)
    up = np.stack([turned(float(-0.1 - np.sin(a)), float(np.cos(a)), 0.25) for a in tilt])
    wave = [
        Meeting(on("right_elbow", -1, 0, 0), Spot("world", up), 0.002, direction=True),
        facing("right", Spot("world", turned(0.1, 0.0, 1.0)), 0.001),
    ]
    sit = [Meeting(on("pelvis", 0, -0.087 - 0.1, 0), Spot("world", here(0, SEAT_HEIGHT, -0.4)))]
    laps = []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        laps += [
            Meeting(palm(side), on(f"{side}_hip", -0.006 * sign, -0.285, 0.081)),
            reach(side, on(f"{side}_hip", -0.15 * sign, -1, 0)),
            facing(side, on(f"{side}_hip", 0, 0, -1)),
        ]
    beat = 0.05 * np.sin(2 * np.pi * 1.1 * time)
    talk = []
    for side, sign, phase in (("left", 1.0, 1.0), ("right", -1.0, 0.6)):
        places = np.array([0.17 * sign, 0.05, 0.36]) + np.stack([0.5 * sign * beat, phase * beat, 0.3 * beat], axis=-1)
        talk += [
            Meeting(on(f"{side}_wrist", 0, 0, 0), Spot("spine1", places), 0.02),
            facing(side, on("spine1", -0.6 * sign, 0.8, 0)),
        ]
    high = [
        Meeting(palm("left"), Spot("world", here(0.22, 1.78, 0.42)), 0.3),
        facing("left", Spot("world", turned(0, -0.3, 1.0))),
    ]
    low = [
        Meeting(palm("right"), Spot("world", here(-0.14, 0.62, 0.52)), 0.3),
        facing("right", Spot("world", turned(0, -1, 0.2))),
    ]
    target = np.array(here(-1.6, 1.7, 3.0)) - np.array(here(-0.17, 1.4, 0.0))
    aim = target / np.linalg.norm(target)
    point = [
        reach("right", Spot("world", aim), 0.002),
        Meeting(on("right_shoulder", -1, 0, 0), Spot("world", aim), 0.0005, direction=True),
        Meeting(on("right_index2", -1, 0, 0), Spot("world", aim), 0.002, direction=True),
    ]
    last = WALKS[1].at(np.array([WALKS[1].end]))[0, 2]
    ahead = STAND["z"]
    away = (float(np.sin(np.deg2rad(last))), -0.02, float(np.cos(np.deg2rad(last))))
    return [
        Action("stands", 0.0, 0.5, STAND, (), (0.0, -0.03, 1.0)),
        Action("walks", 1.6, 2.0, {**STAND, "z": 0.0}, (), (0.1, -0.08, 1.0)),
        Action("turns", 3.4, 3.6, stood({**STAND, "z": 0.0}), (), (1.0, -0.08, 0.15)),
        Action("stops", 5.3, 5.7, stood(STAND), (), turned(0.05, -0.03, 1.0)),
        Action("waves", 6.8, 8.1, stood(WAVE), wave, turned(0.05, 0.0, 1.0)),
        Action("sits", 9.9, 10.9, stood(SIT), [*sit, *laps], turned(0.0, -0.08, 1.0)),
        Action("talks seated", 11.6, 13.1, stood(SIT_TALK), [*sit, *talk], turned(0.2, -0.02, 1.0)),
        Action("gets up", 15.2, 15.3, stood({**STAND, "z": 0.0}), (), turned(0.1, -0.05, 1.0)),
        Action("reaches up", 16.4, 16.8, stood(HIGH), high, turned(0.15, 0.25, 1.0)),
        Action("reaches down", 18.1, 18.5, stood(LOW), low, turned(-0.1, -0.6, 1.0)),
        Action("points", 19.7, 20.1, stood(POINT), point, (float(aim[0]), float(aim[1]) * 0.7, float(aim[2]))),
        Action("walks on", 21.6, 22.4, {**stood(STAND), "x": 0.0, "z": 0.0}, (), away),
        Action("ends", 24.2, SECONDS, {**STAND, "x": ahead * away[0], "z": ahead * away[2]}, (), away),
    ]
