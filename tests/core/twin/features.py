"""Features of the body's network: tracked points and rotations, in the frame under the head and at one stature.

The frame under the head is on the floor below it, and turned as it looks. The features of the mirror image are those of
the same reading reflected at the plane x = 0 of that frame: v → M v, R → M R M, left ↔ right.

All numbers are of single precision, in the core's order: products round features to 16 bits, and a feature that differs
in its last bit may be rounded to the other side.
"""

from dataclasses import dataclass, replace

import numpy as np

from .points import BODY as JOINTS
from .points import BODY_PARTNER, BODY_POINTS, HEAD, HEAD_TOP, HIPS, PARENT, PARTNER, PELVIS, SIDES, WRISTS, at
from .tracked import KNUCKLES, Tracked

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
READ_PARTNER = [*BODY_PARTNER, len(BODY_POINTS) + 1, len(BODY_POINTS)]
LINES = [HIPS, *((at(f"left_{name}"), at(f"right_{name}")) for name in ("shoulder", "ankle"))]
STRAPPED = [at(name) for name in ("pelvis", "spine3")] + [
    at(f"{side}_{name}") for name in ("hip", "knee", "ankle", "shoulder", "elbow") for side in SIDES
]
MIRROR = np.array([-1.0, 1.0, 1.0], np.float32)


@dataclass(frozen=True)
class Head:
    """The frame under the head."""

    origin: np.ndarray  # (3,) m, from base
    turn: np.ndarray  # (3, 3) world ← frame

    def into(self, v: np.ndarray) -> np.ndarray:
        """Vectors (..., 3) of the world in the frame: (c x - s z, y, s x + c z)."""
        c, s = self.turn[0, 0], self.turn[0, 2]
        return np.stack([c * v[..., 0] - s * v[..., 2], v[..., 1], s * v[..., 0] + c * v[..., 2]], axis=-1)


@dataclass(frozen=True)
class Reading:
    """Tracked values in the frame under the head. Absent values are 0."""

    place: np.ndarray  # (27, 3) m at the reference stature: placed points, then the middle of each hand's knuckles
    has_place: np.ndarray  # (27,) bool
    velocity: np.ndarray  # (27, 3) m/s, likewise
    accuracy: np.ndarray  # (27,) log10 of mm
    axes: np.ndarray  # (22, 2, 3) x and y axes of joints
    has_axes: np.ndarray  # (22,) bool
    spin: np.ndarray  # (3, 2, 3) change of the axes of `SPINNING`, 1/s
    bones: np.ndarray  # (25, 3) m: how rest offsets differ from the default body's
    deviation: np.ndarray  # (25,) m
    interval: np.float32  # s
    acceleration: np.ndarray  # (12, 3) m/s² at the reference stature
    has_acceleration: np.ndarray  # (12,) bool


def single(value: float | np.floating) -> np.float32:
    """A number in single precision."""
    return np.float32(value)


def stature(rest_offset: np.ndarray) -> np.float32:
    """How high the head of a skeleton rests above its soles, as a share of the reference's."""
    height, up = {PELVIS: single(0)}, rest_offset[:, 1].astype(np.float32)
    for point in BODY_POINTS[1:].tolist():
        height[point] = height[int(PARENT[point])] + single(float(up[point]))
    return (height[HEAD] - min(height.values())) / single(HEAD_HEIGHT) + single(FLATTEST)


def find_head(seen: Tracked, turn_before: np.ndarray) -> Head:
    """The frame under the head, turned as the head, else the pelvis, else lines from right to left, else as before."""
    cosine, sine = before = (turn_before[0, 0], turn_before[0, 2])
    line = np.zeros(3, np.float32)
    for left, right in LINES:
        if seen.has_position[left] and seen.has_position[right]:
            line = line + (seen.position[left] - seen.position[right])
    if line[0] ** 2 + line[2] ** 2 > SHORTEST_LINE**2:
        cosine, sine = line[0], -line[2]
    for joint in (PELVIS, HEAD):
        if seen.turned(joint):
            r = seen.rotation[joint]
            cosine, sine = r[0, 0] + r[2, 2], r[0, 2] - r[2, 0]
    cosine, sine = cosine + single(LEAST_TURN) * before[0], sine + single(LEAST_TURN) * before[1]
    size = np.sqrt(cosine * cosine + sine * sine)
    c, s = (cosine / size, sine / size) if size > 1e-12 else before
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]], np.float32)
    return Head(np.array([seen.position[HEAD][0], seen.floor, seen.position[HEAD][2]], np.float32), turn)


@dataclass
class Before:
    """Tracked values when the networks' memories last advanced."""

    place: np.ndarray  # (27, 3) m, from base
    has_place: np.ndarray  # (27,) bool
    axes: np.ndarray  # (3, 2, 3) x and y axes of `SPINNING` in the world
    has_axes: np.ndarray  # (3,) bool


