"""What the body's network reads: what is tracked, in the frame under the head and at one stature.

The frame under the head is on the floor below it, and turned as it looks. The features of the mirror image are those of
the same reading reflected at the plane x = 0 of that frame: v → M v, R → M R M, left ↔ right.
"""

from dataclasses import dataclass, replace

import numpy as np

from .points import HEAD, HIPS, PARTNER, PATH, PELVIS, PLACED, PLACED_PARTNER, SIDES, WRISTS, at
from .points import BODY as JOINTS
from .tracked import Tracked
from .vectors import turn_about_up

HEAD_HEIGHT = 1.5  # m, of the head joint of the reference stature above the soles
FLATTEST = 1e-6  # of that: no body is lower
SHORTEST_LINE = 0.1  # m: a shorter line from right to left gives no heading
LEAST_TURN = 1e-6  # of a head that is upside down, which has no heading of its own
FASTEST = 5.0  # m/s at the reference stature
SWIFTEST = 15.0  # change of axes per second
STRONGEST = 50.0  # m/s² at the reference stature
REACH = 16.0  # no feature is larger
BONE_SCALE, USUAL_RATE, ACCELERATION_SCALE = 20.0, 30.0, 0.1  # 1/m, 1/s, s²/m

SPINNING = [HEAD, *WRISTS]  # of which the change of axes is read
KNUCKLES = [[at(f"{side}_{name}1") for name in ("index", "middle", "ring", "pinky")] for side in SIDES]
READ_POINT = [*PLACED, *(knuckles[0] for knuckles in KNUCKLES)]  # whose accuracy counts
READ_PARTNER = [*PLACED_PARTNER, len(PLACED) + 1, len(PLACED)]
LINES = [HIPS, *((at(f"left_{name}"), at(f"right_{name}")) for name in ("shoulder", "ankle"))]
STRAPPED = [at(name) for name in ("pelvis", "spine3")] + [
    at(f"{side}_{name}") for name in ("hip", "knee", "ankle", "shoulder", "elbow") for side in SIDES
]
MIRROR = np.array([-1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Head:
    """The frame under the head."""

    origin: np.ndarray  # (3,) m, from base
    turn: np.ndarray  # (3, 3) world ← frame


@dataclass(frozen=True)
class Reading:
    """What the features are made of, in the frame under the head. What is absent is 0."""

    place: np.ndarray  # (27, 3) m at the reference stature: placed points, then the middle of each hand's knuckles
    has_place: np.ndarray  # (27,) bool
    velocity: np.ndarray  # (27, 3) m/s, likewise
    accuracy: np.ndarray  # (27,) log10 of mm
    rotation: np.ndarray  # (22, 3, 3) frame ← joint
    has_rotation: np.ndarray  # (22,) bool
    spin: np.ndarray  # (3, 3, 3) change of `SPINNING` per second, frame ← joint
    bones: np.ndarray  # (25, 3) m: how rest offsets differ from the default body's
    deviation: np.ndarray  # (25,) m
    interval: float  # s
    acceleration: np.ndarray  # (12, 3) m/s² at the reference stature
    has_acceleration: np.ndarray  # (12,) bool


def stature(rest_offset: np.ndarray) -> float:
    """How high the head of a skeleton rests above its soles, as a share of the reference's."""
    height = PATH @ rest_offset[:, 1] * (np.arange(len(PATH)) != PELVIS)
    return float(height[HEAD] - min(0.0, height[PLACED].min())) / HEAD_HEIGHT + FLATTEST


def find_head(seen: Tracked, turn_before: np.ndarray) -> Head:
    """The frame under the head, turned as the head, else the pelvis, else lines from right to left, else as before."""
    cosine, sine = before = (turn_before[0, 0], turn_before[0, 2])
    pairs = [(left, right) for left, right in LINES if seen.has_position[left] and seen.has_position[right]]
    line = sum((seen.position[left] - seen.position[right] for left, right in pairs), np.zeros(3))
    if line[0] ** 2 + line[2] ** 2 > SHORTEST_LINE**2:
        cosine, sine = line[0], -line[2]
    for joint in (PELVIS, HEAD):
        if seen.turned(joint):
            r = seen.rotation[joint]
            cosine, sine = r[0, 0] + r[2, 2], r[0, 2] - r[2, 0]
    cosine, sine = cosine + LEAST_TURN * before[0], sine + LEAST_TURN * before[1]
    origin = np.array([seen.position[HEAD][0], seen.floor, seen.position[HEAD][2]])
    return Head(origin, turn_before if np.hypot(cosine, sine) < 1e-12 else turn_about_up(cosine, sine, 0.0))


@dataclass
class Before:
    """What was tracked when the networks' memories last advanced."""

    place: np.ndarray  # (27, 3) m, from base
    has_place: np.ndarray  # (27,) bool
    rotation: np.ndarray  # (3, 3, 3) world ← joint, of `SPINNING`
    has_rotation: np.ndarray  # (3,) bool


def remember(seen: Tracked) -> Before:
    """What to compare with when memories advance next."""
    place = np.concatenate([seen.position[PLACED], [seen.position[knuckles].mean(axis=0) for knuckles in KNUCKLES]])
    has = np.array([*seen.has_position[PLACED], *(seen.has_position[knuckles].all() for knuckles in KNUCKLES)])
    turned = np.array([seen.turned(joint) for joint in SPINNING])
    return Before(place, has, seen.rotation[SPINNING], turned)


def read(seen: Tracked, head: Head, before: Before | None, interval: float, usual_bones: np.ndarray) -> Reading:
    """What is read of one person, `interval` s after memories last advanced."""
    size, into, now = stature(seen.rest_offset), head.turn.T, remember(seen)
    old = before or replace(now, has_place=np.zeros(27, bool), has_rotation=np.zeros(3, bool))
    turned = np.array([seen.turned(joint) for joint in range(JOINTS)])
    both = (now.has_rotation & old.has_rotation)[:, None, None]
    moved = (now.has_place & old.has_place)[:, None]
    bones = seen.rest_offset[PLACED] / size - usual_bones
    bones[PELVIS] = 0  # the pelvis hangs on nothing
    felt = seen.has_acceleration[STRAPPED]
    return Reading(
        place=((now.place - head.origin) @ into.T / size) * now.has_place[:, None],
        has_place=now.has_place,
        velocity=((now.place - old.place) @ into.T / size / interval).clip(-FASTEST, FASTEST) * moved,
        accuracy=np.log10(1000 * seen.accuracy[READ_POINT]) * now.has_place,
        rotation=into @ seen.rotation[:JOINTS] * turned[:, None, None],
        has_rotation=turned,
        spin=(into @ (now.rotation - old.rotation) / interval).clip(-SWIFTEST, SWIFTEST) * both,
        bones=bones,
        deviation=seen.deviation[PLACED],
        interval=interval,
        acceleration=(seen.acceleration[STRAPPED] @ into.T / size).clip(-STRONGEST, STRONGEST) * felt[:, None],
        has_acceleration=felt,
    )


def mirrored(reading: Reading) -> Reading:
    """The reading of the mirror image."""
    both = MIRROR[:, None] * MIRROR
    joint, strapped = PARTNER[:JOINTS], [STRAPPED.index(PARTNER[point]) for point in STRAPPED]
    return Reading(
        place=reading.place[READ_PARTNER] * MIRROR,
        has_place=reading.has_place[READ_PARTNER],
        velocity=reading.velocity[READ_PARTNER] * MIRROR,
        accuracy=reading.accuracy[READ_PARTNER],
        rotation=reading.rotation[joint] * both,
        has_rotation=reading.has_rotation[joint],
        spin=reading.spin[[0, 2, 1]] * both,
        bones=reading.bones[PLACED_PARTNER] * MIRROR,
        deviation=reading.deviation[PLACED_PARTNER],
        interval=reading.interval,
        acceleration=reading.acceleration[strapped] * MIRROR,
        has_acceleration=reading.has_acceleration[strapped],
    )


def features(reading: Reading) -> np.ndarray:
    """A reading as the network reads it (537,); of a rotation the x and y axes."""
    parts = [
        reading.place,
        reading.has_place,
        reading.velocity,
        reading.accuracy,
        reading.rotation[..., :2],
        reading.has_rotation,
        reading.spin[..., :2],
        BONE_SCALE * reading.bones,
        BONE_SCALE * reading.deviation,
        USUAL_RATE * reading.interval,
        ACCELERATION_SCALE * reading.acceleration,
        reading.has_acceleration,
    ]
    return np.concatenate([np.ravel(part).astype(float) for part in parts]).clip(-REACH, REACH)
