"""Two hands that act on each other: palms meet, fingers interlace, one lies on the other, they clap or hold something.

Hands are brought together until their flesh meets (`devices.gloves.collisions`); between meetings they are apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.hand import FREEDOMS, Side, limits, mirrored_rotations, mirrored_vectors
from bodysense.body.hand_capsules import mutual_depth
from bodysense.body.pose import forward_kinematics
from bodysense.body.rotation import (
    geodesic_angle,
    matrix_to_quaternion,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense.body.skeleton import Skeleton
from bodysense_lab.synthesis.flesh import posed, settled
from bodysense_lab.synthesis.gestures import NAMES, key_poses
from bodysense_lab.synthesis.hands import DIGIT, FASTEST_FINGER, FASTEST_TURN, FASTEST_WRIST, frame_times
from bodysense_lab.synthesis.motion import RATE, HandMotion
from bodysense_lab.synthesis.paths import Timing, along, along_rotations, draw_timing

Three = tuple[float, float, float]


@dataclass(frozen=True)
class HeldMeeting:
    """How one hand is held: directions of its fingers and of its back, and which of its points is in the middle."""

    fingers: Three
    back: Three
    point: str
    gestures: tuple[str, ...]  # one of them
    beside: float = 0.0  # m from the middle toward the thumb


@dataclass(frozen=True)
class HandMeeting:
    """A way in which hands meet."""

    name: str
    left: HeldMeeting
    right: HeldMeeting
    comes: Three  # from where the left hand comes; the right one comes from opposite
    slide: float = 0.008  # m, deviation of where they meet
    again: int = 0  # times at most that they part and meet once more
    rub: bool = False  # … without parting
    closing: str | None = None  # gesture toward which fingers then close, until they touch
    gap: tuple[float, float] = (0.0, 0.0)  # m between them, from, to
    often: float = 1.0


_FLAT = ("flat", "flat", "relaxed")
_X, _Y = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
_UPRIGHT = HeldMeeting((0.0, 1.0, 0.35), _X, "middle1", _FLAT)
_FORWARD = HeldMeeting((-0.1, 0.25, 1.0), _X, "middle1", _FLAT)
_FOLDED = HeldMeeting((-0.55, 0.5, 0.6), (0.8, 0.35, 0.4), "middle2", ("spread",))
_DOWN = HeldMeeting((-0.75, 0.0, 0.65), (0.0, 1.0, 0.0), "middle1", _FLAT)
_UP = HeldMeeting((-0.75, 0.0, 0.65), (0.0, -1.0, 0.0), "middle1", ("flat", "relaxed", "spread"))
_FIST = HeldMeeting((-1.0, 0.0, 0.4), (0.3, 0.9, 0.3), "middle1", ("fist", "fist_thumb_beside"))
_INDEX = HeldMeeting((-1.0, 0.1, 0.5), (0.3, 0.8, 0.4), "index_tip", ("one", "thumb_one"))
_PINCH = HeldMeeting((-0.8, -0.1, 0.7), (0.4, 0.8, 0.3), "index_tip", ("pinch_index", "pinch_middle", "key"))
_POKING = HeldMeeting((-0.5, -0.8, 0.4), (0.2, 0.4, 0.8), "index_tip", ("one", "thumb_one", "pinch_index"))
_HOLDING = HeldMeeting((-0.2, 0.2, 1.0), (0.9, -0.2, 0.2), "middle1", ("ball", "cylinder", "spread", "flat", "claw"))
_STEEPLE = HeldMeeting((-0.15, 1.0, 0.5), _X, "middle_tip", ("ball", "ball", "claw"))

MEETINGS = (
    HandMeeting("palms", _UPRIGHT, _UPRIGHT, _X),
    HandMeeting("rubbing", _FORWARD, _UPRIGHT, _X, slide=0.025, again=4, rub=True),
    HandMeeting("clapping", _FORWARD, replace(_FORWARD, fingers=(-0.1, 0.6, 0.9)), _X, again=7),
    HandMeeting("fingertips", _STEEPLE, _STEEPLE, _X, slide=0.003),
    HandMeeting("interlaced", _FOLDED, replace(_FOLDED, beside=0.012), _X, slide=0.004, closing="hook", often=1.5),
    HandMeeting("clasped", _FORWARD, _UPRIGHT, _X, closing="cylinder"),
    HandMeeting("left_over", _DOWN, _DOWN, (0.0, 1.0, 0.0), slide=0.02, again=1),
    HandMeeting("right_over", _DOWN, _DOWN, _Y, slide=0.02, again=1),
    HandMeeting("fist_in_palm", _FORWARD, _FIST, _X, slide=0.012, again=2),
    HandMeeting("palm_on_fist", _FIST, _FORWARD, _X, slide=0.012, again=2),
    HandMeeting("index_fingers", _INDEX, _INDEX, _X, slide=0.003),
    HandMeeting("pinches", _PINCH, _PINCH, _X, slide=0.006, again=3, often=1.5),
    HandMeeting("on_palm", _UP, _POKING, _Y, slide=0.025, again=4),
    HandMeeting("from_palm", _POKING, _UP, (0.0, 1.0, 0.0), slide=0.025, again=4),
    HandMeeting("holding", _HOLDING, _HOLDING, _X, slide=0.03, gap=(0.02, 0.3), often=3.0),
)


SIDES: tuple[Side, Side] = ("left", "right")
_SECONDS = 2.5  # a little less than a meeting lasts, so that there are enough of them
_AWAY, _PART = (0.06, 0.25), (0.03, 0.10)  # m between hands before and after a meeting, and within one
_FARTHEST, _CLOSE, _STEPS = 0.6, 0.0005, 40  # m; m; steps by which hands are brought together
_TILT = 15.0  # rad/m: hands that slide little tilt little
_CLOSURES = np.linspace(0, 1, 9)  # shares of closing that are tried
_BEFORE, _ABOUT = np.array([0.0, 1.12, 0.36]), np.array([0.10, 0.10, 0.06])  # m: where hands meet before a body
_WRIST = 5  # part of the timing, after five digits


@dataclass(frozen=True, eq=False)
class _Keys:
    """K keys of both hands (2, K, …), left and right, in the frame of their meetings."""

    angles: np.ndarray  # (2, K, 26) rad
    root: np.ndarray  # (2, K, 3) m
    turn: np.ndarray  # (2, K, 4)
    held: np.ndarray  # (K,) bool: the hands meet


def synthesize_pair(
    hand: Skeleton, seconds: float, rng: np.random.Generator, rate: float = RATE
) -> tuple[HandMotion, HandMotion]:
    """Left and right hand of a person, alike, that meet again and again; the right one is mirrored at x = 0.

    Where hands meet at a key pose they touch; on the way they may pass through each other a little. Raises
    BodysenseError where `seconds` and `rate` make no frame.
    """
    time = frame_times(seconds, rate)
    keys = _draw_keys(hand, int(np.ceil(seconds / _SECONDS)) + 1, rng)
    timing = _draw_pair_timing(keys, rng)
    wrists = replace(timing, start=timing.start[:, _WRIST:])
    middle, facing = _carry(time, rng)

    def motion(k: int, side: Side) -> HandMotion:
        carried, turned = mirrored_vectors(middle, side), mirrored_rotations(facing, side)
        wrist = along(time, wrists, keys.root[k], np.zeros(3, dtype=int))
        turn = quaternion_multiply(turned, along_rotations(time, wrists, keys.turn[k]))
        fingers = np.clip(along(time, timing, keys.angles[k], DIGIT), *limits())
        pose = posed(hand, carried + quaternion_rotate(turned, wrist), turn, fingers)
        return HandMotion("synthesised", pose, rate, "synthesised", side)

    return motion(0, "left"), motion(1, "right")


def _draw_keys(hand: Skeleton, count: int, rng: np.random.Generator) -> _Keys:
    """The keys of `count` meetings: apart, together, perhaps again and again, apart."""
    chance = np.array([meeting.often for meeting in MEETINGS])
    meetings = [MEETINGS[int(m)] for m in rng.choice(len(MEETINGS), count, p=chance / chance.sum())]
    owner, gap, held = _script(meetings, rng)
    slide, rub = np.array([meeting.slide for meeting in meetings]), np.array([meeting.rub for meeting in meetings])
    angles, root, turn = np.empty((2, count, len(FREEDOMS))), np.empty((2, count, 3)), np.empty((2, count, 4))
    for k, side in enumerate(SIDES):
        holds: list[HeldMeeting] = [getattr(meeting, side) for meeting in meetings]
        gesture = [NAMES.index(hold.gestures[rng.integers(len(hold.gestures))]) for hold in holds]
        angles[k] = settled(hand, key_poses(np.array(gesture), rng))
        tilt = quaternion_exp(np.minimum(_TILT * slide, 0.12)[:, None] * rng.standard_normal((count, 3)))
        turn[k] = quaternion_multiply(tilt, np.array([_turn(hold) for hold in holds]))
        points = forward_kinematics(posed(hand, np.zeros(3), turn[k], angles[k]))[0]
        root[k] = -points[np.arange(count), hand.indices([hold.point for hold in holds])]
        beside = np.array([[0.0, 0.0, hold.beside] for hold in holds])
        root[k] += quaternion_rotate(turn[k], beside)
    come = np.array([meeting.comes for meeting in meetings])
    # From the sides both come from +x, the right hand being mirrored; from above and below they come from opposite.
    come = np.stack([come, come * [1.0, -1.0, -1.0]])
    root[0] += slide[:, None] * rng.standard_normal((count, 3)) * (come[0] == 0)
    root += come * _touching_distance(hand, angles, root, turn, come)[:, None]
    closed = _closed(hand, angles, root, turn, meetings, rng)

    shifted = root[:, owner] + come[:, owner] * gap[:, None] / 2
    rubbed = (rub[owner] & held) * slide[owner]
    shifted[0] += rubbed[:, None] * rng.standard_normal((len(owner), 3)) * (come[0, owner] == 0)
    return _Keys(np.where(held[:, None], closed[:, owner], angles[:, owner]), shifted, turn[:, owner], held)


def _script(meetings: Sequence[HandMeeting], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for every key its meeting, the distance between the hands in metres, and whether they meet."""
    rows: list[tuple[int, float, bool]] = []
    for which, meeting in enumerate(meetings):
        rows.append((which, rng.uniform(*_AWAY), False))
        for again in range(1 + rng.integers(meeting.again + 1)):
            if again and not meeting.rub:
                rows.append((which, rng.uniform(*_PART), False))
            rows.append((which, rng.uniform(*meeting.gap), True))
        rows.append((which, rng.uniform(*_AWAY), False))
    owner, gap, held = zip(*rows, strict=True)
    return np.array(owner), np.array(gap), np.array(held)


