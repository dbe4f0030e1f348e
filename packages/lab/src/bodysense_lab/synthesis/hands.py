"""Hands that move by themselves: random key poses in the 26 degrees of freedom, joined by smooth paths.

The wrist travels on a path of its own. Two hands that act on each other are in `lab.synthesis.pairs`.

The motion of hands, cut from recordings of whole bodies: every hand as a left hand (`body.hand`).

Key poses that flesh allows: fingers end at the palm, the thumb goes round them and touches what it is to touch.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.hand import FINGERS, FREEDOMS, HAND_JOINTS, Side, hand_pose, joint_bases, limits, rotations_of
from bodysense.body.hand_capsules import (
    GIVE,
    PALM,
    HandCapsules,
    axes_between,
    hand_capsules,
    nearest_points,
    own_depth,
    own_pairs,
)
from bodysense.body.pose import Pose, forward_kinematics
from bodysense.body.rotation import (
    geodesic_angle,
    normalize,
    quaternion_canonical,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.body.skeleton import Skeleton
from bodysense.errors import BodysenseError
from bodysense.io.clip import Clip
from bodysense.io.resample import resample
from bodysense_lab.synthesis.gestures import KeyPoses, along, along_rotations, draw_key_poses, draw_timing

PRESSED = GIVE / 2  # of the radii: so deep the flesh of two that touch is pressed in
# How readily angles give way: the thumb's six, then the finger's five, in the order of FREEDOMS.
_SOFTNESS = np.radians([18.0, 18.0, 15.0, 18.0, 3.0, 22.0, 14.0, 5.0, 3.0, 14.0, 12.0])
_FOLDED = 0.3  # of their readiness is left to folded fingers
_SETTLING, _CLOSING = 5, 6  # steps toward the pose that is asked for, then steps that touch and part alone
_FACING, _GAP, _INSIDE = 0.006, 0.0002, 0.002  # m: how far pads may miss each other, gaps may be wide, flesh overlap
_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
_STEP = 1e-5  # rad, of the numerical derivative
_PALMAR = np.array([0.0, -1.0, 0.0])  # where a finger's flesh touches, in its joint's own axes
_PLACES = np.array([_PALMAR, -_PALMAR, [0.0, 0.0, 1.0]])  # of a finger: tip, back, the thumb's side
_CURLS = np.linspace(1.0, 0.55, 10)  # shares of their flexion that are tried where fingers reach into the palm


def settled(hand: Skeleton, keys: KeyPoses) -> np.ndarray:
    """Angles (K, 26), radians, near those of the key poses, with the touches made and nothing deep in something else.

    Where the thumb touches a finger their capsules meet to within 0.1 mm, pressed in by `PRESSED`, unless the limits
    forbid it. Possible poses without contact are unchanged.
    """
    angles = _out_of_the_palm(hand, keys.angles)
    depth = own_depth(posed(hand, np.zeros(3), _UNTURNED, angles))[:, own_pairs()[0] < 3]
    which = np.flatnonzero((keys.finger >= 0) | (depth.max(axis=1) > _INSIDE / 4))
    if len(which):
        angles[which] = _thumbs_settled(hand, angles[which], keys.finger[which], keys.place[which])
    return angles


def posed(hand: Skeleton, root: np.ndarray, turn: np.ndarray, angles: np.ndarray) -> Pose:
    """A hand's pose: wrist at `root` (..., 3) m and turned by `turn` (..., 4), fingers by `angles` (..., 26) rad."""
    rotation = np.empty((*angles.shape[:-1], len(HAND_JOINTS), 4))
    rotation[..., 0, :], rotation[..., 1:, :] = quaternion_canonical(turn), rotations_of(angles)
    return Pose(hand, np.broadcast_to(root, (*angles.shape[:-1], 3)), rotation)


def _out_of_the_palm(hand: Skeleton, angles: np.ndarray) -> np.ndarray:
    """Angles (K, 26) with fingers flexed only so far that they do not reach into the palm."""
    names = np.array(hand_capsules(hand).names)
    first, second = (names[places] for places in own_pairs())
    flexions = np.array([row.angle == "flexion" and not row.joint.startswith("thumb") for row in FREEDOMS])
    trial = np.where(flexions, angles * _CURLS[:, None, None], angles)
    depth = own_depth(posed(hand, np.zeros(3), _UNTURNED, trial))
    angles = angles.copy()
    for finger in FINGERS[1:]:
        pairs = [name.startswith(finger) and other in PALM for name, other in zip(first, second, strict=True)]
        free = (depth[..., pairs] <= 0).all(axis=-1)
        best = np.where(free.any(axis=0), np.argmax(free, axis=0), len(_CURLS) - 1)
        own = [row.joint.startswith(finger) for row in FREEDOMS]
        angles[:, own] = trial[best, np.arange(len(angles))][:, own]
    return angles


