"""What the performer does and when: postures, contacts, steps, glances.

World: +Y up, metres; the performer starts at the origin and faces +Z. Angles in degrees.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .figure import FINGERS
from .spacetime import Spot

FRAME_RATE = 30.0
SECONDS = 28.8
SEAT = 0.45  # m, height of the virtual seat
Posture = Mapping[str, float]
Vector = tuple[float, float, float]


def frame_times() -> np.ndarray:
    """(T,) s, of the frames."""
    return np.arange(round(SECONDS * FRAME_RATE)) / FRAME_RATE


@dataclass(frozen=True, eq=False)
class Meeting:
    """A contact of an action: a point of the body on another, or a direction along another."""

    a: Spot
    b: Spot
    share: float = 1.0  # of the full weight
    direction: bool = False


@dataclass(frozen=True, eq=False)
class Action:
    """Something held for a while."""

    name: str
    start: float  # s: reached
    end: float  # s: left
    posture: Posture
    meetings: Sequence[Meeting] = field(default=())
    gaze: Vector = (0.0, 0.0, 1.0)  # direction of the face


@dataclass(frozen=True)
class Footfall:
    """A foot that stands."""

    side: str
    start: float  # s: the sole comes down
    end: float  # s: the heel goes up
    x: float  # m, place of the ankle
    z: float
    heading: float  # degrees, of the foot


@dataclass(frozen=True, eq=False)
class Passing:
    """Something added on the way, most at `time`, gone `ramp` seconds before and after."""

    time: float
    ramp: float
    posture: Posture


def both(**posture: float) -> dict[str, float]:
    """The same angles on both sides."""
    return {f"{side}_{name}": value for side in ("left", "right") for name, value in posture.items()}


def hand(side: str, knuckle: float, curl: float, fan: float = 0.0, **posture: float) -> dict[str, float]:
    """A hand's fingers, curled alike but for a `fan` of degrees more from finger to finger toward the little one."""
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
STAND: Posture = {**HANG, **relaxed("left"), **relaxed("right"), "y": 0.985, "z": -0.02, "bend": 2.0}


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


def reaching(side: str, to: Spot, share: float = 0.0005) -> Meeting:
    """The hand runs along a direction."""
    return Meeting(on(f"{side}_wrist", 1 if side == "left" else -1, 0, 0), to, share, direction=True)


