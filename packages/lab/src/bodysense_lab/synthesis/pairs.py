"""Motion of two hands that touch: palms meet, fingers interlace, one rests on the other, they clap or hold something.

Hands approach until their capsules touch (`body.hand_capsules`). Between interactions they are apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from bodysense.body.hands.hand import FREEDOMS, Side, limits, mirrored_rotations, mirrored_vectors
from bodysense.body.hands.hand_capsules import mutual_depth
from bodysense.body.pose import forward_kinematics
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.rotation import (
    geodesic_angle,
    matrix_to_quaternion,
    quaternion_exp,
    quaternion_multiply,
    quaternion_rotate,
)
from bodysense_lab.synthesis.gestures import NAMES, key_poses
from bodysense_lab.synthesis.hand_contact import pose_hand, solve_contacts
from bodysense_lab.synthesis.hands import DIGIT, FASTEST_FINGER, FASTEST_TURN, FASTEST_WRIST, frame_times
from bodysense_lab.synthesis.motion import RATE, HandMotion
from bodysense_lab.synthesis.paths import Timing, draw_timing, interpolate_keys, interpolate_rotations

Three = tuple[float, float, float]


@dataclass(frozen=True)
class HandPlacement:
    """Placement of one hand in an interaction, in the axes of the interaction."""

    fingers: Three  # direction of the fingers
    back: Three  # direction of the hand's back
    point: str  # point of the hand that is at the origin
    gestures: tuple[str, ...]  # one of them is drawn
    thumb_offset: float = 0.0  # m from the origin toward the thumb


@dataclass(frozen=True)
class HandInteraction:
    """One kind of interaction of two hands."""

    name: str
    left: HandPlacement
    right: HandPlacement
    approach: Three  # direction in which the left hand is before it approaches; the right hand is opposite
    slide: float = 0.008  # m, standard deviation of the place where they meet
    repeats: int = 0  # maximum number of times that they part and meet again
    rub: bool = False  # whether they repeat without parting
    closing: str | None = None  # gesture toward which the fingers then close until they touch
    gap: tuple[float, float] = (0.0, 0.0)  # m between the hands, lowest and highest
    weight: float = 1.0  # relative frequency


_FLAT = ("flat", "flat", "relaxed")
_X, _Y = (1.0, 0.0, 0.0), (0.0, -1.0, 0.0)
_UPRIGHT = HandPlacement((0.0, 1.0, 0.35), _X, "middle1", _FLAT)
_FORWARD = HandPlacement((-0.1, 0.25, 1.0), _X, "middle1", _FLAT)
_FOLDED = HandPlacement((-0.55, 0.5, 0.6), (0.8, 0.35, 0.4), "middle2", ("spread",))
_DOWN = HandPlacement((-0.75, 0.0, 0.65), (0.0, 1.0, 0.0), "middle1", _FLAT)
_UP = HandPlacement((-0.75, 0.0, 0.65), (0.0, -1.0, 0.0), "middle1", ("flat", "relaxed", "spread"))
_FIST = HandPlacement((-1.0, 0.0, 0.4), (0.3, 0.9, 0.3), "middle1", ("fist", "fist_thumb_beside"))
_INDEX = HandPlacement((-1.0, 0.1, 0.5), (0.3, 0.8, 0.4), "index_tip", ("one", "thumb_one"))
_PINCH = HandPlacement((-0.8, -0.1, 0.7), (0.4, 0.8, 0.3), "index_tip", ("pinch_index", "pinch_middle", "key"))
_POKING = HandPlacement((-0.5, -0.8, 0.4), (0.2, 0.4, 0.8), "index_tip", ("one", "thumb_one", "pinch_index"))
_HOLDING = HandPlacement((-0.2, 0.2, 1.0), (0.9, -0.2, 0.2), "middle1", ("ball", "cylinder", "spread", "flat", "claw"))
_STEEPLE = HandPlacement((-0.15, 1.0, 0.5), _X, "middle_tip", ("ball", "ball", "claw"))

INTERACTIONS = (
    HandInteraction("palms", _UPRIGHT, _UPRIGHT, _X),
    HandInteraction("rubbing", _FORWARD, _UPRIGHT, _X, slide=0.025, repeats=4, rub=True),
    HandInteraction("clapping", _FORWARD, replace(_FORWARD, fingers=(-0.1, 0.6, 0.9)), _X, repeats=7),
    HandInteraction("fingertips", _STEEPLE, _STEEPLE, _X, slide=0.003),
    HandInteraction(
        "interlaced", _FOLDED, replace(_FOLDED, thumb_offset=0.012), _X, slide=0.004, closing="hook", weight=1.5
    ),
    HandInteraction("clasped", _FORWARD, _UPRIGHT, _X, closing="cylinder"),
    HandInteraction("left_over", _DOWN, _DOWN, (0.0, 1.0, 0.0), slide=0.02, repeats=1),
    HandInteraction("right_over", _DOWN, _DOWN, _Y, slide=0.02, repeats=1),
    HandInteraction("fist_in_palm", _FORWARD, _FIST, _X, slide=0.012, repeats=2),
    HandInteraction("palm_on_fist", _FIST, _FORWARD, _X, slide=0.012, repeats=2),
    HandInteraction("index_fingers", _INDEX, _INDEX, _X, slide=0.003),
    HandInteraction("pinches", _PINCH, _PINCH, _X, slide=0.006, repeats=3, weight=1.5),
    HandInteraction("on_palm", _UP, _POKING, _Y, slide=0.025, repeats=4),
    HandInteraction("from_palm", _POKING, _UP, (0.0, 1.0, 0.0), slide=0.025, repeats=4),
    HandInteraction("holding", _HOLDING, _HOLDING, _X, slide=0.03, gap=(0.02, 0.3), weight=3.0),
)


SIDES: tuple[Side, Side] = ("left", "right")
_INTERACTION_SECONDS = 2.5  # a little less than an interaction lasts, so that enough are drawn
_APART_DISTANCE = (0.06, 0.25)  # m between the hands before and after an interaction
_PAUSE_DISTANCE = (0.03, 0.10)  # m between the hands when they part within one
_START_DISTANCE, _CONTACT_TOLERANCE = 0.6, 0.0005  # m
_APPROACH_STEPS = 40  # steps in which hands approach
_TILT_PER_SLIDE = 15.0  # rad/m: hands that slide little tilt little
_CLOSING_SHARES = np.linspace(0, 1, 9)  # shares of closing that are tried
_WORK_CENTER = np.array([0.0, 1.12, 0.36])  # m, mean position in front of the body
_WORK_SPREAD = np.array([0.10, 0.10, 0.06])  # m, its standard deviation
_WRIST = 5  # part of the timing, after five digits


@dataclass(frozen=True, eq=False)
class _Keys:
    """K keys of both hands (2, K, …), left and right, in the axes of their interactions."""

    angles: np.ndarray  # (2, K, 26) rad
    root: np.ndarray  # (2, K, 3) m
    turn: np.ndarray  # (2, K, 4)
    held: np.ndarray  # (K,) bool: the hands meet


def synthesize_pair(
    hand: Skeleton, seconds: float, rng: np.random.Generator, rate: float = RATE
) -> tuple[HandMotion, HandMotion]:
    """Return motion of a left and a right hand of the same shape that interact; the right one is mirrored at x = 0.

    Hands touch at the key poses of an interaction. Between key poses they may overlap a little. Raises BodysenseError
    if `seconds` at `rate` Hz give no frame.
    """
    time = frame_times(seconds, rate)
    keys = _draw_keys(hand, int(np.ceil(seconds / _INTERACTION_SECONDS)) + 1, rng)
    timing = _draw_pair_timing(keys, rng)
    wrists = replace(timing, start=timing.start[:, _WRIST:])
    middle, facing = _carrier_motion(time, rng)

    def motion(k: int, side: Side) -> HandMotion:
        carried, turned = mirrored_vectors(middle, side), mirrored_rotations(facing, side)
        wrist = interpolate_keys(time, wrists, keys.root[k], np.zeros(3, dtype=int))
        turn = quaternion_multiply(turned, interpolate_rotations(time, wrists, keys.turn[k]))
        fingers = np.clip(interpolate_keys(time, timing, keys.angles[k], DIGIT), *limits())
        pose = pose_hand(hand, carried + quaternion_rotate(turned, wrist), turn, fingers)
        return HandMotion("synthesised", pose, rate, "synthesised", side)

    return motion(0, "left"), motion(1, "right")


def _draw_keys(hand: Skeleton, count: int, rng: np.random.Generator) -> _Keys:
    """Return the keys of `count` interactions: apart, together, perhaps repeated, apart."""
    chance = np.array([interaction.weight for interaction in INTERACTIONS])
    interactions = [INTERACTIONS[int(m)] for m in rng.choice(len(INTERACTIONS), count, p=chance / chance.sum())]
    owner, gap, held = _schedule_keys(interactions, rng)
    slide, rub = (
        np.array([interaction.slide for interaction in interactions]),
        np.array([interaction.rub for interaction in interactions]),
    )
    angles, root, turn = np.empty((2, count, len(FREEDOMS))), np.empty((2, count, 3)), np.empty((2, count, 4))
    for k, side in enumerate(SIDES):
        placements: list[HandPlacement] = [getattr(interaction, side) for interaction in interactions]
        gesture = [NAMES.index(placement.gestures[rng.integers(len(placement.gestures))]) for placement in placements]
        angles[k] = solve_contacts(hand, key_poses(np.array(gesture), rng))
        tilt = quaternion_exp(np.minimum(_TILT_PER_SLIDE * slide, 0.12)[:, None] * rng.standard_normal((count, 3)))
        turn[k] = quaternion_multiply(tilt, np.array([_hand_rotation(placement) for placement in placements]))
        points = forward_kinematics(pose_hand(hand, np.zeros(3), turn[k], angles[k]))[0]
        root[k] = -points[np.arange(count), hand.indices([placement.point for placement in placements])]
        thumb_offset = np.array([[0.0, 0.0, placement.thumb_offset] for placement in placements])
        root[k] += quaternion_rotate(turn[k], thumb_offset)
    come = np.array([interaction.approach for interaction in interactions])
    # Along x both hands approach from +x, for the right hand is mirrored. Vertically they approach from opposite sides.
    come = np.stack([come, come * [1.0, -1.0, -1.0]])
    root[0] += slide[:, None] * rng.standard_normal((count, 3)) * (come[0] == 0)
    root += come * _touching_distance(hand, angles, root, turn, come)[:, None]
    closed = _close_fingers(hand, angles, root, turn, interactions, rng)

    shifted = root[:, owner] + come[:, owner] * gap[:, None] / 2
    rubbed = (rub[owner] & held) * slide[owner]
    shifted[0] += rubbed[:, None] * rng.standard_normal((len(owner), 3)) * (come[0, owner] == 0)
    return _Keys(np.where(held[:, None], closed[:, owner], angles[:, owner]), shifted, turn[:, owner], held)


def _schedule_keys(
    interactions: Sequence[HandInteraction], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the interaction of every key, the distance between the hands in m, and whether they touch."""
    rows: list[tuple[int, float, bool]] = []
    for which, interaction in enumerate(interactions):
        rows.append((which, rng.uniform(*_APART_DISTANCE), False))
        for repeat in range(1 + rng.integers(interaction.repeats + 1)):
            if repeat and not interaction.rub:
                rows.append((which, rng.uniform(*_PAUSE_DISTANCE), False))
            rows.append((which, rng.uniform(*interaction.gap), True))
        rows.append((which, rng.uniform(*_APART_DISTANCE), False))
    owner, gap, held = zip(*rows, strict=True)
    return np.array(owner), np.array(gap), np.array(held)


