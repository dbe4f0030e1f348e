"""Motion of single hands: random key poses in the 26 degrees of freedom, joined by smooth paths.

The wrist follows its own path. Two hands that touch are in `lab.synthesis.pairs`.
"""

from __future__ import annotations

import numpy as np

from bodysense.body.hands.hand import FINGERS, FREEDOMS, limits
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.geometry.rotation import (
    geodesic_angle,
    quaternion_exp,
    quaternion_multiply,
)
from bodysense_lab.synthesis.gestures import KeyPoses, draw_key_poses
from bodysense_lab.synthesis.hand_contact import pose_hand, solve_contacts
from bodysense_lab.synthesis.motion import RATE, HandMotion
from bodysense_lab.synthesis.paths import draw_timing, interpolate_keys, interpolate_rotations

FASTEST_FINGER, FASTEST_TURN = np.radians(500.0), np.radians(300.0)  # rad/s, highest mean speeds of a movement
FASTEST_WRIST = 0.8  # m/s, likewise
DEVIATIONS = 2.5  # largest deviation of a measure of `varied_hand`, in standard deviations
DIGIT = np.array([FINGERS.index(row.joint[:-1]) for row in FREEDOMS])  # (26,) finger of each angle
_KEYS_PER_SECOND = 1.7  # enough in nearly all cases; after its last key a hand holds still
_FINGER_DRIFT, _WRIST_DRIFT = np.radians(1.0), 0.002  # rad, of fingers that touch nothing; m, of the wrist
_WORK_CENTER = np.array([0.22, 1.10, 0.32])  # m, mean position of the wrist in front of the body
_WORK_SPREAD = np.array([0.14, 0.18, 0.12])  # m, its standard deviation
_FORWARD = np.array([np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0])  # fingers forward, palm down, on a body that faces +z


def synthesize_hand(hand: Skeleton, seconds: float, rng: np.random.Generator, rate: float = RATE) -> HandMotion:
    """Return motion of a left hand (`body.hand.hand_skeleton`) that gestures, pinches, counts, rests and travels.

    Angles keep to the limits of `body.hand.FREEDOMS`; held pinches touch. Raises BodysenseError if `seconds` at `rate`
    Hz give no frame.
    """
    time = frame_times(seconds, rate)
    keys = draw_key_poses(key_count(seconds), rng)
    fingers = move_fingers(time, hand, keys, rng)
    root, turn = wrist_path(time, key_count(seconds), rng)
    return HandMotion("synthesised", pose_hand(hand, root, turn, fingers), rate, "synthesised", "left")


def varied_hand(hand: Skeleton, spread: float, rng: np.random.Generator) -> Skeleton:
    """Return a hand of random size and proportions; `spread` 0.05 is about that of adults.

    The size, the palm's breadth, every finger and every bone are scaled by log-normal factors. The size has a standard
    deviation of `spread`, the others of half of it. Rest directions change in the palm only. Raises BodysenseError for
    a spread outside 0 to 0.3.
    """
    if not 0 <= spread <= 0.3:
        raise BodysenseError(f"a spread of {spread:g} of hand sizes is not possible; give 0 to 0.3, such as 0.05")

    def factors(count: int) -> np.ndarray:
        return np.exp(spread / 2 * np.clip(rng.standard_normal(count), -DEVIATIONS, DEVIATIONS))

    size, breadth = factors(1)[0] ** 2, factors(1)[0]
    finger: dict[str, float] = dict(zip(FINGERS, factors(len(FINGERS)), strict=True))
    scale = size * np.repeat(factors(len(hand.points))[:, None], 3, axis=1)
    for point, name in enumerate(hand.points):
        if name.endswith("1"):  # the palm ends at the knuckles
            scale[point, 2] *= breadth
        elif name != "wrist":
            scale[point] *= finger[name.removesuffix("_tip").rstrip("23")]
    return hand.with_offsets(hand.rest_offset * scale)