READ_ALWAYS = [
    PELVIS,
    HEAD,
    HEAD_TOP,
    *(at(f"{side}_{joint}") for side in SIDES for joint in ("knee", "ankle", "elbow", "wrist")),
]


def follows(seen: Tracked, point: int) -> bool:
    """Whether a point's position follows from its parent's measured pose and tells nothing of other joints."""
    if point in READ_ALWAYS or (point < JOINTS and seen.turned(point)):
        return False
    return bool(seen.has_position[PARENT[point]] and seen.has_rotation[PARENT[point]])


def remember(seen: Tracked) -> Before:
    """Return tracked values to compare with when memories advance next."""
    knuckles = [sum(places, np.zeros(3, np.float32)) * single(0.25) for places in seen.knuckle]
    has = [seen.has_position[point] and not follows(seen, point) for point in BODY_POINTS]
    has += [*seen.has_knuckles]
    axes = seen.rotation[SPINNING].transpose(0, 2, 1)[:, :2]
    turned = [seen.turned(joint) for joint in SPINNING]
    return Before(np.concatenate([seen.position[BODY_POINTS], knuckles]), np.array(has), axes, np.array(turned))


def accuracies(seen: Tracked) -> np.ndarray:
    """Accuracies (27,) in m of what is read; of the middle of knuckles, that of the first of them that is measured."""
    first = [index if seen.has_position[index] else middle for index, middle, *_ in KNUCKLES]
    return seen.accuracy[[*BODY_POINTS, *first]]


def read(seen: Tracked, head: Head, before: Before | None, interval: np.float32, usual_bones: np.ndarray) -> Reading:
    """Return tracked values of one person, `interval` s after memories last advanced."""
    smaller, rate, now = 1 / stature(seen.rest_offset), 1 / interval, remember(seen)
    old = before or replace(now, has_place=np.zeros(27, bool), has_axes=np.zeros(3, bool))
    turned = np.array([seen.turned(joint) for joint in range(JOINTS)])
    both_places, both = (now.has_place & old.has_place)[:, None], (now.has_axes & old.has_axes)[:, None, None]
    axes = head.into(seen.rotation[:JOINTS].transpose(0, 2, 1)[:, :2])
    bones = seen.rest_offset[BODY_POINTS].astype(np.float32) * smaller - usual_bones
    bones[PELVIS] = 0  # the pelvis hangs on nothing
    felt = seen.has_acceleration[STRAPPED]
    return Reading(
        place=head.into(now.place - head.origin) * smaller * now.has_place[:, None],
        has_place=now.has_place,
        velocity=(head.into(now.place - old.place) * (smaller * rate)).clip(-FASTEST, FASTEST) * both_places,
        accuracy=np.log10(1000 * accuracies(seen)) * now.has_place,
        axes=axes * turned[:, None, None],
        has_axes=turned,
        spin=(head.into(now.axes - old.axes) * rate).clip(-SWIFTEST, SWIFTEST) * both,
        bones=bones,
        deviation=seen.deviation[BODY_POINTS].astype(np.float32),
        interval=interval,
        acceleration=(head.into(seen.acceleration[STRAPPED]) * smaller).clip(-STRONGEST, STRONGEST) * felt[:, None],
        has_acceleration=felt,
    )


def mirrored(reading: Reading) -> Reading:
    """The reading of the mirror image."""
    both = MIRROR[:2, None] * MIRROR  # an axis x keeps pointing to the same side of its joint
    joint, strapped = PARTNER[:JOINTS], [STRAPPED.index(PARTNER[point]) for point in STRAPPED]
    return Reading(
        place=reading.place[READ_PARTNER] * MIRROR,
        has_place=reading.has_place[READ_PARTNER],
        velocity=reading.velocity[READ_PARTNER] * MIRROR,
        accuracy=reading.accuracy[READ_PARTNER],
        axes=reading.axes[joint] * both,
        has_axes=reading.has_axes[joint],
        spin=reading.spin[[0, 2, 1]] * both,
        bones=reading.bones[BODY_PARTNER] * MIRROR,
        deviation=reading.deviation[BODY_PARTNER],
        interval=reading.interval,
        acceleration=reading.acceleration[strapped] * MIRROR,
        has_acceleration=reading.has_acceleration[strapped],
    )


def features(reading: Reading) -> np.ndarray:
    """A reading as the network reads it (537,); of axes component by component."""
    parts = [
        reading.place,
        reading.has_place,
        reading.velocity,
        reading.accuracy,
        reading.axes.transpose(0, 2, 1),
        reading.has_axes,
        reading.spin.transpose(0, 2, 1),
        single(BONE_SCALE) * reading.bones,
        single(BONE_SCALE) * reading.deviation,
        single(USUAL_RATE) * reading.interval,
        single(ACCELERATION_SCALE) * reading.acceleration,
        reading.has_acceleration,
    ]
    return np.concatenate([np.ravel(part).astype(np.float32) for part in parts]).clip(-REACH, REACH)