def _touching_distance(
    hand: Skeleton, angles: np.ndarray, root: np.ndarray, turn: np.ndarray, come: np.ndarray
) -> np.ndarray:
    """Return the distances (K,) m from the origin at which both hands (2, K, …) just touch.

    Hands approach from far away. Each step is as long as their gap, so that they cannot pass through each other
    (conservative advancement). The distance of hands that miss each other is 0.
    """
    away = np.full(root.shape[1], _START_DISTANCE / 2)
    for _ in range(_APPROACH_STEPS):
        left, right = (pose_hand(hand, root[k] + come[k] * away[:, None], turn[k], angles[k]) for k in range(2))
        gap = -mutual_depth(left, right).max(axis=(-2, -1))
        away = np.maximum(away - gap * (gap > _CONTACT_TOLERANCE) / 2, 0.0)
        if (gap <= _CONTACT_TOLERANCE).all():
            break
    return away


def _close_fingers(
    hand: Skeleton,
    angles: np.ndarray,
    root: np.ndarray,
    turn: np.ndarray,
    interactions: Sequence[HandInteraction],
    rng: np.random.Generator,
) -> np.ndarray:
    """Return angles (2, K, 26), with the fingers closed until they touch in interactions with `closing`."""
    closes = np.flatnonzero([interaction.closing is not None for interaction in interactions])
    result = angles.copy()
    if not len(closes):
        return result
    gesture = np.array([NAMES.index(interactions[int(k)].closing or "") for k in closes])
    target = np.stack([key_poses(gesture, rng).angles for _ in SIDES])
    target[..., :6] = angles[:, closes, :6]  # thumbs stay
    share = _CLOSING_SHARES[:, None, None]
    trial = [(1 - share) * angles[k, closes] + share * target[k] for k in range(2)]
    left, right = (pose_hand(hand, root[k, closes], turn[k, closes], trial[k]) for k in range(2))
    depth = mutual_depth(left, right).max(axis=(-2, -1))
    free = np.logical_and.accumulate(depth <= np.maximum(depth[:1], 0.0) + _CONTACT_TOLERANCE, axis=0)
    best = free.sum(axis=0) - 1
    for k in range(2):
        result[k, closes] = trial[k][best, np.arange(len(closes))]
    return result