def _thumbs_settled(hand: Skeleton, angles: np.ndarray, finger: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Damped least squares (Levenberg, 1944) over the angles of the thumb and of the finger that it touches."""
    capsules, count, touches = hand_capsules(hand), len(angles), (finger >= 0)[:, None]
    finger = np.maximum(finger, 0)
    columns = np.concatenate([np.tile(np.arange(6), (count, 1)), 6 + 5 * finger[:, None] + np.arange(5)], axis=1)
    low, high = (np.take_along_axis(bound[None], columns, axis=1) for bound in limits())
    start = np.take_along_axis(angles, columns, axis=1)
    nudges = np.concatenate([np.zeros((1, 11)), _STEP * np.eye(11)])[:, None]
    # A fingertip comes to meet the thumb; folded fingers lie still.
    softness = np.where((place[:, None] > 0) & (np.arange(11) >= 6), _FOLDED, 1.0) * _SOFTNESS
    for step in range(_SETTLING + _CLOSING):
        settling = step < _SETTLING
        here = np.take_along_axis(angles, columns, axis=1)
        trial = np.repeat(angles[None], len(nudges), axis=0)
        np.put_along_axis(trial, np.broadcast_to(columns, (len(nudges), count, 11)), here + nudges, axis=2)
        found = _measure(capsules, hand, trial, finger, place)
        gap = touches * found.gap[..., None] / (_GAP * (5 if settling else 1))
        miss = touches * found.miss / _FACING * settling
        residual = np.concatenate([gap, miss, np.maximum(found.depth, 0) / _INSIDE], axis=-1)
        # In units of softness, drawn to the pose that was asked for; later the least change that will do.
        slope = np.moveaxis(residual[1:] - residual[0], 0, -1) / _STEP * softness[:, None]  # (K, R, 11)
        weight = 1.0 if settling else 1e-3
        normal = slope.swapaxes(1, 2) @ slope + weight * np.eye(11)
        pull = weight * settling * (start - here) / softness - np.einsum("krc,kr->kc", slope, residual[0])
        change = np.linalg.solve(normal, pull[..., None])[..., 0]
        change *= np.minimum(1.0, 1.0 / np.maximum(np.abs(change).max(axis=1, keepdims=True), 1e-9))
        angles = angles.copy()
        np.put_along_axis(angles, columns, np.clip(here + change * softness, low, high), axis=1)
    return angles


@dataclass(frozen=True, eq=False)
class _Touch:
    """How a thumb stands to a finger, and to all of the hand."""

    gap: np.ndarray  # (..., K) m
    miss: np.ndarray  # (..., K, 3) m from the finger's pad to the thumb's
    depth: np.ndarray  # (..., K, M) m, of the pairs of capsules that the thumb is of


def _measure(
    capsules: HandCapsules, hand: Skeleton, angles: np.ndarray, finger: np.ndarray, place: np.ndarray
) -> _Touch:
    """Return the contacts of angles (..., K, 26)."""
    position, world = forward_kinematics(posed(hand, np.zeros(3), _UNTURNED, angles))
    begin, bone = axes_between(position, capsules.share)
    bases = np.array([(1.0, 0.0, 0.0, 0.0), *joint_bases()])
    thumb = capsules.names.index("thumb3")
    segment = np.array([[capsules.names.index(f"{name}{k}") for k in (3, 2, 2)] for name in FINGERS[1:]])
    segment, each = segment[finger, place], np.arange(len(finger))

    def outward(joint: np.ndarray, own: np.ndarray) -> np.ndarray:
        return quaternion_rotate(world[..., each, joint, :], quaternion_rotate(bases[joint], normalize(own)))

    tilted = np.array([0.5, 0.0, 0.0])  # pads face a little toward the tip
    own = np.broadcast_to(_PALMAR + tilted, (len(finger), 3))
    center = begin[..., thumb, :] + bone[..., thumb, :]
    pad = center + capsules.radius[thumb] * outward(np.full(len(finger), capsules.joint[thumb]), own)
    share = np.where(place == 0, 1.0, 0.6)[:, None]
    other = begin[..., each, segment, :] + share * bone[..., each, segment, :]
    other_own = _PLACES[place] + tilted * (place == 0)[:, None]
    other_pad = other + capsules.radius[segment][:, None] * outward(capsules.joint[segment], other_own)
    reach = (1 - PRESSED) * (capsules.radius[thumb] + capsules.radius[segment])
    return _Touch(np.linalg.norm(center - other, axis=-1) - reach, pad - other_pad, _thumb_depth(capsules, begin, bone))


def _thumb_depth(capsules: HandCapsules, begin: np.ndarray, bone: np.ndarray) -> np.ndarray:
    """How deep (..., M) m the thumb's capsules stand in others, from where all begin (..., C, 3) and their bones."""
    first, second = (places[own_pairs()[0] < 3] for places in own_pairs())
    one, other = nearest_points(begin[..., first, :], bone[..., first, :], begin[..., second, :], bone[..., second, :])
    return (1 - GIVE) * (capsules.radius[first] + capsules.radius[second]) - np.linalg.norm(one - other, axis=-1)


RATE = 60.0  # Hz, the rate of the paper's recordings (two-hands, section 6.1.1)


@dataclass(frozen=True, eq=False)
class HandMotion:
    """One hand over time."""

    name: str  # of the recording
    pose: Pose  # (T, …) of a left hand; a right one is mirrored at the plane x = 0 of the world, root and all
    frame_rate: float  # Hz
    category: str  # what the person does, where known
    side: Side  # which hand it is

    def __len__(self) -> int:
        return int(self.pose.root_position.shape[0])

    @property
    def seconds(self) -> float:
        """Length of the motion."""
        return len(self) / self.frame_rate


def hand_pairs(clips: Iterable[Clip], rate: float = RATE) -> Iterator[tuple[HandMotion, HandMotion]]:
    """Left and right hand of every clip whose fingers were recorded, at `rate` Hz, bones as long as the clip's.

    Raises BodysenseError for a skeleton without fingers.
    """
    for clip in clips:
        if clip.has_fingers:
            body = resample(clip, rate)
            left = HandMotion(clip.name, hand_pose(body.pose, "left"), body.frame_rate, clip.category, "left")
            yield left, replace(left, pose=hand_pose(body.pose, "right"), side="right")


def hand_motions(clips: Iterable[Clip]) -> Iterator[HandMotion]:
    """The hands of `hand_pairs`, one after the other."""
    for pair in hand_pairs(clips):
        yield from pair


FASTEST_FINGER, FASTEST_TURN = np.radians(500.0), np.radians(300.0)  # rad/s, means of a movement
FASTEST_WRIST = 0.8  # m/s, likewise
DEVIATIONS = 2.5  # standard deviations that a measure of `varied_hand` may differ by
DIGIT = np.array([FINGERS.index(row.joint[:-1]) for row in FREEDOMS])  # (26,) whose angle it is
_KEYS_A_SECOND = 1.7  # more than are needed, but for a hand that then holds its last pose
_UNREST, _SWAY = np.radians(1.0), 0.002  # rad, m: of fingers that touch nothing, and of the wrist
_BEFORE, _ABOUT = np.array([0.22, 1.10, 0.32]), np.array([0.14, 0.18, 0.12])  # m: where hands are before a body
_AHEAD = np.array([np.sqrt(0.5), 0.0, -np.sqrt(0.5), 0.0])  # fingers ahead, palm down, of a body that faces +z


def synthesize_hand(hand: Skeleton, seconds: float, rng: np.random.Generator, rate: float = RATE) -> HandMotion:
    """A hand (a left one, `body.hand.hand_skeleton`) that gestures, pinches, counts, rests and travels.

    Angles keep to the limits of `body.hand.FREEDOMS`; held pinches touch. Raises BodysenseError where `seconds` and
    `rate` make no frame.
    """
    time = frame_times(seconds, rate)
    keys = draw_key_poses(key_count(seconds), rng)
    fingers = move_fingers(time, hand, keys, rng)
    root, turn = wander(time, key_count(seconds), rng)
    return HandMotion("synthesised", posed(hand, root, turn, fingers), rate, "synthesised", "left")


def varied_hand(hand: Skeleton, spread: float, rng: np.random.Generator) -> Skeleton:
    """A hand of another size and other proportions; `spread` 0.05 is about that of adults.

    The size, the palm's breadth, every finger and every bone are scaled by log-normal factors, the size with a standard
    deviation of `spread`, the others of half as much. Directions at rest change in the palm alone.
    """
    if not 0 <= spread <= 0.3:
        raise BodysenseError(f"a spread of {spread:g} of hands' sizes cannot be; give 0 to 0.3, such as 0.05")

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
    """Angles (T, 26) rad at `time` (T,) s of fingers that pass through key poses; touches of the thumb are held."""
    angles, held = settled(hand, keys), keys.finger >= 0
    least = np.abs(np.diff(angles, axis=0)).max(axis=1) / FASTEST_FINGER
    timing = draw_timing(least, held, digit_lags(keys, rng), rng)
    part = np.append(DIGIT, 0)
    moved = along(time, timing, np.column_stack([angles, ~held]), part)
    return np.clip(moved[:, :-1] + _UNREST * moved[:, -1:] * drift(time, len(FREEDOMS), rng), *limits())


def digit_lags(keys: KeyPoses, rng: np.random.Generator) -> np.ndarray:
    """(K − 1, 5) by which share of a movement thumb and fingers set out later than the first of them."""
    count = len(keys.finger) - 1
    one_by_one = rng.uniform(-0.35, 0.35, (count, 1)) * np.linspace(-0.5, 0.5, 5)
    lag = one_by_one - one_by_one.min(axis=1, keepdims=True) + rng.uniform(0, 0.08, (count, 5))
    # A thumb on the back of folded fingers comes after them and leaves before them.
    on_back = (keys.finger >= 0) & (keys.place == 1)
    lag[on_back[1:], 0] = 0.5
    lag[on_back[:-1]] = np.array([0.0, 0.4, 0.4, 0.4, 0.4])
    return lag


def drift(time: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(T, count) slow random waves about 0, with a standard deviation of about 1."""
    rate, phase = rng.uniform(0.2, 1.2, (3, count)), rng.uniform(0, 2 * np.pi, (3, count))
    waves = [np.sin(2 * np.pi * time[:, None] * f + p) for f, p in zip(rate, phase, strict=True)]
    return np.sum(waves, axis=0) * np.sqrt(2 / 3)


def frame_times(seconds: float, rate: float) -> np.ndarray:
    """(T,) s, from 0. Raises BodysenseError where there is no frame."""
    if not (np.isfinite([seconds, rate]).all() and rate > 0 and seconds * rate >= 1):
        raise BodysenseError(f"{seconds:g} s at {rate:g} Hz make no frame; give more than 0 of both, such as 10 and 60")
    return np.arange(round(seconds * rate)) / rate


def key_count(seconds: float) -> int:
    """How many key poses last about so long."""
    return int(np.ceil(_KEYS_A_SECOND * seconds)) + 4


def wander(time: np.ndarray, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Where the wrist is (T, 3) m and how it is turned (T, 4) on a path of `count` keys: far moves and small ones."""
    far = rng.random(count) < 0.45
    far[0] = True
    since = np.maximum.accumulate(np.where(far, np.arange(count), 0))
    place = (_BEFORE + _ABOUT * rng.standard_normal((count, 3)))[since]
    place += np.where(far, 0.0, 0.03)[:, None] * rng.standard_normal((count, 3))
    heading = quaternion_exp(np.array([0.0, 1.0, 0.0]) * rng.normal(0.3, 0.5, (count, 1)))
    bending = np.array([0.0, 0.0, 1.0]) * rng.normal(0.25, 0.6, (count, 1))
    rolling = np.array([1.0, 0.0, 0.0]) * rng.normal(-0.5, 0.9, (count, 1))
    turn = quaternion_multiply(quaternion_multiply(heading, _AHEAD), quaternion_exp(bending))
    turn = quaternion_multiply(turn, quaternion_exp(rolling))[since]
    nudge = np.where(far, 0.0, 0.2)[:, None] * rng.standard_normal((count, 3))
    turn = quaternion_multiply(turn, quaternion_exp(nudge))
    least = np.linalg.norm(np.diff(place, axis=0), axis=1) / FASTEST_WRIST
    least = np.maximum(least, geodesic_angle(turn[:-1], turn[1:]) / FASTEST_TURN)
    timing = draw_timing(least, np.zeros(count, dtype=bool), np.zeros((count - 1, 1)), rng)
    moved = along(time, timing, place, np.zeros(3, dtype=int)) + _SWAY * drift(time, 3, rng)
    return moved, along_rotations(time, timing, turn)