CROSS = {
    **STAND,
    **both(arm_raise=-68, arm_forward=30, arm_twist=62, elbow=112, collar_forward=8, wrist_flex=8),
    **hand("right", 22, 22, 2, thumb_close=0, thumb_curl=10),
    **hand("left", 12, 16, 2, thumb_close=0, thumb_curl=10),
    "bend": 1.0, "roll": 2.0, "x": 0.015, "left_pronation": 30.0, "right_pronation": 40.0,
}  # fmt: skip
CHIN = {
    **STAND,
    **hand("left", 72, 88, 3, thumb_close=30, thumb_down=12, thumb_curl=42),
    **hand("right", 18, 24, 3, thumb_close=0, thumb_curl=10),
    "left_arm_raise": -70.0, "left_arm_forward": 45.0, "left_arm_twist": 20.0, "left_elbow": 135.0,
    "left_pronation": -20.0,
    "right_arm_raise": -70.0, "right_arm_forward": 30.0, "right_arm_twist": 62.0, "right_elbow": 88.0,
    "right_pronation": -50.0,
    "head_nod": 8.0, "head_turn": 6.0, "head_side": -4.0, "x": 0.02, "bend": 4.0,
}  # fmt: skip
CLASP = {
    **STAND,
    **both(arm_raise=-70, arm_forward=26, arm_twist=42, elbow=82, pronation=0, wrist_flex=5),
    **hand("right", 62, 50, 0, thumb_close=15, thumb_down=10, thumb_curl=25),
    **hand("left", 62, 50, 0, thumb_close=15, thumb_down=10, thumb_curl=25),
    "x": 0.01, "head_nod": 3.0,
}  # fmt: skip
SCRATCH = {
    **STAND,
    **hand("right", 35, 45, 2, thumb_close=-5, thumb_down=10, thumb_curl=15),
    "right_arm_raise": 10.0, "right_arm_forward": 55.0, "right_arm_twist": -62.0, "right_elbow": 128.0,
    "right_pronation": 10.0, "right_collar_raise": 16.0, "head_side": 6.0, "head_turn": 10.0, "x": 0.015, "side": -3.0,
}  # fmt: skip
HIPS = {
    **STAND,
    **both(arm_raise=-52, arm_forward=-14, arm_twist=48, elbow=92, pronation=20, wrist_flex=-20),
    **hand("right", 30, 22, 2, thumb_close=-25, thumb_down=15, thumb_curl=5),
    **hand("left", 30, 22, 2, thumb_close=-25, thumb_down=15, thumb_curl=5),
    "bend": -3.0, "left_hip_out": 4.0, "right_hip_out": 4.0, "x": -0.015,
}  # fmt: skip
TARGET = np.array([-2.6, 2.1, 3.4])  # m: what is pointed at, ahead to the right
POINT = {
    **STAND,
    **hand("right", 75, 88, 3, thumb_close=30, thumb_down=10, thumb_curl=42),
    "right_index_knuckle": 2.0, "right_index_curl": 4.0,
    "right_arm_raise": 14.0, "right_arm_forward": 52.0, "right_arm_twist": 10.0, "right_elbow": 8.0,
    "right_pronation": 10.0, "right_collar_raise": 6.0, "turn": -12.0, "heading": -8.0, "head_turn": -12.0, "x": 0.01,
}  # fmt: skip
SIT = {
    **STAND,
    **both(hip_flex=82, knee=84, ankle=2, hip_out=6),
    **both(arm_raise=-72, arm_forward=28, arm_twist=18, elbow=58, pronation=42, wrist_flex=8),
    "y": 0.632, "z": -0.40, "tilt": -6.0, "bend": 8.0,
}  # fmt: skip
OPEN = both(**{f"{finger}_{part}": -28 for finger in FINGERS for part in ("knuckle", "curl")}, arm_twist=-12)
PASSING = (
    Passing(
        7.6,
        0.45,
        {"left_arm_forward": 12, "left_elbow": 6, "right_elbow": -12, "right_arm_twist": -15, "right_wrist_flex": 12},
    ),
    Passing(7.9, 0.4, OPEN),  # the fingers open before they interlace, and to let go
    Passing(10.1, 0.4, OPEN),
    Passing(18.85, 0.95, {"tilt": 26, "bend": 14, "head_nod": -22}),  # the trunk goes forward to sit down and get up
    Passing(21.85, 0.75, {"tilt": 30, "bend": 14, "head_nod": -22, **both(arm_forward=10, elbow=10)}),
)
END = {**STAND, "heading": 70.0}