def _touching_distance(
    hand: Skeleton, angles: np.ndarray, root: np.ndarray, turn: np.ndarray, come: np.ndarray
) -> np.ndarray:
    """(K,) m by which both hands (2, K, …) are moved toward where they come from so that they just touch.

    From far away each step is as long as the gap, so no hand can pass through the other (conservative advancement).
    Hands that miss each other are not moved.
    """
    away = np.full(root.shape[1], _FARTHEST / 2)
    for _ in range(_STEPS):
        left, right = (posed(hand, root[k] + come[k] * away[:, None], turn[k], angles[k]) for k in range(2))
        gap = -mutual_depth(left, right).max(axis=(-2, -1))
        away = np.maximum(away - gap * (gap > _CLOSE) / 2, 0.0)
        if (gap <= _CLOSE).all():
            break
    return away


def _closed(
    hand: Skeleton,
    angles: np.ndarray,
    root: np.ndarray,
    turn: np.ndarray,
    meetings: Sequence[HandMeeting],
    rng: np.random.Generator,
) -> np.ndarray:
    """Angles (2, K, 26) with the fingers closed, until they touch, in meetings that ask for it."""
    closes = np.flatnonzero([meeting.closing is not None for meeting in meetings])
    result = angles.copy()
    if not len(closes):
        return result
    gesture = np.array([NAMES.index(meetings[int(k)].closing or "") for k in closes])
    target = np.stack([key_poses(gesture, rng).angles for _ in SIDES])
    target[..., :6] = angles[:, closes, :6]  # thumbs stay
    share = _CLOSURES[:, None, None]
    trial = [(1 - share) * angles[k, closes] + share * target[k] for k in range(2)]
    left, right = (posed(hand, root[k, closes], turn[k, closes], trial[k]) for k in range(2))
    depth = mutual_depth(left, right).max(axis=(-2, -1))
    free = np.logical_and.accumulate(depth <= np.maximum(depth[:1], 0.0) + _CLOSE, axis=0)
    best = free.sum(axis=0) - 1
    for k in range(2):
        result[k, closes] = trial[k][best, np.arange(len(closes))]
    return result


