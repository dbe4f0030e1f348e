"""How points on hands move with the parts of a hand's change, and which fingertips can pinch (`contact`)."""

from __future__ import annotations

from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from bodysense.body.hand import FINGERS, HAND_JOINTS
from bodysense.body.hand_capsules import NAMES
from bodysense.estimators.gloves.finger_chains import PlacedFingers
from bodysense.estimators.gloves.meetings import COUNT

ANGLES, PARTS = 45, 48  # of a hand's change: three angles a finger joint, then the wrist's shift
# (C, 15): the joints that move a capsule, which are those before it in its finger; of the palm's there is none.
_MOVED_BY = np.array([[joint[:-1] == name[:-1] and joint <= name for joint in HAND_JOINTS[1:]] for name in NAMES])
_CROSS = np.zeros((3, 9))  # a @ (b @ _CROSS as 3×3) is a × b
_CROSS[[2, 1, 2, 0, 1, 0], [1, 2, 3, 5, 6, 7]] = [-1, 1, 1, -1, -1, 1]


class Ends(NamedTuple):
    """Points on capsules; capsule c of hand h is number h · C + c."""

    capsule: np.ndarray  # (K,)
    point: np.ndarray  # (K, 3) m, world


def joined(one: Ends, other: Ends) -> Ends:
    """Both, one after the other."""
    return Ends(np.concatenate([one.capsule, other.capsule]), np.concatenate([one.point, other.point]))


def growth_rows(
    placed: PlacedFingers, axes: np.ndarray, flip: np.ndarray, start: Ends, end: Ends, toward: np.ndarray
) -> np.ndarray:
    """By how much each part of a change takes ends from starts along `toward`: (K, H · 48).

    Args:
        placed: H hands, each in its own mirrored world.
        axes: (H, 15, 3, 3) of their joints' angles (`finger_chains.turning_axes`).
        flip: (H, 3) from a hand's own world to the world.
        start: K points.
        end: K points.
        toward: (K, 3) directions, world.
    """
    count = len(toward)
    both, away = joined(start, end), np.concatenate([-toward, toward])
    hand = both.capsule // COUNT
    away = away * flip[hand]
    arm = (both.point * flip[hand])[:, None] - placed.position[hand, 1:16]
    torque = (arm @ (away @ _CROSS).reshape(-1, 3, 3)) * _MOVED_BY[both.capsule % COUNT][..., None]
    parts = np.concatenate([(axes[hand] @ torque[..., None]).reshape(-1, ANGLES), away], axis=1)
    rows = np.zeros((count, len(flip), PARTS))
    for side in (slice(0, count), slice(count, None)):  # one and the same hand may be on both
        rows[np.arange(count), hand[side]] += parts[side]
    return rows.reshape(count, len(flip) * PARTS)


def tip_ends(tip: np.ndarray, place: np.ndarray) -> Ends:
    """Fingertips (N,), number hand · 5 + finger, at `place` (N, 3) m, three times each, once an axis."""
    capsule = tip // len(FINGERS) * COUNT + tip % len(FINGERS) * 3 + 2
    return Ends(capsule.repeat(3), place.repeat(3, axis=0))


def tip_pairs(hands: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N,), (N,) of fingertips that can pinch: a thumb and its fingers, any two of two hands."""
    count = len(FINGERS)
    pairs = [(count * hand, count * hand + finger) for hand in range(hands) for finger in range(1, count)]
    for one, other in combinations(range(hands), 2):
        pairs += [(count * one + a, count * other + b) for a, b in product(range(count), repeat=2)]
    first, second = np.array(pairs).T
    return first, second