def actions() -> list[Action]:
    """The performance, in order."""
    chin = on("head", 0.0, -0.072, 0.084)
    cross = [
        Meeting(pad("right", "middle"), on("left_shoulder", 0.185, 0.034, -0.024)),
        Meeting(pad("right", "ring"), on("left_shoulder", 0.207, 0.034, -0.022), 0.3),
        Meeting(pad("right", "index"), on("left_shoulder", 0.163, 0.034, -0.022), 0.3),
        Meeting(palm("left"), on("spine3", -0.06, -0.05, 0.168), 0.5),
        facing("right", on("spine3", 0.0, -0.2, -1)),
        reaching("right", on("spine3", 0.95, 0.2, -0.1)),
        facing("left", on("spine3", 0.0, -0.1, -1)),
        reaching("left", on("spine3", -0.95, 0.2, -0.15)),
        Meeting(on("right_elbow", -0.15, 0, 0), on("spine2", 0.0, 0.06, 0.24), 0.02),
        Meeting(on("left_elbow", 0.15, 0, 0), on("spine2", 0.0, 0.02, 0.20), 0.02),
    ]
    think = [
        Meeting(on("left_index2", 0.012, 0.011, 0.0), chin),
        Meeting(palm("right"), on("left_elbow", 0.01, 0.0, -0.040)),
        facing("left", on("spine3", -0.5, -0.1, -0.8)),
    ]
    clasp = []
    for side, other, between in (
        ("left", "right", (0.014, -0.009, -0.029, -0.047)),
        ("right", "left", (0.037, 0.014, -0.009, -0.029)),
    ):
        sign = 1.0 if other == "left" else -1.0
        clasp += [
            Meeting(pad(side, f), on(f"{other}_wrist", 0.083 * sign, 0.013, z))
            for f, z in zip(FINGERS, between, strict=True)
        ]
    clasp += [
        Meeting(palm("left"), palm("right"), 0.05),
        Meeting(on("left_wrist", 0.06, 0, 0), Spot("spine1", (0.0, 0.02, 0.34)), 0.05),
        Meeting(on("left_wrist", 0, 0, 1), Spot("spine1", (0, 0.8, 0.6)), 0.0005, direction=True),
    ]
    scalp = on("head", -0.068, 0.105, -0.020)
    rub = frame_times() * 2 * np.pi * 2.4
    moving = Spot("head", np.asarray(scalp.offset) + 0.011 * np.sin(rub)[:, None] * np.array([0.35, 0.25, 0.9]))
    scratch = []
    for finger, dz, share in (("middle", 0.0, 1.0), ("index", 0.024, 0.3), ("ring", -0.022, 0.3)):
        shifted = Spot("head", np.asarray(moving.offset) + np.array([0.08 * abs(dz), -0.15 * abs(dz), dz]))
        scratch.append(Meeting(on(f"right_{finger}3", -0.022, -0.005, 0.0), shifted, share))
    hips = []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        hips += [
            Meeting(palm(side), on("pelvis", 0.142 * sign, 0.045, 0.035), 0.5),
            facing(side, on("pelvis", -0.95 * sign, -0.1, -0.25)),
            reaching(side, on("pelvis", -0.2 * sign, -0.6, 0.75)),
        ]
    aim = TARGET - np.array([-0.16, 1.42, 0.0])
    aim /= np.linalg.norm(aim)
    point = [
        reaching("right", Spot("world", aim), 0.002),
        Meeting(on("right_shoulder", -1, 0, 0), Spot("world", aim), 0.0005, direction=True),
        Meeting(on("right_index2", -1, 0, 0), Spot("world", aim), 0.002, direction=True),
    ]
    sit = [Meeting(on("pelvis", 0, -0.087 - 0.1, 0), Spot("world", (0, SEAT, -0.4)))]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        sit += [
            Meeting(palm(side), on(f"{side}_hip", -0.006 * sign, -0.285, 0.081)),
            reaching(side, on(f"{side}_hip", -0.15 * sign, -1, 0)),
            facing(side, on(f"{side}_hip", 0, 0, -1)),
        ]
    look = tuple(aim * [1, 0.75, 1])
    return [
        Action("stands", 0.0, 1.1, STAND),
        Action("crosses the arms", 2.3, 4.1, CROSS, cross, (0.1, -0.03, 1.0)),
        Action("chin on hand", 5.3, 7.1, CHIN, think, (0.12, -0.16, 1.0)),
        Action("clasps the hands", 8.2, 9.8, CLASP, clasp, (0.0, -0.08, 1.0)),
        Action("scratches the head", 11.1, 12.8, SCRATCH, scratch, (0.25, 0.0, 1.0)),
        Action("hands on hips", 14.1, 15.5, HIPS, hips, (-0.05, 0.02, 1.0)),
        Action("points", 16.8, 18.2, POINT, point, look),
        Action("sits", 19.9, 21.4, SIT, sit, (0.0, -0.05, 1.0)),
        Action("gets up", 22.8, 22.9, {**STAND, "z": 0.0}, (), (0.1, -0.05, 1.0)),
        Action("ends", 26.8, SECONDS, END, (), (0.94, 0.0, 0.34)),
    ]


STEPS = (
    Footfall("left", -1.0, 23.65, 0.105, 0.0, 8),
    Footfall("right", -1.0, 22.95, -0.105, 0.0, -8),
    Footfall("right", 23.6, 24.35, -0.09, 0.49, 4),
    Footfall("left", 24.3, 25.05, 0.205, 0.92, 24),
    Footfall("right", 25.0, 25.75, 0.356, 1.344, 44),
    Footfall("left", 25.7, SECONDS + 1, 0.838, 1.398, 78),
    Footfall("right", 26.35, SECONDS + 1, 0.77, 1.586, 62),
)
PATH = (  # s, then the pelvis: m, m, degrees of heading
    (22.9, 0.0, 0.0, 0.0),
    (23.6, -0.01, 0.22, 4.0),
    (24.3, 0.05, 0.70, 15.0),
    (25.0, 0.25, 1.12, 35.0),
    (25.7, 0.58, 1.39, 57.0),
    (26.35, 0.785, 1.487, 69.0),
    (26.8, 0.804, 1.492, 70.0),
)