def _turn(hold: HeldMeeting) -> np.ndarray:
    """Rotation (4,) of a hand whose fingers point, and whose back faces, as its hold says; fingers exactly."""
    fingers = np.array(hold.fingers) / np.linalg.norm(hold.fingers)
    thumb = np.cross(fingers, hold.back)
    thumb /= np.linalg.norm(thumb)
    return matrix_to_quaternion(np.stack([fingers, np.cross(thumb, fingers), thumb], axis=1))


def _draw_pair_timing(keys: _Keys, rng: np.random.Generator) -> Timing:
    """When the movements take place: no finger, wrist or turn is faster than one hand's."""
    least = np.maximum.reduce(
        [
            np.abs(np.diff(keys.angles, axis=1)).max(axis=(0, 2)) / FASTEST_FINGER,
            np.linalg.norm(np.diff(keys.root, axis=1), axis=2).max(axis=0) / FASTEST_WRIST,
            geodesic_angle(keys.turn[:, :-1], keys.turn[:, 1:]).max(axis=0) / FASTEST_TURN,
        ]
    )
    lag = np.zeros((len(least), _WRIST + 1))
    # Fingers close when the hands have met, and open before they part; the wrists wait for them and go first.
    lag[keys.held[1:], :_WRIST] = 0.4
    lag[keys.held[:-1], _WRIST] = 0.4
    return draw_timing(least, keys.held, lag, rng)


def _carry(time: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Where the frame of the meetings is (T, 3) m and how it is turned (T, 4): both hands are carried about."""
    count = int(np.ceil(time[-1])) + 4
    place = _BEFORE + _ABOUT * rng.standard_normal((count, 3))
    turn = quaternion_exp(np.array([0.35, 0.45, 0.25]) * rng.standard_normal((count, 3)))
    least = np.linalg.norm(np.diff(place, axis=0), axis=1) / (FASTEST_WRIST / 2)
    timing = draw_timing(np.maximum(least, 0.5), np.zeros(count, dtype=bool), np.zeros((count - 1, 1)), rng)
    return along(time, timing, place, np.zeros(3, dtype=int)), along_rotations(time, timing, turn)
