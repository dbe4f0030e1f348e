"""Shapes of a glove's nine markers in a few postures of the hand, to recognise a glove."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from bodysense.body.hands.glove import default_glove, marker_positions
from bodysense.body.hands.hand import (
    FINGERS,
    FREEDOMS,
    closing_hand,
    rotations_of,
)
from bodysense.body.pose import Pose
from bodysense.body.skeleton import Skeleton
from bodysense.geometry.registration import register


@lru_cache(maxsize=16)
def hand_shapes(hand: Skeleton) -> np.ndarray:
    """Return markers (S, M, 3) m of a left hand, from the wrist: flat, relaxed, half closed, nearly a fist."""
    return np.asarray(marker_positions(default_glove(), _at_origin(hand, closing_hand())))


@lru_cache(maxsize=16)
def marker_ranges(hand: Skeleton) -> np.ndarray:
    """Return possible positions (M, K, 3) m of a left hand's markers, from the wrist: any flexion, no spread.

    A marker on the back of the hand has one position, repeated K times.
    """
    steps = np.linspace(0, 1, 8)
    base, middle = (grid.ravel()[:, None] for grid in np.meshgrid(-20 + 110 * steps, 100 * steps))
    aside, ahead, bent = (grid.ravel()[:, None] for grid in np.meshgrid(*[np.linspace(0, 1, 4)] * 3))
    # Degrees. The last joint of a finger bends with the one before it, by two thirds.
    turns = {f"{finger}{k}": turn for finger in FINGERS[1:] for k, turn in ((1, base), (2, middle), (3, middle / 1.5))}
    turns |= {"thumb1": -25 + 65 * ahead, "thumb2": -10 + 50 * bent, "thumb3": -10 + 70 * bent}
    angles = np.zeros((len(base), len(FREEDOMS)))
    for place, row in enumerate(FREEDOMS):
        if row.angle == "flexion":
            angles[:, place] = turns[row.joint][:, 0]
        elif row.joint == "thumb1" and row.angle == "abduction":
            angles[:, place] = (-35 + 70 * aside)[:, 0]
    markers = marker_positions(default_glove(), _at_origin(hand, np.radians(angles)))
    return np.ascontiguousarray(np.asarray(markers).swapaxes(0, 1))


def _at_origin(hand: Skeleton, angles: np.ndarray) -> Pose:
    """Return a hand with fingers at angles (N, 26) rad and the wrist at the origin."""
    wrist = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (len(angles), 1, 4))
    return Pose(hand, np.zeros((len(angles), 3)), np.concatenate([wrist, rotations_of(angles)], axis=1))


def shape_distance(shapes: np.ndarray, markers: np.ndarray) -> np.ndarray:
    """Return the distance (N,) m, root mean square, of gloves' markers (N, M, 3) m from the most similar shape.

    Missing markers are NaN; if all are missing, the distance is infinite.
    """
    count = len(shapes)
    several, like = np.repeat(markers, count, axis=0), np.tile(shapes, (len(markers), 1, 1))
    known = np.asarray(np.isfinite(several).all(axis=-1))
    rotation, translation = register(like, several, known)[:2]
    apart = several - (like @ rotation.swapaxes(-1, -2) + translation[:, None])
    squared = np.where(known, (apart**2).sum(axis=-1), 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)
    squared = np.where(known.any(axis=1), squared, np.inf).reshape(-1, count)
    return np.sqrt(squared.min(axis=1))