def _hand_rotation(placement: HandPlacement) -> np.ndarray:
    """Return the rotation (4,) of a placed hand; the direction of its fingers is exact, that of its back nearly."""
    fingers = np.array(placement.fingers) / np.linalg.norm(placement.fingers)
    thumb = np.cross(fingers, placement.back)
    thumb /= np.linalg.norm(thumb)
    return matrix_to_quaternion(np.stack([fingers, np.cross(thumb, fingers), thumb], axis=1))


def _draw_pair_timing(keys: _Keys, rng: np.random.Generator) -> Timing:
    """Draw the timing of the movements; no finger, wrist or turn is faster than those of single hands."""
    least = np.maximum.reduce(
        [
            np.abs(np.diff(keys.angles, axis=1)).max(axis=(0, 2)) / FASTEST_FINGER,
            np.linalg.norm(np.diff(keys.root, axis=1), axis=2).max(axis=0) / FASTEST_WRIST,
            geodesic_angle(keys.turn[:, :-1], keys.turn[:, 1:]).max(axis=0) / FASTEST_TURN,
        ]
    )
    lag = np.zeros((len(least), _WRIST + 1))
    # Fingers close when the hands have met, and open before they part. Wrists wait for them, and move first.
    lag[keys.held[1:], :_WRIST] = 0.4
    lag[keys.held[:-1], _WRIST] = 0.4
    return draw_timing(least, keys.held, lag, rng)


def _carrier_motion(time: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return position (T, 3) m and rotation (T, 4) of the axes of the interactions, which carry both hands."""
    count = int(np.ceil(time[-1])) + 4
    place = _WORK_CENTER + _WORK_SPREAD * rng.standard_normal((count, 3))
    turn = quaternion_exp(np.array([0.35, 0.45, 0.25]) * rng.standard_normal((count, 3)))
    least = np.linalg.norm(np.diff(place, axis=0), axis=1) / (FASTEST_WRIST / 2)
    timing = draw_timing(np.maximum(least, 0.5), np.zeros(count, dtype=bool), np.zeros((count - 1, 1)), rng)
    return interpolate_keys(time, timing, place, np.zeros(3, dtype=int)), interpolate_rotations(time, timing, turn)