def move_fingers(time: np.ndarray, hand: Skeleton, keys: KeyPoses, rng: np.random.Generator) -> np.ndarray:
    """Return angles (T, 26) rad at `time` (T,) s of fingers that pass through key poses, holding the touches."""
    angles, held = solve_contacts(hand, keys), keys.finger >= 0
    least = np.abs(np.diff(angles, axis=0)).max(axis=1) / FASTEST_FINGER
    timing = draw_timing(least, held, digit_lags(keys, rng), rng)
    part = np.append(DIGIT, 0)
    values = interpolate_keys(time, timing, np.column_stack([angles, ~held]), part)
    return np.clip(values[:, :-1] + _FINGER_DRIFT * values[:, -1:] * drift(time, len(FREEDOMS), rng), *limits())


def digit_lags(keys: KeyPoses, rng: np.random.Generator) -> np.ndarray:
    """Return the delays (K − 1, 5) of thumb and fingers behind the first of them, in shares of each movement."""
    count = len(keys.finger) - 1
    one_by_one = rng.uniform(-0.35, 0.35, (count, 1)) * np.linspace(-0.5, 0.5, 5)
    lag = one_by_one - one_by_one.min(axis=1, keepdims=True) + rng.uniform(0, 0.08, (count, 5))
    # A thumb on the back of folded fingers arrives after them and leaves before them.
    on_back = (keys.finger >= 0) & (keys.place == 1)
    lag[on_back[1:], 0] = 0.5
    lag[on_back[:-1]] = np.array([0.0, 0.4, 0.4, 0.4, 0.4])
    return lag


def drift(time: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """Return slow random waves (T, count) around 0, with a standard deviation of about 1."""
    rate, phase = rng.uniform(0.2, 1.2, (3, count)), rng.uniform(0, 2 * np.pi, (3, count))
    waves = [np.sin(2 * np.pi * time[:, None] * f + p) for f, p in zip(rate, phase, strict=True)]
    return np.sum(waves, axis=0) * np.sqrt(2 / 3)


def frame_times(seconds: float, rate: float) -> np.ndarray:
    """Return the times (T,) of frames in s, from 0. Raises BodysenseError if there is no frame."""
    if not (np.isfinite([seconds, rate]).all() and rate > 0 and seconds * rate >= 1):
        raise BodysenseError(f"{seconds:g} s at {rate:g} Hz have no frame; give more than 0 of both, such as 10 and 60")
    return np.arange(round(seconds * rate)) / rate


def key_count(seconds: float) -> int:
    """Return the number of key poses that last about `seconds`."""
    return int(np.ceil(_KEYS_PER_SECOND * seconds)) + 4


def wrist_path(time: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (T, 3) m and rotations (T, 4) of a wrist on a path of `count` keys, with far and small moves."""
    far = rng.random(count) < 0.45
    far[0] = True
    since = np.maximum.accumulate(np.where(far, np.arange(count), 0))
    place = (_WORK_CENTER + _WORK_SPREAD * rng.standard_normal((count, 3)))[since]
    place += np.where(far, 0.0, 0.03)[:, None] * rng.standard_normal((count, 3))
    heading = quaternion_exp(np.array([0.0, 1.0, 0.0]) * rng.normal(0.3, 0.5, (count, 1)))
    bending = np.array([0.0, 0.0, 1.0]) * rng.normal(0.25, 0.6, (count, 1))
    rolling = np.array([1.0, 0.0, 0.0]) * rng.normal(-0.5, 0.9, (count, 1))
    turn = quaternion_multiply(quaternion_multiply(heading, _FORWARD), quaternion_exp(bending))
    turn = quaternion_multiply(turn, quaternion_exp(rolling))[since]
    nudge = np.where(far, 0.0, 0.2)[:, None] * rng.standard_normal((count, 3))
    turn = quaternion_multiply(turn, quaternion_exp(nudge))
    least = np.linalg.norm(np.diff(place, axis=0), axis=1) / FASTEST_WRIST
    least = np.maximum(least, geodesic_angle(turn[:-1], turn[1:]) / FASTEST_TURN)
    timing = draw_timing(least, np.zeros(count, dtype=bool), np.zeros((count - 1, 1)), rng)
    values = interpolate_keys(time, timing, place, np.zeros(3, dtype=int)) + _WRIST_DRIFT * drift(time, 3, rng)
    return values, interpolate_rotations(time, timing, turn)
